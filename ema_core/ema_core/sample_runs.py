# SPDX-License-Identifier: Apache-2.0
"""Detection of lost telemetry, and of several publishers, by the sample indices of the blocks."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Final

_ENDED_S: Final = 5.0
"""Time without a block after which a run has ended, if another run has begun [s]."""

_MOST_RUNS: Final = 100
"""Largest number of runs; the oldest are discarded."""

_MOST_NAMED: Final = 5


@dataclass(eq=False)
class _Run:
    """Contiguous blocks of telemetry, which come from a single publisher."""

    next_index: int
    """Index of the sample after the last block."""
    latest_s: float
    """Monotonic time of the last block [s]."""
    before: "_Run | None" = None
    """Earlier run that this run continues after a gap; None if the earlier run itself continues."""
    missing: int = 0
    """Number of samples in the gap."""
    length: int = 1
    """Number of samples of the block after the gap."""
    has_returned: bool = False
    """Whether the run has continued after a block of another run."""


class SampleRuns:
    """Counts lost samples in the telemetry of an actuator, and detects several publishers.

    Subscriptions do not name the publisher of a message, but the blocks of one publisher form runs
    without a gap. A run that begins after a gap continues an earlier run, and the samples between
    them are lost. But if the earlier run continues, the later run comes from another publisher, and
    no sample is lost. A gap is therefore counted only after the earlier run has had no block for
    5 s. An index that decreases indicates a restart of the actuator, not a loss.

    Attributes
    ----------
    lost_samples, lost_blocks
        Number of missing samples, and of missing blocks, which are assumed to be as long as the
        block after the gap.
    """

    def __init__(self) -> None:
        self.lost_samples = self.lost_blocks = 0
        self._runs: list[_Run] = []

    @property
    def are_several(self) -> bool:
        """Whether several publishers send the telemetry, so that runs continue alternately."""
        return sum(run.has_returned for run in self._runs) > 1

    def add(self, first_index: int, length: int, now_s: float) -> None:
        """Add a block of ``length`` samples, received at a monotonic time [s]."""
        runs = self._runs
        run = next((item for item in reversed(runs) if item.next_index == first_index), None)
        if run is None:
            lower = [item for item in runs if item.next_index < first_index]
            before = max(lower, key=lambda item: item.next_index, default=None)
            missing = first_index - before.next_index if before else 0
            run = _Run(first_index, now_s, before, missing, length)
        else:
            if run is not runs[-1]:
                run.has_returned = True
                for item in runs:
                    if item.before is run:
                        item.before = None
            runs.remove(run)
        runs.append(run)  # the run of the latest block is last
        if len(runs) > _MOST_RUNS:
            runs.pop(0).before = None
        run.next_index, run.latest_s = first_index + length, now_s

    def settle(self, now_s: float) -> None:
        """Count the gaps after runs that have ended, and discard these runs. Call it regularly."""
        ended = {id(run) for run in self._runs[:-1] if now_s - run.latest_s > _ENDED_S}
        for run in self._runs:
            if run.before is not None and id(run.before) in ended:
                self.lost_samples += run.missing
                self.lost_blocks += -(-run.missing // run.length)
                run.before = None
        self._runs[:] = [run for run in self._runs if id(run) not in ended]

    def ignore(self) -> None:
        """Discard all gaps so far without counting them."""
        del self._runs[:-1]
        for run in self._runs:
            run.before = None

    def pause(self) -> None:
        """Discard all runs, so that blocks missed in a pause of the reception are not counted."""
        self._runs.clear()


def several_publishers(actuators: Iterable[str], nodes: Collection[str]) -> str:
    """Return a warning that several publishers send the same ``actuator_id``.

    Parameters
    ----------
    actuators
        Names of the affected actuators.
    nodes
        Full names of the publishing nodes.
    """
    named = sorted(nodes)[:_MOST_NAMED]
    named += [f"and {len(nodes) - len(named)} more"] if len(nodes) > len(named) else []
    return (
        f"several publishers send actuator_id {', '.join(actuators)} ({', '.join(named)}): stop "
        "all but one"
    )
