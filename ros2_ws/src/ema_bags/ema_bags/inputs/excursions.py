# SPDX-License-Identifier: Apache-2.0
"""Excursions: spikes of a few samples that are faster than the rest of the series."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

MOST_IN_A_ROW: Final = 3
"""Longest excursion, in samples."""

FEWEST: Final = 50
"""Fewest samples from which the thresholds are estimated."""

_USUAL_CHANGE: Final = 90.0
_TIMES_USUAL: Final = 8.0
_TIMES_NEAR: Final = 6.0
_TIMES_FASTEST: Final = 2.0
_LEAST_OF_RANGE: Final = 0.02
_RETURNS: Final = 0.5
_NEAR: Final = 8


class JumpThresholds(NamedTuple):
    """Thresholds above which a step of a series counts as a jump, in the unit of the series."""

    least_step: float
    """Smallest step that counts as a jump."""
    least_change: float
    """Smallest change between successive steps that counts as a jump."""

    @classmethod
    def of(cls, values: NDArray[np.float64]) -> "JumpThresholds":
        """Estimate the thresholds from a series, ``(n,)``.

        Motion takes at least two steps in one direction; a jump takes one. The usual change of the
        step is the 90th percentile, which tolerates excursions in 3 % of the samples.
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
    """Excursions found in a series."""

    parts: list[tuple[int, int]]
    """Start and end (exclusive) of each excursion."""
    first_open: int | None
    """First sample of a possible excursion that more samples must confirm; None if there is none.
    """


def find_excursions(
    values: NDArray[np.float64], first: int = 0, *, is_last: bool = True
) -> Excursions:
    """Return the excursions of a series.

    An excursion starts and ends with a jump. Each jump is more than twice as fast as the fastest
    motion. It changes the step by more than 8 times the usual change, and by more than 6 times the
    largest change within 8 samples on either side. Impacts, backlash, bang-bang motion and coarse
    encoder counts therefore do not qualify.

    Parameters
    ----------
    values
        The series, finite values only, ``(n,)``.
    first
        First sample to search. Earlier samples only contribute to the pace.
    is_last
        Whether these are the last samples.
    """
    n = len(values)
    if n < FEWEST:
        return Excursions([], None)
    pace = JumpThresholds.of(values)
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
    """Return the step that reverses the jump at `step`; None if the series does not return."""
    for back in range(step + 1, min(step + MOST_IN_A_ROW + 1, len(steps))):
        is_opposite = steps[back] * steps[step] < 0.0
        distance = abs(values[back + 1] - values[step])
        if after[back] and is_opposite and distance <= _RETURNS * abs(steps[step]):
            return back
    return None


def _sudden(
    candidates: list[tuple[int, int]], changes: NDArray[np.float64]
) -> list[tuple[int, int]]:
    """Return the candidates whose jumps are much larger than the changes around them."""
    quiet = changes.copy()
    for first, end in candidates:
        quiet[max(first - 2, 0) : end] = 0.0
    sudden = []
    for first, end in candidates:
        jumps = [changes[first - 2], *changes[end - 1 : end]]
        largest_near = float(np.max(quiet[max(first - 2 - _NEAR, 0) : end + _NEAR], initial=0.0))
        if min(jumps) > _TIMES_NEAR * largest_near:
            sudden.append((first, end))
    return sudden
