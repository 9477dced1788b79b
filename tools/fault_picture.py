# SPDX-License-Identifier: Apache-2.0
"""Draw the telemetry of the example actuator with each fault at its limit (docs/faults.png).

Usage: `python tools/fault_picture.py docs/faults.png`.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ema_core.faults import KINDS, LIMITS
from ema_core.telemetry import Telemetry
from ema_monitor import find_windows
from ema_monitor.plot.style import GREY, VERMILION, draw_legend, stacked_panels
from ema_sim import simulate

START_S = 0.25

# Title, plotted signal and its unit, keyed by kind of fault.
PANELS = {
    "friction": ("friction +100 %: more current in both directions", "current", "A"),
    "backlash": ("play 14.5°: at each reversal the motor runs free", "current", "A"),
    "short_circuit": ("phase A has 25 % fewer turns: more current", "current", "A"),
    "eccentricity": ("rotor off by 60 % of the air gap: peaks", "current", "A"),
    "gain": ("gain -25 %: shorter strokes", "position", "rad"),
}


def window(faults: dict[str, float]) -> Telemetry:
    """Simulate an actuator with faults and return the telemetry of its test window."""
    [test_window] = find_windows(simulate(faults))
    return test_window.telemetry


def picture() -> Figure:
    """Return a figure with a panel per kind of fault, and healthy telemetry in grey."""
    figure, panels = stacked_panels([1.0] * len(PANELS), 1.6)
    healthy = window({})
    for axes, (kind, (title, signal, unit)) in zip(panels, PANELS.items(), strict=True):
        fault = KINDS[kind][0]
        away = -LIMITS[kind] if fault.is_two_sided else LIMITS[kind]
        for telemetry, colour, width, label in (
            (healthy, GREY, 2.5, "healthy"),
            (window({fault.name: fault.healthy + away}), VERMILION, 1.2, "at its limit"),
        ):
            times = 1e-9 * (telemetry.stamps_ns - telemetry.stamps_ns[0])
            shown = times >= START_S
            values = np.asarray(getattr(telemetry, signal))
            axes.plot(times[shown], values[shown], color=colour, lw=width, label=label)
        axes.set_title(title, loc="left")
        axes.set_ylabel(f"{signal} [{unit}]")
    panels[-1].set_xlabel("time in the test window [s]")
    draw_legend(figure, panels)
    return figure


if __name__ == "__main__":
    picture().savefig(Path(sys.argv[1]), dpi=80)
