"""Picture of the telemetry of a bag, with its windows."""

from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ema_bags.windows import BagWindows
from ema_cli.bags.outline import Outline
from ema_monitor.plot.style import BLUE, GREEN, ORANGE, PURPLE, VERMILION, stacked_panels
from ema_monitor.windows.trigger import Refusal

_SHADE: Final = 0.12


def draw_telemetry(found: BagWindows, outline: Outline) -> Figure:
    """Return a figure of the whole telemetry, windows shaded."""
    figure, (angle, current, speed) = stacked_panels([1.0, 1.0, 1.0], 2.3)
    for axes, name, factor, colour, width in (
        (angle, "command", 1e3, BLUE, 1.0),
        (angle, "position", 1e3, ORANGE, 1.0),
        (current, "current", 1.0, GREEN, 0.6),
        (speed, "speed", 1.0, PURPLE, 0.8),
    ):
        t, values = outline.lines(name, found.first_ns)
        axes.plot(t, factor * values, colour, lw=width, label=name)
    refused = [isinstance(window.place, Refusal) for window in found.windows]
    for colour, is_refused in ((BLUE, False), (VERMILION, True)):
        # One area for all, broken by NaN: a span of its own for each window takes 40 kB an axis.
        t = np.array(
            [
                (found.seconds(window.start_ns), found.seconds(window.end_ns), np.nan)
                for window, reason in zip(found.windows, refused, strict=True)
                if reason is is_refused
            ]
        ).ravel()
        for axes in (angle, current, speed):
            across = axes.get_xaxis_transform()
            axes.fill_between(t, 0.0, 1.0, transform=across, color=colour, alpha=_SHADE, lw=0)
    angle.set_ylabel("user shaft [mrad]")
    current.set_ylabel("current [A]")
    speed.set_ylabel("motor [rad/s]")
    speed.set_xlabel("time since the first sample [s]")
    unit = found.description
    figure.suptitle(f"{unit.actuator_id} ({unit.serial_number})", ha="left", x=0.01)
    handles: list[Artist] = [line for axes in (angle, current, speed) for line in axes.lines]
    if not all(refused):
        handles.append(Patch(color=BLUE, alpha=_SHADE, lw=0, label="window"))
    if any(refused):
        label = "window that cannot be used"
        handles.append(Patch(color=VERMILION, alpha=_SHADE, lw=0, label=label))
    figure.legend(handles=handles, loc="outside upper center", ncols=6, frameon=False)
    return figure
