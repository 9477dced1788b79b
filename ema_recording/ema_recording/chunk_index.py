"""The index of the chunks of a file that is being written: read from the file when it is closed.

The writer of mcap keeps what it is to write of each chunk in memory until then, 2.5 kB each, and
a recorder writes several chunks a second, for days.
"""

import struct
from collections.abc import Iterator
from typing import Any, Final

from mcap.opcode import Opcode
from mcap.records import ChunkIndex
from mcap.writer import Writer

from ema_recording.held_file import HeldFile, Read
from ema_recording.records import MAGIC

_HEAD: Final = struct.Struct("<BQ")
_CHUNK: Final = struct.Struct("<QQQII")
_LENGTH: Final = struct.Struct("<Q")
_CHANNEL: Final = struct.Struct("<H")


def index_when_closed(writer: Writer, file: HeldFile) -> None:
    """Let a writer keep nothing of its chunks; it reads them again in ``finish``.

    Parameters
    ----------
    writer
        A writer that has written no chunk so far.
    file
        What it writes to.

    Raises
    ------
    ValueError
        When it has.
    """
    # mcap has no name for it; tests/ros/test_recording_writer.py fails where it has another one.
    name = "_Writer__chunk_indices"
    if getattr(writer, name) != []:
        raise ValueError("the writer has chunks already: expected a new one")
    setattr(writer, name, _WrittenChunks(file))


def chunk_indices(read: Read, size: int) -> Iterator[ChunkIndex]:
    """Return the index of each chunk of an MCAP file, by the heads of its records.

    Parameters
    ----------
    read
        Reads from an offset so many bytes.
    size
        How many there are [B]; a record that is cut off there ends it.
    """
    offset, index = len(MAGIC), None
    while offset + _HEAD.size <= size:
        opcode, length = _HEAD.unpack(read(offset, _HEAD.size))
        content, end = offset + _HEAD.size, offset + _HEAD.size + length
        if end > size:
            break
        if opcode == Opcode.MESSAGE_INDEX and index is not None:
            (channel,) = _CHANNEL.unpack(read(content, _CHANNEL.size))
            index.message_index_offsets[channel] = offset
            index.message_index_length = end - index.chunk_start_offset - index.chunk_length
        elif index is not None:
            yield index
            index = None
        if opcode == Opcode.CHUNK:
            index = _chunk(read, offset, end)
        offset = end
    if index is not None:
        yield index


def _chunk(read: Read, offset: int, end: int) -> ChunkIndex:
    content = offset + _HEAD.size
    first_ns, last_ns, size, _, letters = _CHUNK.unpack(read(content, _CHUNK.size))
    compression = read(content + _CHUNK.size, letters).decode()
    (compressed,) = _LENGTH.unpack(read(content + _CHUNK.size + letters, _LENGTH.size))
    return ChunkIndex(
        chunk_length=end - offset,
        chunk_start_offset=offset,
        compression=compression,
        compressed_size=compressed,
        message_end_time=last_ns,
        message_index_length=0,
        message_index_offsets={},
        message_start_time=first_ns,
        uncompressed_size=size,
    )


class _WrittenChunks:
    """Stands for the list of the chunks' indices."""

    def __init__(self, file: HeldFile) -> None:
        self._file = file

    def append(self, _: Any) -> None:
        """Keep nothing."""

    def __iter__(self) -> Iterator[ChunkIndex]:
        """Read them from the file."""
        size = self._file.tell()
        return chunk_indices(self._file.reader(), size)
