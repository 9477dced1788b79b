# SPDX-License-Identifier: Apache-2.0
"""Reading of the contents of an MCAP file, from its index or its intact part.

The records are parsed by the library mcap, whose readers refuse truncated files and files without
an index. A killed recorder leaves such files; this module reads them.
"""

import io
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO, Final

import zstandard
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.reader import FOOTER_SIZE, SeekingReader
from mcap.records import Channel, Chunk, DataEnd, Footer, Header, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk

from ema_bags.gaps import GAP, Gap
from ema_bags.recording import CONVERT

_MAGIC: Final = b"\x89MCAP0\r\n"
# The end of a file, at which the reader of mcap stops.
_END: Final = bytes([Opcode.FOOTER]) + (20).to_bytes(8, "little") + bytes(20) + _MAGIC
_LZ4_MAGIC: Final = b"\x04\x22\x4d\x18"
_COMPRESSIONS: Final = ("", "zstd", "lz4")
_CHUNK_HEAD_BYTES: Final = 9 + 40
_STRETCH_BYTES: Final = 1 << 20
_MOST_BYTES: Final = 1 << 30
# Errors of mcap and lz4, and of impossible lengths, in damaged records.
_FAILURES: Final = (
    *(McapError, zstandard.ZstdError, struct.error, UnicodeDecodeError),
    *(RuntimeError, EOFError, OverflowError, MemoryError),
)


class DamageError(Exception):
    """A part of a file is truncated or invalid."""


@dataclass(eq=False)
class Stretch:
    """A range of bytes with messages: a chunk, or consecutive messages outside of chunks."""

    offset: int
    """Position of the first byte in the file."""

    stop: int
    """Position after the last byte in the file."""

    start_ns: int = 2**64
    """Earliest log time of its messages [ns]."""

    end_ns: int = 0
    """Latest log time of its messages [ns]."""

    channels: set[int] = field(default_factory=set)
    """Channels of its messages; empty if unknown."""


@dataclass(eq=False)
class Contents:
    """Contents of an MCAP file."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    """Schemas by their number."""

    channels: dict[int, Channel] = field(default_factory=dict)
    """Channels by their number."""

    counts: Counter[int] = field(default_factory=Counter)
    """Number of messages by channel."""

    stretches: list[Stretch] = field(default_factory=list)
    """Ranges of bytes with messages, in the order of the file."""

    damage: list[str] = field(default_factory=list)
    """Description of each defect of the file."""

    library: str = ""
    """Program that wrote the file, from its header."""

    gaps: list[Gap] = field(default_factory=list)
    """Messages that the recorder could not record."""

    is_whole: bool = True
    """Whether no message is lost; a damaged index alone loses none."""

    def define(self, record: object) -> None:
        """Add a schema or channel, which must not differ from an earlier definition."""
        if isinstance(record, Schema):
            if self.schemas.setdefault(record.id, record) != record:
                raise DamageError(f"schema {record.id} has two different definitions")
        elif isinstance(record, Channel):
            first = self.channels.setdefault(record.id, record)
            if first != record:
                raise DamageError(
                    f"channel {record.id} is {record.topic} here, but {first.topic} elsewhere"
                )

    def note_gap(self, record: Metadata) -> None:
        """Add the gap in a metadata record of a recorder; further records are ignored."""
        if record.name != GAP:
            return
        try:
            self.gaps.append(Gap.from_metadata(record.metadata))
        except (KeyError, ValueError) as error:
            raise DamageError(f"not a gap record: {error!r}") from error


def read_contents(file: BinaryIO) -> Contents:
    """Return the contents of a file, which may be truncated anywhere.

    Raises
    ------
    ValueError
        If the file is empty or not an MCAP file, or has chunks in a compression other than zstd
        and lz4.
    """
    size = file.seek(0, io.SEEK_END)
    if size == 0:
        raise ValueError("is an empty file: expected an MCAP file")
    file.seek(0)
    begin = file.read(len(_MAGIC))
    if not _MAGIC.startswith(begin):
        remedy = (
            f"a bag in sqlite3 storage; {CONVERT}"
            if begin == b"SQLite f"
            else f"a file compressed by lz4; {CONVERT}"
            if begin.startswith(_LZ4_MAGIC)
            else ("it may be a table or another kind of bag: `ema check FILE` shows how to read it")
        )
        raise ValueError(f"is not an MCAP file: it starts with {begin!r} ({remedy})")
    is_whole = True
    try:
        with _damage():
            if contents := _by_index(file, size):
                return contents
    except DamageError:
        is_whole = False
    return _by_reading(file, size, index_is_whole=is_whole)


def read_messages(path: Path, stretch: Stretch, contents: Contents) -> list[Message]:
    """Read the messages of a stretch in the order of the file; short stretches are cached.

    Raises
    ------
    DamageError
        If the stretch is damaged, or redefines a schema or channel of the file.
    """
    read = _messages if stretch.stop - stretch.offset <= _STRETCH_BYTES else _messages.__wrapped__
    return read(path, stretch, contents)


@lru_cache(maxsize=8)
def _messages(path: Path, stretch: Stretch, contents: Contents) -> list[Message]:
    with path.open("rb") as file:
        file.seek(stretch.offset)
        data = file.read(stretch.stop - stretch.offset)
    if len(data) < stretch.stop - stretch.offset:
        raise DamageError("it is truncated")
    messages = []
    with _damage():
        reader = StreamReader(io.BytesIO(data + _END), skip_magic=True, validate_crcs=True)
        for record in reader.records:
            if isinstance(record, Message):
                messages.append(record)
            else:
                contents.define(record)
    return messages


@contextmanager
def _damage() -> Iterator[None]:
    """Convert errors that mcap raises for damaged records to DamageError."""
    try:
        yield
    except CRCValidationError as error:
        raise DamageError(str(error)) from error
    except EndOfFile as error:
        raise DamageError("a record is truncated") from error
    except _FAILURES as error:
        raise DamageError(f"{type(error).__name__} {error}".strip()) from error


def _by_index(file: BinaryIO, size: int) -> Contents | None:
    """Return the contents from the summary; None if the summary is incomplete."""
    _check_summary(file, size)
    file.seek(0)
    reader = SeekingReader(file, record_size_limit=_MOST_BYTES)
    header, summary = reader.get_header(), reader.get_summary()
    if summary is None or summary.statistics is None:
        return None
    contents = Contents(summary.schemas, summary.channels, library=header.library)
    contents.counts.update(summary.statistics.channel_message_counts)
    for chunk in summary.chunk_indexes:
        _check_compression(chunk.compression)
        stop = chunk.chunk_start_offset + chunk.chunk_length
        times = chunk.message_start_time, chunk.message_end_time
        channels = set(chunk.message_index_offsets)
        contents.stretches.append(Stretch(chunk.chunk_start_offset, stop, *times, channels))
    schemas = {channel.schema_id for channel in contents.channels.values()} - {0}
    if (
        len(contents.stretches) != summary.statistics.chunk_count
        or contents.counts.total() != summary.statistics.message_count
        or (contents.counts.total() and not contents.stretches)
        or any(stretch.stop > size for stretch in contents.stretches)
        or not contents.counts.keys() <= contents.channels.keys()
        or not schemas <= contents.schemas.keys()
    ):
        return None
    for record in reader.iter_metadata():
        contents.note_gap(record)
    return contents


def _check_summary(file: BinaryIO, size: int) -> None:
    """Compare the summary with its checksum, which the reader of mcap does not check."""
    footer_at = size - FOOTER_SIZE - len(_MAGIC)
    file.seek(max(footer_at, 0))
    footer = file.read(FOOTER_SIZE)
    if footer_at < len(_MAGIC) or footer[0] != Opcode.FOOTER or file.read() != _MAGIC:
        raise DamageError("the footer is missing")
    start, _, checksum = struct.unpack_from("<QQI", footer, 9)
    if start and checksum:
        file.seek(start)
        data = file.read(max(footer_at - start, 0))
        if zlib.crc32(data + footer[:-4]) != checksum:
            raise DamageError("the checksum of the index is wrong")


def _by_reading(file: BinaryIO, size: int, *, index_is_whole: bool) -> Contents:
    """Return the contents of the intact part, by reading the whole file."""
    contents = Contents()
    file.seek(0)
    records = StreamReader(file, emit_chunks=True, record_size_limit=_MOST_BYTES).records
    end, broken = len(_MAGIC), f"it was not closed and ends at byte {size}"
    while True:
        start = file.tell()
        try:
            with _damage():
                record = next(records)
        except (DamageError, StopIteration) as error:
            if end < size:
                broken = f"it is damaged at byte {end} of {size}: {error}"
            break
        end = file.tell()
        if isinstance(record, DataEnd | Footer):
            broken = ""
            break
        if isinstance(record, Chunk):
            # The reader omits records of unknown kinds, which precede this chunk.
            start = end - _CHUNK_HEAD_BYTES - len(record.compression) - len(record.data)
        try:
            with _damage():
                _add(contents, record, start, end)
        except DamageError as error:
            kind = "chunk" if isinstance(record, Chunk) else "record"
            contents.damage.append(f"the {kind} at byte {start} is lost: {error}")
    for number in contents.counts.keys() - contents.channels.keys():
        lost = contents.counts.pop(number)
        contents.damage.append(
            f"{lost} messages of channel {number} are lost: the channel is not defined"
        )
    for channel in contents.channels.values():
        if channel.schema_id and channel.schema_id not in contents.schemas:
            contents.damage.append(
                f"topic {channel.topic} has no type: schema {channel.schema_id} is not defined"
            )
    contents.is_whole = not (broken or contents.damage)
    if broken:
        contents.damage.append(f"{broken}; {_intact(contents)}; any later messages are lost")
    elif not index_is_whole:
        contents.damage.append(f"its index is damaged; {_intact(contents)}, no message is lost")
    return contents


def _add(contents: Contents, record: object, start: int, end: int) -> None:
    """Add a record of the data section, from ``start`` to ``end`` in its file."""
    records = [record]
    if isinstance(record, Header):
        contents.library = record.library
    elif isinstance(record, Metadata):
        contents.note_gap(record)
    elif isinstance(record, Chunk):
        _check_compression(record.compression)
        records = breakup_chunk(record, validate_crc=True)
    for inner in records:
        contents.define(inner)
    messages = [inner for inner in records if isinstance(inner, Message)]
    if not messages:
        return
    last = contents.stretches[-1] if contents.stretches else None
    continues = last is not None and last.stop == start and not isinstance(record, Chunk)
    if last is None or not continues or end - last.offset > _STRETCH_BYTES:
        last = Stretch(start, end)
        contents.stretches.append(last)
    last.stop = end
    for message in messages:
        last.start_ns = min(last.start_ns, message.log_time)
        last.end_ns = max(last.end_ns, message.log_time)
        last.channels.add(message.channel_id)
        contents.counts[message.channel_id] += 1


def _check_compression(name: str) -> None:
    if name not in _COMPRESSIONS:
        raise ValueError(
            f"has chunks compressed by {name!r}, expected 'zstd', 'lz4' or none; rewrite it by "
            "`mcap compress --compression zstd`"
        )


def _intact(contents: Contents) -> str:
    if not contents.stretches:
        return "no intact message"
    last = max(stretch.end_ns for stretch in contents.stretches)
    seconds = f"{last // 10**9}.{last % 10**9:09d}"
    return f"{contents.counts.total()} messages are intact, up to log time {seconds} s"
