# SPDX-License-Identifier: Apache-2.0
"""Effects of wrong command and position readings on a window.

Wrong readings change the input of the model, not the motion. If the command reading is delayed,
measured current and speed appear early. If the position reading is wrong, the model starts at the
wrong position.

The method is described in ``docs/identification.md``, M27.
"""

from typing import Final

import numpy as np

from ema_core.arrays import Array
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
"""Relative change of the ratio of position travel to speed travel per unit deviation, in the order
of `COLUMNS`."""

MOVES_START: Final = ("position_offset", "position_gain")
"""Errors of readings that change the initial position of the model."""


def read(columns: Array, window: Window) -> tuple[Array, Array]:
    """Return the model inputs that reproduce a window with wrong command and position readings.

    Parameters
    ----------
    columns
        Deviations, ``(m, 28)``, in the order of `COLUMNS`.
    window
        The window.

    Returns
    -------
    tuple
        Deviations of the unit, ``(m, 25)``, and initial position of the user shaft, ``(m,)`` [rad].
    """
    deviations = columns[:, :N_DEVIATIONS].copy()
    deviations[:, _EARLY] -= columns[:, [_COMMAND_DELAY]]
    measured = float(window.telemetry.position[0])
    gain = 1.0 + columns[:, _POSITION_GAIN]
    return deviations, (measured - columns[:, _POSITION_OFFSET]) / gain


def law_slopes(parameters: ActuatorParameters) -> Array:
    """Return the change of the control-law offset [rad] per unit deviation, ordered as `COLUMNS`.

    An offset of a sensor increases the measured position, speed or current in the control law.
    All other deviations have no effect.
    """
    by_speed = 1.0 / parameters.G_prop
    slopes = {
        "position_offset": 1.0,
        "speed_offset": by_speed,
        "current_offset": by_speed * parameters.k_t / parameters.GAP,
    }
    return np.array([slopes.get(name, 0.0) for name in COLUMNS])
