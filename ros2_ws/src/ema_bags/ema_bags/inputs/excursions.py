"""Samples that leave a series and return within a few samples, faster than the series moves."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

MOST_IN_A_ROW: Final = 3
"""Longest excursion, in samples."""

FEWEST: Final = 50
"""Samples that show how a series moves."""

_USUAL_CHANGE: Final = 90.0
_TIMES_USUAL: Final = 8.0
_TIMES_NEAR: Final = 6.0
_TIMES_FASTEST: Final = 2.0
_LEAST_OF_RANGE: Final = 0.02
_RETURNS: Final = 0.5
_NEAR: Final = 8


class Pace(NamedTuple):
    """How fast a series moves, per sample and in its own unit."""

    least_step: float
    """A shorter step is no jump."""
    least_change: float
    """A smaller change from step to step is no jump."""

    @classmethod
    def of(cls, values: NDArray[np.float64]) -> "Pace":
        """Return the pace of a series, ``(n,)``.

        The fastest motion lasts two steps in one direction: a jump lasts one. Most changes of the
        step are usual ones, also if 3 % of the samples are excursions.
        """
        steps = np.diff(values)
        sustained = np.where(
            steps[1:] * steps[:-1] > 0.0, np.minimum(np.abs(steps[1:]), np.abs(steps[:-1])), 0.0
        )
        changes = np.abs(np.diff(steps))
        changes = changes[changes > 0.0]
        usual = float(np.percentile(changes, _USUAL_CHANGE)) if len(changes) else 0.0
        low, high = np.percentile(values, [1.0, 99.0])
        fastest = _TIMES_FASTEST * float(np.max(sustained, initial=0.0))
        return cls(max(fastest, _LEAST_OF_RANGE * float(high - low)), _TIMES_USUAL * usual)


class Excursions(NamedTuple):
    """Excursions of a series."""

    parts: list[tuple[int, int]]
    """First sample and end of each."""
    first_open: int | None
    """First sample that may be one, if the series returns in the samples to come."""


def find_excursions(
    values: NDArray[np.float64], first: int = 0, *, is_last: bool = True
) -> Excursions:
    """Return the excursions of a series.

    An excursion begins and ends with a jump. Both are twice as fast as the fastest motion, and
    change the step by 8 usual changes and by 6 times the largest change in the 8 samples before
    and after. So impacts, play, bang-bang moves, and counts of a coarse encoder are none.

    Parameters
    ----------
    values
        The series without values that are not finite, ``(n,)``.
    first
        First sample that may be one. Those before show how the series moves.
    is_last
        Whether no more samples come.
    """
    n = len(values)
    if n < FEWEST:
        return Excursions([], None)
    pace = Pace.of(values)
    steps = np.diff(values)
    changes = np.abs(np.diff(steps))
    is_jump = np.abs(steps) > pace.least_step
    last_change = np.inf if is_last else 0.0
    before = is_jump & (np.concatenate([[0.0], changes]) > pace.least_change)
    after = is_jump & (np.concatenate([changes, [last_change]]) > pace.least_change)
    candidates: list[tuple[int, int]] = []
    end, first_open = first, None
    for step in np.flatnonzero(before).tolist():
        if step + 1 < end:
            continue
        back = _return_of(values, steps, after, step)
        if back is not None:
            candidates.append((step + 1, back + 1))
            end = back + 1
        elif not is_last and first_open is None and step + MOST_IN_A_ROW + 2 >= n:
            first_open = step + 1
    return Excursions(_sudden(candidates, changes), first_open)


def _return_of(
    values: NDArray[np.float64], steps: NDArray[np.float64], after: NDArray[np.bool_], step: int
) -> int | None:
    """Return the step with which a series comes back from the jump of a step."""
    for back in range(step + 1, min(step + MOST_IN_A_ROW + 1, len(steps))):
        is_opposite = steps[back] * steps[step] < 0.0
        distance = abs(values[back + 1] - values[step])
        if after[back] and is_opposite and distance <= _RETURNS * abs(steps[step]):
            return back
    return None


def _sudden(
    candidates: list[tuple[int, int]], changes: NDArray[np.float64]
) -> list[tuple[int, int]]:
    """Return the excursions whose jumps are far larger than the changes around them."""
    quiet = changes.copy()
    for first, end in candidates:
        quiet[max(first - 2, 0) : end] = 0.0
    sudden = []
    for first, end in candidates:
        jumps = [changes[first - 2], *changes[end - 1 : end]]
        near = float(np.max(quiet[max(first - 2 - _NEAR, 0) : end + _NEAR], initial=0.0))
        if min(jumps) > _TIMES_NEAR * near:
            sudden.append((first, end))
    return sudden
