"""What an MCAP file holds: by its index, or by reading it through where that is damaged."""

import io
import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from ema_recording.gaps import GAP, Gap
from ema_recording.packed import check_compression
from ema_recording.records import (
    LIBRARY,
    MAGIC,
    DamageError,
    McapRecord,
    StoredMessage,
    parse,
    parse_message,
    read_records,
    unpack,
)

_FOOTER = struct.Struct("<BQQQI")
_FOOTER_HEAD = (Opcode.FOOTER, 20)
_CHECKSUM_BYTES = 4
_RECORD_HEAD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_TAIL_BYTES = _FOOTER.size + len(MAGIC)
_STRETCH_BYTES = 1 << 20
_READ_BYTES = 1 << 20


@dataclass
class Stretch:
    """A run of bytes that holds messages: a chunk, or messages side by side outside of chunks.

    ``channels`` are those that have messages in it, empty where that is not known; log times of
    the messages lie from ``start_ns`` to ``end_ns``.
    """

    offset: int
    stop: int
    start_ns: int = 2**64
    end_ns: int = 0
    channels: set[int] = field(default_factory=set)


@dataclass
class Contents:
    """What an MCAP file holds.

    Attributes
    ----------
    stretches
        Where the messages are, in the order of the file.
    damage
        What is wrong with the file, one item per defect.
    library
        What its header says of the program that wrote it.
    gaps
        What its recorder could not write, and times in which it received nothing.
    has_checksums
        Whether the writer of the file gave every chunk a checksum.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    stretches: list[Stretch] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)
    library: str = ""
    gaps: list[Gap] = field(default_factory=list)
    has_checksums: bool = False


def read_contents(file: BinaryIO) -> Contents:
    """Find out what a file holds.

    Parameters
    ----------
    file
        An MCAP file; it may be cut off anywhere.

    Raises
    ------
    ValueError
        When the file is empty, not an MCAP file, or has chunks that are compressed in a way that
        is not read here.
    """
    size = file.seek(0, io.SEEK_END)
    if size == 0:
        raise ValueError("is empty: expected an MCAP file")
    file.seek(0)
    begin = file.read(len(MAGIC))
    if not MAGIC.startswith(begin):
        raise ValueError(f"is not an MCAP file: it begins with {begin!r}")
    library = _library(file, size)
    is_own = (library or "").startswith(LIBRARY)
    has_checksums = is_own or _has_checksums(file, size)
    summary = _read_summary(file, size, needs_checksum=is_own)
    indexed, index_is_whole = None, summary is not None
    try:
        indexed = _indexed(file, summary, size) if summary else None
    except DamageError:
        index_is_whole = False
    contents = indexed or _read_through(
        file, size, index_is_whole=index_is_whole, needs_checksum=has_checksums
    )
    if library is None:
        contents.damage.append("it does not begin with a header")
    contents.library, contents.has_checksums = library or "", has_checksums
    return contents


def read_messages(file: BinaryIO, stretch: Stretch, contents: Contents) -> list[StoredMessage]:
    """Read the messages of a stretch of a file, in their order there.

    Parameters
    ----------
    contents
        What the file holds: a chunk is damaged that defines a schema or channel otherwise, or has
        no checksum where others have.

    Raises
    ------
    DamageError
        When it is not whole.
    """
    messages = []
    for outer in read_records(file, stretch.offset, stretch.stop):
        for record in unpack(outer, needs_checksum=contents.has_checksums):
            if record.opcode == Opcode.MESSAGE:
                messages.append(parse_message(record.content))
            else:
                _define(contents, record)
    return messages


def _library(file: BinaryIO, size: int) -> str | None:
    """Return the library that the header names, empty where it is damaged; None without one."""
    try:
        first = next(read_records(file, len(MAGIC), size), None)
        if first is not None and first.opcode == Opcode.HEADER:
            return parse(Header, first.content).library
    except DamageError:
        return ""
    return None if first is not None else ""


def _has_checksums(file: BinaryIO, size: int) -> bool:
    """Return whether any chunk has a checksum: a writer gives all of them one, or none.

    Only the heads are read, up to the first that has one.
    """
    offset = len(MAGIC)
    while offset + _RECORD_HEAD.size <= size:
        file.seek(offset)
        head = file.read(_RECORD_HEAD.size + _CHUNK_HEAD.size)
        opcode, length = _RECORD_HEAD.unpack_from(head)
        if opcode in (0, Opcode.DATA_END, Opcode.FOOTER):
            break
        if opcode == Opcode.CHUNK and len(head) == _RECORD_HEAD.size + _CHUNK_HEAD.size:
            *_, checksum = _CHUNK_HEAD.unpack_from(head, _RECORD_HEAD.size)
            if checksum:
                return True
        offset += _RECORD_HEAD.size + length
    return False


def _read_summary(file: BinaryIO, size: int, *, needs_checksum: bool) -> bytes | None:
    """Return the records after the data, ``b""`` if none; None when the end is damaged."""
    if size < len(MAGIC) + _TAIL_BYTES:
        return None
    file.seek(size - _TAIL_BYTES)
    tail = file.read(_TAIL_BYTES)
    opcode, length, start, _, checksum = _FOOTER.unpack_from(tail)
    if (opcode, length) != _FOOTER_HEAD or not tail.endswith(MAGIC):
        return None
    if start == 0:
        return b""
    if not len(MAGIC) <= start <= size - _TAIL_BYTES:
        return None
    file.seek(start)
    summary = file.read(size - _TAIL_BYTES - start)
    checked = summary + tail[: _FOOTER.size - _CHECKSUM_BYTES]
    is_checked = checksum or needs_checksum
    return None if is_checked and zlib.crc32(checked) != checksum else summary


def _indexed(file: BinaryIO, summary: bytes, size: int) -> Contents | None:
    """Return the contents of a file of a size by its summary; None where that is incomplete.

    Raises
    ------
    DamageError
        When it contradicts itself, or what it tells of is not in the file.
    """
    contents = Contents()
    statistics = None
    places: set[tuple[int, int]] = set()
    for record in read_records(io.BytesIO(summary), 0, len(summary)):
        if record.opcode == Opcode.STATISTICS:
            statistics = parse(Statistics, record.content)
        elif record.opcode == Opcode.CHUNK_INDEX:
            chunk = parse(ChunkIndex, record.content)
            check_compression(chunk.compression)
            stretch = Stretch(
                chunk.chunk_start_offset,
                chunk.chunk_start_offset + chunk.chunk_length,
                chunk.message_start_time,
                chunk.message_end_time,
                set(chunk.message_index_offsets),
            )
            if stretch.stop > size:
                raise DamageError("a chunk ends behind the file")
            contents.stretches.append(stretch)
        elif record.opcode == Opcode.METADATA_INDEX:
            place = parse(MetadataIndex, record.content)
            if place.name == GAP:
                places.add((place.offset, place.offset + place.length))
        else:
            _define(contents, record)
    _read_gaps(contents, file, places, size)
    if statistics is None:
        return None
    contents.counts.update(statistics.channel_message_counts)
    chunks = len(contents.stretches)
    if (chunks and chunks != statistics.chunk_count) or (
        contents.counts and contents.counts.total() != statistics.message_count
    ):
        raise DamageError("its parts count differently")
    schemas = {channel.schema_id for channel in contents.channels.values()} - {0}
    complete = (
        chunks == statistics.chunk_count
        and (chunks or not statistics.message_count)
        and contents.counts.total() == statistics.message_count
        and contents.counts.keys() <= contents.channels.keys()
        and schemas <= contents.schemas.keys()
    )
    return contents if complete else None


def _read_through(
    file: BinaryIO, size: int, *, index_is_whole: bool, needs_checksum: bool
) -> Contents:
    """Return the contents by reading the whole file, as far as that goes."""
    contents = Contents()
    end = len(MAGIC)
    broken = ""
    try:
        for record in read_records(file, end, size):
            end = record.end
            if record.opcode in (Opcode.DATA_END, Opcode.FOOTER):
                contents.damage += _end_damage(file, record, is_damaged=bool(contents.damage))
                break
            try:
                _add(contents, record, needs_checksum)
            except DamageError as error:
                kind = "chunk" if record.opcode == Opcode.CHUNK else "record"
                contents.damage.append(f"the {kind} at byte {record.offset} is lost: {error}")
        else:
            broken = f"it was not closed and ends at byte {size}"
    except DamageError as error:
        broken = f"it breaks off at byte {end} of {size}: {error}"
    for number in contents.counts.keys() - contents.channels.keys():
        lost = contents.counts.pop(number)
        contents.damage.append(f"{lost} messages of channel {number} are lost: it is not defined")
    for channel in contents.channels.values():
        if channel.schema_id and channel.schema_id not in contents.schemas:
            contents.damage.append(
                f"topic {channel.topic} has no type: schema {channel.schema_id} is not defined"
            )
    if broken:
        contents.damage.append(f"{broken}; {_intact(contents)}; any later messages are lost")
    elif not index_is_whole:
        contents.damage.append(f"its index is damaged; {_intact(contents)}, no message is lost")
    return contents


def _end_damage(file: BinaryIO, record: McapRecord, *, is_damaged: bool) -> list[str]:
    """Return what is wrong by the record that ends the data; damage that is known is not told."""
    if record.opcode != Opcode.DATA_END:
        return ["the end of its data is not marked"]
    checksum = parse(DataEnd, record.content).data_section_crc
    if is_damaged or not checksum:
        return []
    file.seek(0)
    found, left = 0, record.offset
    while left and (data := file.read(min(left, _READ_BYTES))):
        found, left = zlib.crc32(data, found), left - len(data)
    file.seek(record.end)
    if found == checksum:
        return []
    return ["its data is not what was written: the checksum over all of it is wrong"]


def _add(contents: Contents, record: McapRecord, needs_checksum: bool) -> None:
    """Add a record of the data section."""
    if record.opcode == Opcode.METADATA:
        _note_gap(contents, record)
        return
    records = unpack(record, needs_checksum=needs_checksum)
    for inner in records:
        _define(contents, inner)
    messages = [parse_message(inner.content) for inner in records if inner.opcode == Opcode.MESSAGE]
    if not messages:
        return
    last = contents.stretches[-1] if contents.stretches else None
    if last is None or last.stop != record.offset or record.end - last.offset > _STRETCH_BYTES:
        last = Stretch(record.offset, record.end)
        contents.stretches.append(last)
    last.stop = record.end
    for message in messages:
        last.start_ns = min(last.start_ns, message.log_time_ns)
        last.end_ns = max(last.end_ns, message.log_time_ns)
        last.channels.add(message.channel)
        contents.counts[message.channel] += 1


def _read_gaps(contents: Contents, file: BinaryIO, places: set[tuple[int, int]], size: int) -> None:
    """Add the gaps of which records tell that begin and end at some places of a file of a size.

    No byte is read twice, whatever an index says.
    """
    last = 0
    for offset, end in sorted(places):
        if offset < last:
            raise DamageError("records that tell of gaps overlap")
        last = end
        told = next(read_records(file, offset, min(end, size)), None)
        if told is None or (told.opcode, told.end) != (Opcode.METADATA, end):
            raise DamageError("no record that tells of a gap is where one should be")
        _note_gap(contents, told)


def _note_gap(contents: Contents, record: McapRecord) -> None:
    told = parse(Metadata, record.content)
    if told.name != GAP:
        return
    values = told.metadata
    try:
        start_ns, end_ns, count = (int(values[key]) for key in ("start_ns", "end_ns", "messages"))
    except (KeyError, ValueError) as error:
        raise DamageError(f"it tells of a gap, but not of which: {error}") from error
    contents.gaps.append(Gap(values.get("reason", ""), start_ns, end_ns, count))


def _define(contents: Contents, record: McapRecord) -> None:
    if record.opcode == Opcode.SCHEMA:
        schema = parse(Schema, record.content)
        if contents.schemas.setdefault(schema.id, schema) != schema:
            raise DamageError(f"schema {schema.id} is defined otherwise elsewhere")
    elif record.opcode == Opcode.CHANNEL:
        channel = parse(Channel, record.content)
        known = contents.channels.setdefault(channel.id, channel)
        if known != channel:
            raise DamageError(f"channel {channel.id} is {channel.topic} here, else {known.topic}")


def _intact(contents: Contents) -> str:
    if not contents.stretches:
        return "no message is intact"
    last = max(stretch.end_ns for stretch in contents.stretches)
    seconds = f"{last // 10**9}.{last % 10**9:09d}"
    return f"{contents.counts.total()} messages are intact, up to log time {seconds} s"
