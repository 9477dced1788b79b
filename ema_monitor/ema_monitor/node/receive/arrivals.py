"""Reception times of telemetry, which show whether it was stored before it was sent."""

from collections import deque
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Final, NamedTuple

_SPAN_NS: Final = 1_000_000_000
"""Shortest duration of the telemetry whose pace is computed [ns]."""

_LEAST_BLOCKS: Final = 5
"""Smallest number of blocks of the telemetry whose pace is computed."""

_LEAST_PACE: Final = 0.5
"""Smallest ratio of reception time to measurement time of live telemetry [-]."""

_STEADY_PACE: Final = (0.8, 1.25)
"""Range of the same ratio for an actuator that streams by its clock; a slow sender of stored
telemetry does not stay within it."""

_MOST_BLOCKS: Final = 1000


class Arrival(NamedTuple):
    """A block of telemetry: stamps of its first sample and its end, and its reception [ns]."""

    start_ns: int
    end_ns: int
    steady_ns: int


class Arrivals:
    """The latest blocks of telemetry of an actuator.

    Telemetry that is sent while it is measured arrives as fast as it was measured. Stored
    telemetry arrives at once, for any stamps.

    Attributes
    ----------
    has_streamed
        Whether the actuator has ever sent telemetry while measuring it.
    """

    def __init__(self) -> None:
        self._blocks: deque[Arrival] = deque(maxlen=_MOST_BLOCKS)
        self.has_streamed = False

    def add(self, start_ns: int, end_ns: int, steady_ns: int) -> None:
        """Add a block with its stamps and its reception by a clock that never goes back [ns]."""
        self._blocks.append(Arrival(start_ns, end_ns, steady_ns))
        if not self.has_streamed:
            low, high = _STEADY_PACE
            self.has_streamed = all(low <= pace <= high for pace in _paces(self._run(0)))

    def are_live(self, end_ns: int) -> bool:
        """Return whether the telemetry up to a stamp [ns] was received as it was measured.

        False if too few blocks were received to decide. If several blocks contain the stamp, all
        of them have to be live.
        """
        runs = [
            self._run(place)
            for place, block in enumerate(reversed(self._blocks))
            if block.start_ns < end_ns <= block.end_ns
        ]
        return bool(runs) and all(map(_is_live, runs))

    def _run(self, place: int) -> list[Arrival]:
        """Return the latest blocks without a gap up to a place, the latest first.

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
    """Return whether both halves of a run were received as fast as they were measured.

    After a pause, stored telemetry fills at most one half of a run.
    """
    return min(_paces(run)) >= _LEAST_PACE


def _paces(run: Sequence[Arrival]) -> tuple[float, float]:
    """Return the paces of both halves of a run; 0 if it has too few blocks."""
    if len(run) < _LEAST_BLOCKS:
        return 0.0, 0.0
    middle = len(run) // 2
    return _pace(run[: middle + 1]), _pace(run[middle:])


def _pace(run: Sequence[Arrival]) -> float:
    """Return the ratio of reception time to measurement time [-]."""
    last, first = run[0], run[-1]
    return (last.steady_ns - first.steady_ns) / (last.end_ns - first.end_ns)
