# SPDX-License-Identifier: Apache-2.0
"""Detection of columns that contain setpoints instead of measurements."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.defect_kinds import DefectKind
from ema_bags.inputs.input_defect import InputDefect, Setpoint

_LEAST_SAMPLES: Final = 100
_MOST_SAMPLES: Final = 3000
_LONGEST_LAG: Final = 3
_EQUAL: Final = 1e-9
_MOST: Final = 0.99
_EXACT: Final = 2e-3
_CLEARLY: Final = 5.0


def find_commanded(columns: dict[str, NDArray[np.float64]], tau: float) -> Iterator[InputDefect]:
    """Yield a defect for each column that exactly follows the command or a control law.

    Parameters
    ----------
    columns
        Columns in SI units, ``(n,)`` or empty.
    tau
        Gear ratio: user speed over motor speed [-].
    """
    present = {name: values for name, values in columns.items() if len(values)}
    if "command" not in present:
        return
    finite = np.all([np.isfinite(values) for values in present.values()], axis=0)
    moving = np.flatnonzero(finite[1:] & (np.diff(present["command"]) != 0.0))
    if not len(moving):
        return
    first = max(0, int(moving[len(moving) // 2]) - _MOST_SAMPLES // 2)
    part = slice(first, first + _MOST_SAMPLES)
    present = {name: values[part][finite[part]] for name, values in present.items()}
    command, position = present["command"], present["position"]
    if len(command) < _LEAST_SAMPLES or not np.ptp(command) > 0.0 or not np.ptp(position) > 0.0:
        return
    if (lag := _lag_of_copy(command, position)) is not None:
        yield InputDefect(DefectKind.POSITION_COMMANDED, Setpoint(lag), is_error=False)
        return
    speed = present.get("speed")
    if speed is not None and _follows(speed, np.gradient(command), np.gradient(position)):
        yield InputDefect(DefectKind.SPEED_COMMANDED, is_error=False)
    current = present.get("current")
    if current is None:
        return
    rate = np.gradient(position) if speed is None else speed * tau
    ones = np.ones(len(command))
    for is_control_law, terms in (
        (False, (command, ones)),
        (True, (command - position, rate, ones)),
    ):
        if _residual(current, terms) < _EXACT:
            evidence = Setpoint(is_control_law=is_control_law)
            yield InputDefect(DefectKind.CURRENT_COMMANDED, evidence, is_error=False)
            return


def _lag_of_copy(command: NDArray[np.float64], position: NDArray[np.float64]) -> int | None:
    """Return the lag at which the position copies the command [samples]; None if it does not."""
    moving = np.abs(np.diff(command, prepend=command[0])) > 0.0
    if np.count_nonzero(moving) < _LEAST_SAMPLES // 2:
        return None
    least = _EQUAL * float(np.ptp(command))
    for lag in range(_LONGEST_LAG + 1):
        n = len(command) - lag
        same = np.abs(position[lag:] - command[:n]) <= least
        if np.mean(same[moving[:n]]) > _MOST:
            return lag
    return None


def _follows(
    speed: NDArray[np.float64], commanded: NDArray[np.float64], moved: NDArray[np.float64]
) -> bool:
    """Return whether the speed is the derivative of the command rather than of the position."""
    of_command, of_position = (_residual(speed, (term,)) for term in (commanded, moved))
    return of_command < _EXACT and of_position > _CLEARLY * of_command


def _residual(values: NDArray[np.float64], terms: tuple[NDArray[np.float64], ...]) -> float:
    """Return the relative residual of a least-squares fit of the terms to the values [-].

    Return 1 if the values are constant or a term is 0.
    """
    size = float(np.std(values))
    sizes = [float(np.max(np.abs(term))) for term in terms]
    if size <= 0.0 or min(sizes) <= 0.0:
        return 1.0
    rows = np.column_stack([term / scale for term, scale in zip(terms, sizes, strict=True)])
    residuals = values - rows @ np.linalg.lstsq(rows, values, rcond=None)[0]
    return float(np.std(residuals)) / size
