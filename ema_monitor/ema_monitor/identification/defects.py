"""Findings that are no fault: a defect of drive or shaft, or a column in another unit than stated.

Beside a defect no fault can be estimated, so the defect alone is named. A wrong unit shows in three
relations: the position follows its command, the speed is the derivative of the position, and the
current accelerates the known inertia. No fault changes one of these by a factor.
"""

from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array
from ema_core.causes import CAUSE_BY_NAME, CauseEstimate
from ema_core.parameters import ActuatorParameters
from ema_monitor.windows.window import Window

_MOVES: Final = 10
_STANDSTILL: Final = 1e-3
# Of a window: it is enough that the defect comes up in it.
_STANDING: Final = 0.1
_AT_LIMIT: Final = 0.8
_FLOWS: Final = 0.5

_SMOOTH_S: Final = 4e-3
_KNEE: Final = 5.0
_LEAST_FACTOR: Final = 1.25
_LEAST_TRACKING: Final = 1.6
_SURE: Final = 0.03
_ROUGH: Final = 0.3
_NEAR: Final = 0.1
_SAME: Final = 0.02
_ALIKE: Final = 0.7
_ROOT: Final = 2.0**0.5
_TURN: Final = 180.0 / np.pi
_RPM: Final = 30.0 / np.pi

_ANY: Final = {
    -1.0: "is its sign the other one?",
    1e3: "are these thousandths read as whole units?",
    1e-3: "are whole units read as thousandths?",
}
_OF_ANGLE: Final = {
    _TURN: "is it in degrees, and was in radians?",
    1.0 / _TURN: "is it in radians, and was in degrees?",
    1.0 / (2.0 * np.pi): "is it in turns, and was in radians?",
    2.0 * np.pi: "is it in radians, and was in turns?",
}
_MISTAKES: Final = {
    "command": {1.0 / _TURN: "is it in radians, and the position in degrees?"},
    "current": {_ROOT: "is a peak given for RMS?", 1.0 / _ROOT: "is RMS given for a peak?"},
    "position": {_TURN: "is it in degrees?", 25.4: "is it in mm for inches?"} | _OF_ANGLE,
    "speed": {
        _RPM: "is it in rpm?",
        _TURN: "is it in degrees a second?",
        1.0 / _RPM: "is it in rad/s, and was in rpm?",
        60.0: "is it a minute, and was a second?",
        1.0 / 60.0: "is it a second, and was a minute?",
    }
    | _OF_ANGLE,
}
"""The usual mistakes by column: what the column is multiplied by, and what to ask."""


def drive_defect(window: Window, parameters: ActuatorParameters) -> str:
    """Return which defect of drive or shaft a window shows; empty when it shows none.

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
        return ""
    speed = t.speed
    if not len(speed):
        speed = np.concatenate([[window.initial_speed(p.tau)], window.speed(p.tau)])
    error = np.clip(0.5 * p.G_prop * (t.command - t.position), -p.omega_max, p.omega_max)
    wanted = np.abs(np.clip(p.GAP * (error - speed) / p.k_t, -p.I_max, p.I_max))
    stands = (np.abs(speed) < _STANDSTILL * p.omega_max) & (wanted > _AT_LIMIT * p.I_max)
    if np.mean(stands) < _STANDING:
        return ""
    amount = float(np.median(wanted[stands]))
    open_circuit = f"{CAUSE_BY_NAME['dead_switch'].label} or {CAUSE_BY_NAME['open_phase_a'].label}"
    if not len(t.current):
        return (
            f"{CAUSE_BY_NAME['jam'].label}, {open_circuit}, B or C: the motor stands still "
            f"although the speed loop wants {amount:.1f} A; the current, which would show "
            "which, is not measured"
        )
    flows = float(np.median(np.abs(t.current[stands])))
    if flows > _FLOWS * amount:
        return (
            f"{CAUSE_BY_NAME['jam'].label}: the motor stands still although {flows:.1f} A flow; "
            "the shaft is blocked"
        )
    return (
        f"{open_circuit}, B or C: "
        f"the motor stands still, and of the {amount:.1f} A that the speed loop wants {flows:.1f} "
        "A flow"
    )


def _dead_sensor(window: Window) -> str:
    """Return which column does not change at all, although others show that the motor moves."""
    t = window.telemetry
    columns = {"current": t.current, "speed": t.speed, "position": t.position}
    still = [name for name, column in columns.items() if len(column) and not np.ptp(column)]
    if len(still) != 1:
        return ""
    # A column of few values may be that of a motor that hardly moves.
    moves = [
        name
        for name, column in columns.items()
        if name != "current" and len(np.unique(column)) > _MOVES
    ]
    if not moves:
        return ""
    return (
        f"dead {still[0]} sensor: it says {columns[still[0]][0]:.3g} throughout, although the "
        f"{moves[0]} changes"
    )


def usual_mistake(column: str, factor: float, parameters: ActuatorParameters) -> str:
    """Return the question after the usual mistake that multiplies a column by a factor, or ""."""
    known = _ANY | _MISTAKES.get(column, {})
    known |= {parameters.tau: "is the gear ratio in it twice, or missing?"}
    known |= {1.0 / parameters.tau: "is it of the other side of the gear?"}
    asked = {
        abs(factor / usual - 1.0): text
        for usual, text in known.items()
        if abs(factor / usual - 1.0) < _NEAR
    }
    return asked[min(asked)] if asked else ""


class Scale(NamedTuple):
    """A column, or "position and command", that is off by a factor, and what it was judged by."""

    column: str
    factor: float
    reason: str

    def in_words(self, parameters: ActuatorParameters) -> str:
        """Return the factor, and the usual mistake that it is."""
        words = f"the {self.column} is {self.factor:.3g} times what {self.reason} asks for"
        asked = usual_mistake(self.column.partition(" ")[0], self.factor, parameters)
        return f"{words}: {asked or 'is its unit, or its scale, right?'}"


def mistaken_scale(causes: Iterable[CauseEstimate]) -> Scale | None:
    """Return the scale of a current whose gain among the causes is that of a usual mistake."""
    for one in causes:
        if one.name == "current_gain" and any(
            abs((1.0 + one.value) / usual - 1.0) < _SAME for usual in _MISTAKES["current"]
        ):
            return Scale("current", 1.0 + one.value, "the drive")
    return None


def wrong_scale(window: Window, parameters: ActuatorParameters) -> Scale | None:
    """Return the column of a window that is off by a factor; None when none plainly is."""
    t, h = window.telemetry, window.sample_period
    count = max(3, round(_SMOOTH_S / h))
    if t.missing or len(t) < 4 * count:
        return None
    kernel = np.full(count, 1.0 / count)
    command, position, speed, current = (
        np.convolve(column, kernel, "valid")
        for column in (t.command, t.position, t.speed, t.current)
    )
    moves = np.gradient(position, h) / parameters.tau
    # What the speed is, over the change of the position.
    speed_scale = _slope(moves, speed)
    tracking = _slope(command - command.mean(), position - position.mean())
    if speed_scale is None or tracking is None:
        return None
    inertia = (parameters.J_m + parameters.J_u) / parameters.k_t
    pull = _inertia_of(speed, current, position, h)
    if _is_off(speed_scale, _LEAST_FACTOR):
        follows = not _is_off(tracking, _LEAST_TRACKING)
        if not follows:
            return Scale("position", 1.0 / speed_scale, "the speed")
        # A wrong speed makes the inertia another one, by the inverse factor.
        if pull is not None and abs(pull / inertia * speed_scale - 1.0) < _ROUGH:
            return Scale("speed", speed_scale, "the position")
        return Scale("position and command", 1.0 / speed_scale, "the speed")
    if _is_off(tracking, _LEAST_TRACKING):
        return Scale("command", 1.0 / tracking, "the position")
    if pull and _is_off(pull / inertia, _LEAST_FACTOR):
        return Scale("current", pull / inertia, "the inertia")
    return None


def _is_off(factor: float, least: float) -> bool:
    return not 1.0 / least < factor < least


def _slope(x: Array, y: Array) -> float | None:
    """Return how many times ``x`` is in ``y``; None where they are no multiples of each other."""
    xx, xy, yy = float(x @ x), float(x @ y), float(y @ y)
    return xy / xx if xy**2 > _ALIKE * xx * yy > 0.0 else None


def _inertia_of(speed: Array, current: Array, position: Array, h: float) -> float | None:
    """Return the current that an acceleration takes [A.s^2]; None when that is not determined."""
    rows = np.stack(
        [np.gradient(speed, h), speed, np.tanh(speed / _KNEE), position, np.ones_like(speed)], 1
    )
    scale = np.maximum(np.abs(rows).max(axis=0), 1e-300)
    rows = rows / scale
    found, *_ = np.linalg.lstsq(rows, current, rcond=None)
    left = current - rows @ found
    # Neighbours are alike: as if one in ten were a reading of its own.
    variance = 10.0 * float(left @ left) / max(len(left) - rows.shape[1], 1)
    covariance = variance * np.linalg.pinv(rows.T @ rows)
    if np.sqrt(covariance[0, 0]) > _SURE * abs(found[0]):
        return None
    return float(found[0] / scale[0])
