# SPDX-License-Identifier: Apache-2.0
"""Detection of defects of drive, shaft or sensors that prevent a fault estimate."""

from typing import Final

import numpy as np

from ema_core.columns.frozen import frozen_column
from ema_core.parameters import ActuatorParameters
from ema_monitor.reasons import DeadSensor, Jam, JamOrOpenCircuit, OpenCircuit, Reason
from ema_monitor.windows.window import Window

_MOVES: Final = 10
_STANDSTILL: Final = 1e-3
# Share of the window: the defect may occur within it.
_STANDING: Final = 0.1
_AT_LIMIT: Final = 0.8
_FLOWS: Final = 0.5


def drive_defect(window: Window, parameters: ActuatorParameters) -> Reason | None:
    """Return the defect of drive, shaft or sensor in a window, or None.

    A column that does not change while the motor moves indicates a dead sensor. Drive or shaft is
    defective if the motor stands still for 10 % of the window although position and speed loops
    demand nearly the current limit, even at half their gain (``docs/model.md``, M1). If the
    demanded current flows, the shaft is blocked. If it does not flow, a phase is open or a switch
    has failed. If the current is not measured, either defect is possible. Speed loops with integral
    or derivative gain are not checked.
    """
    p, t = parameters, window.telemetry
    if dead := _dead_sensor(window):
        return dead
    if p.GAI != 0.0 or p.GAD != 0.0:
        return None
    speed = t.speed
    if not len(speed):
        speed = np.concatenate([[window.initial_speed(p.tau)], window.speed(p.tau)])
    error = np.clip(0.5 * p.G_prop * (t.command - t.position), -p.omega_max, p.omega_max)
    demand = np.abs(np.clip(p.GAP * (error - speed) / p.k_t, -p.I_max, p.I_max))
    is_stalled = (np.abs(speed) < _STANDSTILL * p.omega_max) & (demand > _AT_LIMIT * p.I_max)
    if np.mean(is_stalled) < _STANDING:
        return None
    demanded = float(np.median(demand[is_stalled]))
    if not len(t.current):
        return JamOrOpenCircuit(demanded)
    measured = float(np.median(np.abs(t.current[is_stalled])))
    return Jam(measured) if measured > _FLOWS * demanded else OpenCircuit(demanded, measured)


def _dead_sensor(window: Window) -> DeadSensor | None:
    """Return the column that is constant although other columns show motion, or None.

    Several constant columns are the result of a stopped motor. The command is no evidence of
    motion: if it moves alone, drive or shaft has failed.
    """
    t = window.telemetry
    columns = {"current": t.current, "speed": t.speed, "position": t.position}
    # Few distinct values may come from a motor that hardly moves.
    moving = [name for name in ("speed", "position") if len(np.unique(columns[name])) > _MOVES]
    errors = [frozen_column(name, values, moving) for name, values in columns.items()]
    frozen = [error for error in errors if error]
    if len(frozen) != 1:
        return None
    return DeadSensor(frozen[0].column, frozen[0].value, frozen[0].moving)
