"""Defects of drive or shaft: beside one no fault can be estimated, so the defect alone is named."""

from typing import Final

import numpy as np

from ema_core.parameters import ActuatorParameters
from ema_monitor.reasons import DeadSensor, Jam, JamOrOpenCircuit, OpenCircuit, Reason
from ema_monitor.windows.window import Window

_MOVES: Final = 10
_STANDSTILL: Final = 1e-3
# Of a window: it is enough that the defect comes up in it.
_STANDING: Final = 0.1
_AT_LIMIT: Final = 0.8
_FLOWS: Final = 0.5


def drive_defect(window: Window, parameters: ActuatorParameters) -> Reason | None:
    """Return which defect of drive or shaft a window shows; None when it shows none.

    A column that does not change while the motor moves is that of a dead sensor. Else the motor
    stands still for a tenth of the window although position and speed loop want nearly
    the current limit (M1), even at half their gain. Where that current flows the shaft is blocked;
    where it does not, a phase is open or a switch dead; where the current is not measured, it is
    any of these. A speed loop with other than a proportional gain is not judged.
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
    wanted = np.abs(np.clip(p.GAP * (error - speed) / p.k_t, -p.I_max, p.I_max))
    stands = (np.abs(speed) < _STANDSTILL * p.omega_max) & (wanted > _AT_LIMIT * p.I_max)
    if np.mean(stands) < _STANDING:
        return None
    amount = float(np.median(wanted[stands]))
    if not len(t.current):
        return JamOrOpenCircuit(amount)
    flows = float(np.median(np.abs(t.current[stands])))
    return Jam(flows) if flows > _FLOWS * amount else OpenCircuit(amount, flows)


def _dead_sensor(window: Window) -> DeadSensor | None:
    """Return which column does not change at all, although others show that the motor moves."""
    t = window.telemetry
    columns = {"current": t.current, "speed": t.speed, "position": t.position}
    still = [name for name, column in columns.items() if len(column) and not np.ptp(column)]
    if len(still) != 1:
        return None
    # A column of few values may be that of a motor that hardly moves.
    moves = [
        name
        for name, column in columns.items()
        if name != "current" and len(np.unique(column)) > _MOVES
    ]
    if not moves:
        return None
    return DeadSensor(still[0], float(columns[still[0]][0]), moves[0])
