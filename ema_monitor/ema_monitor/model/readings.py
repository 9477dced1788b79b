"""What wrong readings of command and position make of a window (M27).

They change no motion, but what the model is told of it: a late command is a current and a speed
that are early, and a wrong position is a wrong place to begin at.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.parameters import ActuatorParameters
from ema_monitor.model.deviations import COLUMNS, N_DEVIATIONS, NAMES
from ema_monitor.windows.window import Window

_EARLY: Final = [NAMES.index("current_delay"), NAMES.index("speed_delay")]
_COMMAND_DELAY: Final = COLUMNS.index("command_delay")
_POSITION_OFFSET: Final = COLUMNS.index("position_offset")
_POSITION_GAIN: Final = COLUMNS.index("position_gain")

TRAVEL: Final = np.array(
    [{"position_gain": 1.0, "speed_gain": -1.0}.get(name, 0.0) for name in COLUMNS]
)
"""What readings change the travel by position over that by speed, in the order of `COLUMNS`."""

MOVES_START: Final = ("position_offset", "position_gain")
"""Readings that change where the model begins."""


class Read(NamedTuple):
    """What readings amount to.

    Attributes
    ----------
    deviations
        Of the unit, ``(m, 25)``.
    position
        Where the user shaft is at the start, ``(m,)`` [rad].
    """

    deviations: NDArray[np.float64]
    position: NDArray[np.float64]


def read(columns: NDArray[np.float64], window: Window) -> Read:
    """Return what deviations, ``(m, 28)`` in the order of `COLUMNS`, amount to in a window."""
    deviations = columns[:, :N_DEVIATIONS].copy()
    deviations[:, _EARLY] -= columns[:, [_COMMAND_DELAY]]
    measured = float(window.telemetry.position[0])
    gain = 1.0 + columns[:, _POSITION_GAIN]
    return Read(deviations, (measured - columns[:, _POSITION_OFFSET]) / gain)


def law_slopes(parameters: ActuatorParameters) -> NDArray[np.float64]:
    """Return what readings change the offset of the control law by, in the order of `COLUMNS`.

    The position is by its offset too high for it, as are speed and current by theirs.

    Parameters
    ----------
    parameters
        The actuator.
    """
    by_speed = 1.0 / parameters.G_prop
    slopes = {
        "position_offset": 1.0,
        "speed_offset": by_speed,
        "current_offset": by_speed * parameters.k_t / parameters.GAP,
    }
    return np.array([slopes.get(name, 0.0) for name in COLUMNS])
