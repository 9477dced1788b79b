# SPDX-License-Identifier: Apache-2.0
"""Picture of the telemetry of a bag, with its windows."""

from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from ema_core.linear import motor_shown, travel_shown
from ema_core.telemetry import COLUMNS, Telemetry
from ema_monitor.plot.style import BLUE, GREEN, ORANGE, PURPLE, VERMILION, stacked_panels
from ema_monitor.recordings.windows import BagWindows
from ema_monitor.windows.trigger import Refusal

BINS: Final = 8192
"""Largest number of time steps in an outline: several per pixel of a picture."""


class Outline:
    """Minimum and maximum of each column in at most ``BINS`` equal steps of time.

    A step is initially two samples long, and doubles when there are too many steps. Samples older
    than the first sample are ignored.
    """

    def __init__(self) -> None:
        self._start_ns = 0
        self._step_ns = 0.0
        self._low = np.full((BINS, len(COLUMNS)), np.nan)
        self._high = self._low.copy()

    def add(self, block: Telemetry) -> None:
        """Add a block of telemetry."""
        stamps_ns = block.stamps_ns
        if not self._step_ns:
            self._start_ns, self._step_ns = block.stamp_ns, 2e9 * block.sample_period
        rows = np.full((len(block), len(COLUMNS)), np.nan)
        for number, name in enumerate(COLUMNS):
            if name not in block.missing:
                rows[:, number] = getattr(block, name)
        rows[~np.isfinite(rows)] = np.nan
        # Shift by a quarter of the first step, so that rounded timestamps stay in their step.
        late_ns = stamps_ns - (self._start_ns - 0.5e9 * block.sample_period)
        while late_ns[-1] >= BINS * self._step_ns:
            self._double()
        steps = late_ns / self._step_ns
        is_later = steps >= 0.0
        bins = steps[is_later].astype(np.intp)
        np.fmin.at(self._low, bins, rows[is_later])
        np.fmax.at(self._high, bins, rows[is_later])

    def lines(self, name: str, first_ns: int) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Return times [s] and values of a column, ``(n,)`` each, for drawing as a line.

        Times count from ``first_ns``. NaN interrupts the line where there is no telemetry.
        """
        column = COLUMNS.index(name)
        values = np.stack([self._low[:, column], self._high[:, column]], axis=1)
        steps = np.arange(BINS)[:, None] + np.array([0.0, 0.5])
        times = 1e-9 * (steps * self._step_ns + (self._start_ns - first_ns))
        return np.ravel(times), np.ravel(values)

    def _double(self) -> None:
        self._step_ns *= 2.0
        for values, pick in ((self._low, np.fmin), (self._high, np.fmax)):
            values[: BINS // 2] = pick(values[0::2], values[1::2])
            values[BINS // 2 :] = np.nan


_SHADE: Final = 0.12


def draw_telemetry(bag_windows: BagWindows, outline: Outline) -> Figure:
    """Return a figure of the whole telemetry with shaded windows."""
    unit = bag_windows.description
    travel, motor = travel_shown(unit.parameters), motor_shown(unit.parameters)
    figure, (angle, current, speed) = stacked_panels([1.0, 1.0, 1.0], 2.3)
    for axes, name, factor, colour, width in (
        (angle, "command", travel.scale, BLUE, 1.0),
        (angle, "position", travel.scale, ORANGE, 1.0),
        (current, "current", 1.0, GREEN, 0.6),
        (speed, "speed", motor.scale, PURPLE, 0.8),
    ):
        t, values = outline.lines(name, bag_windows.first_ns)
        axes.plot(t, factor * values, colour, lw=width, label=name)
    refused = [isinstance(window.place, Refusal) for window in bag_windows.windows]
    for colour, is_refused in ((BLUE, False), (VERMILION, True)):
        # One area for all windows, interrupted by NaN: a span per window takes 40 kB per axis.
        t = np.array(
            [
                (bag_windows.seconds(window.start_ns), bag_windows.seconds(window.end_ns), np.nan)
                for window, reason in zip(bag_windows.windows, refused, strict=True)
                if reason is is_refused
            ]
        ).ravel()
        for axes in (angle, current, speed):
            across = axes.get_xaxis_transform()
            axes.fill_between(t, 0.0, 1.0, transform=across, color=colour, alpha=_SHADE, lw=0)
    is_linear = bool(unit.parameters.lead)
    angle.set_ylabel(f"{'rod' if is_linear else 'user shaft'} [{travel.unit}]")
    current.set_ylabel("current [A]")
    speed.set_ylabel(f"{'rod' if is_linear else 'motor'} [{motor.unit}/s]")
    speed.set_xlabel("time since the first sample [s]")
    figure.suptitle(f"{unit.actuator_id} ({unit.serial_number})", ha="left", x=0.01)
    handles: list[Artist] = [line for axes in (angle, current, speed) for line in axes.lines]
    if not all(refused):
        handles.append(Patch(color=BLUE, alpha=_SHADE, lw=0, label="window"))
    if any(refused):
        label = "window that cannot be used"
        handles.append(Patch(color=VERMILION, alpha=_SHADE, lw=0, label=label))
    figure.legend(handles=handles, loc="outside upper center", ncols=6, frameon=False)
    return figure
