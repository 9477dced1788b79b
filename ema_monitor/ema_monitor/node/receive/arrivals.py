# SPDX-License-Identifier: Apache-2.0
"""Reception times of telemetry, used to distinguish live from stored telemetry."""

from collections import deque
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Final, NamedTuple

_SPAN_NS: Final = 1_000_000_000
"""Minimum telemetry duration to compute a pace [ns]."""

_LEAST_BLOCKS: Final = 5
"""Minimum number of blocks to compute a pace."""

_LEAST_PACE: Final = 0.5
"""Smallest ratio of reception time to measurement time of live telemetry [-]."""

_STEADY_PACE: Final = (0.8, 1.25)
"""Range of the ratio of reception time to measurement time for an actuator that streams in real
time [-]. A slow sender of stored telemetry does not stay within this range."""

_MOST_BLOCKS: Final = 1000


class Arrival(NamedTuple):
    """A received block of telemetry: start stamp, end stamp and reception time [ns]."""

    start_ns: int
    end_ns: int
    steady_ns: int


class Arrivals:
    """The latest blocks of telemetry of an actuator.

    Live telemetry arrives at the rate at which it is measured. Stored telemetry arrives in a burst,
    regardless of its stamps.

    Attributes
    ----------
    has_streamed
        Whether the actuator has ever sent telemetry while measuring it.
    """

    def __init__(self) -> None:
        self._blocks: deque[Arrival] = deque(maxlen=_MOST_BLOCKS)
        self.has_streamed = False

    def add(self, start_ns: int, end_ns: int, steady_ns: int) -> None:
        """Add a block with its stamps and its monotonic reception time [ns]."""
        self._blocks.append(Arrival(start_ns, end_ns, steady_ns))
        if not self.has_streamed:
            low, high = _STEADY_PACE
            self.has_streamed = all(low <= pace <= high for pace in _paces(self._run(0)))

    def are_live(self, end_ns: int) -> bool:
        """Return whether the telemetry up to the stamp ``end_ns`` was received live.

        Returns False if too few blocks were received to decide. If several blocks contain the
        stamp, all must be live.
        """
        runs = [
            self._run(place)
            for place, block in enumerate(reversed(self._blocks))
            if block.start_ns < end_ns <= block.end_ns
        ]
        return bool(runs) and all(map(_is_live, runs))

    def _run(self, place: int) -> list[Arrival]:
        """Return the latest contiguous blocks up to a position, latest first.

        ``place`` counts from the latest block, 0. Blocks that the pace does not need are omitted.
        """
        run = list[Arrival]()
        for block in self._from(place):
            if run and not 0 < run[-1].end_ns - block.end_ns <= 2 * (block.end_ns - block.start_ns):
                break
            run.append(block)
            if len(run) >= _LEAST_BLOCKS and run[0].end_ns - block.end_ns >= _SPAN_NS:
                break
        return run

    def _from(self, place: int) -> Iterator[Arrival]:
        return islice(reversed(self._blocks), place, None)


def _is_live(run: Sequence[Arrival]) -> bool:
    """Return whether both halves of a run of blocks were received in real time.

    After a pause, stored telemetry fills at most one half of a run.
    """
    return min(_paces(run)) >= _LEAST_PACE


def _paces(run: Sequence[Arrival]) -> tuple[float, float]:
    """Return the paces of both halves of a run; 0 if there are too few blocks."""
    if len(run) < _LEAST_BLOCKS:
        return 0.0, 0.0
    middle = len(run) // 2
    return _pace(run[: middle + 1]), _pace(run[middle:])


def _pace(run: Sequence[Arrival]) -> float:
    """Return the ratio of reception time to measurement time [-]."""
    last, first = run[0], run[-1]
    return (last.steady_ns - first.steady_ns) / (last.end_ns - first.end_ns)
