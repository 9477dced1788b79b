"""The index of the chunks of a file that is being written, in little memory until it is closed.

The writer of mcap keeps what it is to write of each chunk as objects, 2.5 kB each, and a recorder
writes several chunks a second, for days. Packed, as here, it is about 25 B of each.
"""

import zlib
from array import array
from collections.abc import Iterator
from itertools import chain
from typing import Final

from mcap.records import ChunkIndex
from mcap.writer import Writer

_BLOCK: Final = 256
_LEVEL: Final = 6


def keep_packed_index(writer: Writer) -> None:
    """Let a writer keep what it is to write of each chunk as ``PackedChunkIndices``.

    Parameters
    ----------
    writer
        A writer that has written no chunk so far.

    Raises
    ------
    ValueError
        When it has.
    """
    # mcap has no name for it; tests/ros/test_recording_writer.py fails where it has another one.
    name = "_Writer__chunk_indices"
    if getattr(writer, name) != []:
        raise ValueError("the writer has chunks already: expected a new one")
    setattr(writer, name, PackedChunkIndices())


class PackedChunkIndices:
    """Stands for a list of the indices of chunks of one compression, in their order in a file.

    What is kept of a chunk are differences to the one before it, most of which are small.
    """

    def __init__(self) -> None:
        self._packed: list[bytes] = []
        self._block = array("q")
        self._in_block = 0
        self._compression = ""
        self._last = _NOTHING

    def append(self, index: ChunkIndex) -> None:
        """Add the index of the next chunk."""
        self._compression = index.compression
        self._block.extend(_differences(index, self._last))
        self._last = index
        self._in_block += 1
        if self._in_block == _BLOCK:
            self._packed.append(zlib.compress(self._block.tobytes(), _LEVEL))
            self._block, self._in_block = array("q"), 0

    def __iter__(self) -> Iterator[ChunkIndex]:
        """Give them in their order."""
        last = _NOTHING
        for block in chain(map(_unpacked, self._packed), [self._block]):
            values = iter(block)
            for first in values:
                last = _index(first, values, last, self._compression)
                yield last


_NOTHING: Final = ChunkIndex(
    chunk_length=0,
    chunk_start_offset=0,
    compression="",
    compressed_size=0,
    message_end_time=0,
    message_index_length=0,
    message_index_offsets={},
    message_start_time=0,
    uncompressed_size=0,
)


def _unpacked(block: bytes) -> "array[int]":
    return array("q", zlib.decompress(block))


def _differences(index: ChunkIndex, last: ChunkIndex) -> list[int]:
    """Return an index in numbers, most of which are small."""
    values = [
        index.message_start_time - last.message_end_time,
        index.message_end_time - index.message_start_time,
        index.chunk_start_offset - _end(last),
        index.compressed_size,
        index.chunk_length - index.compressed_size,
        index.uncompressed_size - last.uncompressed_size,
        index.message_index_length,
        len(index.message_index_offsets),
    ]
    before = index.chunk_start_offset + index.chunk_length
    for channel, offset in index.message_index_offsets.items():
        values += (channel, offset - before)
        before = offset
    return values


def _index(first: int, values: Iterator[int], last: ChunkIndex, compression: str) -> ChunkIndex:
    """Return the index of which ``_differences`` made numbers."""
    start_ns = last.message_end_time + first
    end_ns = start_ns + next(values)
    offset = _end(last) + next(values)
    compressed = next(values)
    length = compressed + next(values)
    uncompressed = last.uncompressed_size + next(values)
    index_length, channels = next(values), next(values)
    offsets: dict[int, int] = {}
    before = offset + length
    for _ in range(channels):
        channel = next(values)
        before += next(values)
        offsets[channel] = before
    return ChunkIndex(
        chunk_length=length,
        chunk_start_offset=offset,
        compression=compression,
        compressed_size=compressed,
        message_end_time=end_ns,
        message_index_length=index_length,
        message_index_offsets=offsets,
        message_start_time=start_ns,
        uncompressed_size=uncompressed,
    )


def _end(index: ChunkIndex) -> int:
    """Return where the records of a chunk end in the file [B]."""
    return index.chunk_start_offset + index.chunk_length + index.message_index_length
