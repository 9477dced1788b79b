"""Records of MCAP files, whole or refused. https://mcap.dev/spec describes them."""

import io
import struct
from collections.abc import Iterator
from typing import Any, BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk

from ema_recording.packed import PackedError, unpack_chunk

MAGIC = b"\x89MCAP0\r\n"
LIBRARY = "ema_recording"
"""How the library in the header of our own files begins; all of their chunks have a checksum."""
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_MOST_BYTES = 1 << 30


class DamageError(Exception):
    """Something in a file is cut off or not what it should be."""


class McapRecord(NamedTuple):
    """A record: where it begins and ends in its file, its opcode and its content."""

    offset: int
    end: int
    opcode: int
    content: bytes


class StoredMessage(NamedTuple):
    """A message as it is stored."""

    channel: int
    log_time_ns: int
    publish_time_ns: int
    data: bytes


def read_records(file: BinaryIO, start: int, stop: int) -> Iterator[McapRecord]:
    """Read the records between two offsets; attachments have no content here.

    Raises
    ------
    DamageError
        When a record is not whole.
    """
    if start >= stop:
        return
    if start >= stop:
        return
    file.seek(start)
    offset = start
    while offset < stop:
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            raise DamageError("the head of a record is cut off")
        opcode, length = _HEAD.unpack(head)
        if opcode == 0:
            raise DamageError("no record begins there")
        end = offset + _HEAD.size + length
        if end > stop:
            raise DamageError(f"a record of {length} bytes is cut off")
        if opcode == Opcode.ATTACHMENT:  # of any size, and not wanted
            file.seek(end)
            content = b""
        elif length > _MOST_BYTES:
            raise DamageError(f"a record of {length} bytes, expected at most {_MOST_BYTES}")
        else:
            content = file.read(length)
            if len(content) < length:
                raise DamageError(f"a record of {length} bytes is cut off")
        yield McapRecord(offset, end, opcode, content)
        offset = end


def parse(kind: Any, content: bytes) -> Any:
    """Return a record's content as one of the classes of ``mcap.records``.

    Raises
    ------
    DamageError
        When the content is not of that kind.
    """
    try:
        return kind.read(ReadDataStream(io.BytesIO(content)))
    except (McapError, struct.error, UnicodeDecodeError, OverflowError) as error:
        raise DamageError(f"not a {kind.__name__} record: {error}") from error


def parse_message(content: bytes) -> StoredMessage:
    """Return the message that a record holds.

    Raises
    ------
    DamageError
        When the record is too short.
    """
    if len(content) < _MESSAGE.size:
        raise DamageError(f"a message record of {len(content)} bytes")
    channel, _, log_time_ns, publish_time_ns = _MESSAGE.unpack_from(content)
    return StoredMessage(channel, log_time_ns, publish_time_ns, content[_MESSAGE.size :])


def unpack(record: McapRecord, *, needs_checksum: bool = False) -> list[McapRecord]:
    """Return the records in a chunk, or the record itself when it is none.

    Parameters
    ----------
    needs_checksum
        Whether the writer of the file gave every chunk a checksum.

    Raises
    ------
    DamageError
        When the chunk cannot be unpacked, or its checksum is wrong or missing.
    UnknownCompressionError
        When it is compressed in a way that is not read here.
    """
    if record.opcode != Opcode.CHUNK:
        return [record]
    chunk = parse(Chunk, record.content)
    if needs_checksum and not chunk.uncompressed_crc and chunk.uncompressed_size:
        raise DamageError("its checksum is 0, where the writer of the file gives each chunk one")
    try:
        data = unpack_chunk(chunk)
    except PackedError as error:
        raise DamageError(str(error)) from error
    records = list(read_records(io.BytesIO(data), 0, len(data)))
    if any(one.opcode == Opcode.CHUNK for one in records):
        raise DamageError("a chunk is in it, expected schemas, channels and messages")
    return records
