# SPDX-License-Identifier: Apache-2.0
"""Buffer of the latest contiguous telemetry blocks."""

from array import array
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from ema_core.telemetry import Telemetry, elapsed_ns, excerpt, join

_JOINED_BLOCKS: Final = 64
_JOINED_SAMPLES: Final = 4096


class BlockStamp(NamedTuple):
    """Running index and timestamp [ns] of the first sample of a block."""

    first_index: int
    stamp_ns: int


class _Part(NamedTuple):
    """Joined blocks, with the offset and timestamp [ns] of each block's first sample."""

    telemetry: Telemetry
    offsets: "array[int]"
    stamps_ns: "array[int]"

    @property
    def end(self) -> int:
        return self.telemetry.first_index + len(self.telemetry)

    def block_stamp(self, block: int) -> BlockStamp:
        return BlockStamp(self.telemetry.first_index + self.offsets[block], self.stamps_ns[block])


class LatestBlocks:
    """Buffer of the latest blocks, which joins small blocks to save memory.

    The timestamp of each block is kept, so that joining does not change the timestamps of a cut.

    Attributes
    ----------
    last
        The latest block, or None.
    """

    def __init__(self) -> None:
        self.last: Telemetry | None = None
        self._parts: list[_Part] = []
        self._loose = 0

    @property
    def samples(self) -> int:
        """Number of samples in the buffer."""
        return sum(len(part.telemetry) for part in self._parts)

    @property
    def parts(self) -> int:
        """Number of joined parts in the buffer."""
        return len(self._parts)

    @property
    def begin(self) -> int:
        """Running index of the first sample."""
        return self._parts[0].telemetry.first_index

    @property
    def end(self) -> int:
        """Running index following the last sample."""
        return self._parts[-1].end

    def add(self, block: Telemetry) -> None:
        """Add the block that follows the latest block."""
        self.last = block
        self._parts.append(_Part(block, array("q", [0]), array("q", [block.stamp_ns])))
        self._loose += 1
        if self._loose >= _JOINED_BLOCKS:
            loose = [part.telemetry for part in self._parts[-self._loose :]]
            if sum(map(len, loose)) <= _JOINED_SAMPLES:
                first = loose[0].first_index
                offsets = array("q", [item.first_index - first for item in loose])
                stamps_ns = array("q", [item.stamp_ns for item in loose])
                self._parts[-self._loose :] = [_Part(join(loose), offsets, stamps_ns)]
            self._loose = 0

    def forget(self, index: int) -> None:
        """Drop blocks that end before a running index, except the latest block."""
        count = 0
        while count < len(self._parts) - 1 and self._parts[count].end <= index:
            count += 1
        del self._parts[:count]
        self._loose = min(self._loose, len(self._parts))

    def omit(self, omitted: range) -> None:
        """Drop blocks within a range of running indices, except the latest block.

        A later `cut` across the range must leave it out.
        """
        kept = [
            part
            for part in self._parts[:-1]
            if part.telemetry.first_index < omitted.start or part.end > omitted.stop
        ]
        self._parts[:-1] = kept
        self._loose = 1

    def cut(
        self, start: int, stop: int, omitted: Sequence[range] = ()
    ) -> tuple[Telemetry, BlockStamp, BlockStamp]:
        """Return the samples from ``start`` to ``stop`` (exclusive), and two block stamps.

        Samples in the ranges ``omitted``, in ascending order within the cut, are left out.

        The stamps belong to the first and last block that start within the cut, for a check of the
        sample rate. If no block starts within it, both stamps belong to the block with the first
        sample.
        """
        covering = [
            part for part in self._parts if part.end > start and part.telemetry.first_index < stop
        ]
        first = covering[0]
        offset = start - first.telemetry.first_index
        begins_in = first.block_stamp(_last_at_most(first.offsets, offset))
        telemetry = excerpt((part.telemetry for part in covering), start, stop, omitted)
        stamp_ns = begins_in.stamp_ns + elapsed_ns(
            telemetry.sample_period, begins_in.first_index, start - begins_in.first_index
        )
        inside = [
            part.block_stamp(block)
            for part in (*covering[:2], covering[-1])
            for block in range(len(part.offsets))
            if start <= part.telemetry.first_index + part.offsets[block] < stop
        ]
        if not inside:
            inside = [begins_in]
        return replace(telemetry, stamp_ns=stamp_ns), inside[0], inside[-1]


def _last_at_most(offsets: "array[int]", offset: int) -> int:
    return max(number for number, value in enumerate(offsets) if value <= offset)
