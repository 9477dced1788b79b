"""MCAP files made after the specification (https://mcap.dev/spec), record by record.

They are made here and not by a library, so that each kind of file that the specification allows
can be made, and each that it does not. ``EXAMPLES`` and ``FEATURES`` are those of the files by
which the project of MCAP tests its own readers; these files themselves are not used.
"""

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, combinations
from typing import Final

import lz4.frame
import zstandard
from mcap.opcode import Opcode

MAGIC: Final = b"\x89MCAP0\r\n"
PADDING: Final = b"\x01\x02\x03"
"""What stands behind the fields of a record that is extended; readers pass over it."""

FEATURES: Final = ("ch", "mx", "st", "rsh", "rch", "ax", "mdx", "chx", "sum", "pad")
"""Chunks; indices of messages; statistics; schemas and channels repeated in the summary; indices of
attachments, of metadata and of chunks; offsets of the summary; extended records."""

_PACK: Final = {
    "": lambda data: data,
    "zstd": zstandard.ZstdCompressor().compress,
    "lz4": lz4.frame.compress,
}


@dataclass(frozen=True)
class Schema:
    """Definition of a type."""

    id: int
    name: str
    encoding: str
    data: bytes

    def record(self, padding: bytes = b"") -> bytes:
        """Return the record."""
        head = struct.pack("<H", self.id) + _text(self.name) + _text(self.encoding)
        return _record(Opcode.SCHEMA, head + _sized(self.data) + padding)


@dataclass(frozen=True)
class Channel:
    """A topic; ``schema_id`` 0: without a schema."""

    id: int
    schema_id: int
    topic: str
    message_encoding: str
    metadata: Mapping[str, str] = field(default_factory=dict)

    def record(self, padding: bytes = b"") -> bytes:
        """Return the record."""
        head = struct.pack("<HH", self.id, self.schema_id) + _text(self.topic)
        content = head + _text(self.message_encoding) + _texts(self.metadata)
        return _record(Opcode.CHANNEL, content + padding)


@dataclass(frozen=True)
class Message:
    """A message."""

    channel_id: int
    sequence: int
    log_time: int
    publish_time: int
    data: bytes

    def record(self) -> bytes:
        """Return the record; whatever follows its fields is its data."""
        head = struct.pack(
            "<HIQQ", self.channel_id, self.sequence, self.log_time, self.publish_time
        )
        return _record(Opcode.MESSAGE, head + self.data)


@dataclass(frozen=True)
class Attachment:
    """A file within the file."""

    log_time: int
    create_time: int
    name: str
    media_type: str
    data: bytes

    def record(self, padding: bytes = b"") -> bytes:
        """Return the record."""
        head = struct.pack("<QQ", self.log_time, self.create_time)
        head += _text(self.name) + _text(self.media_type)
        content = head + struct.pack("<Q", len(self.data)) + self.data
        return _record(
            Opcode.ATTACHMENT, content + struct.pack("<I", zlib.crc32(content)) + padding
        )


@dataclass(frozen=True)
class Metadata:
    """Texts by name."""

    name: str
    metadata: Mapping[str, str]

    def record(self, padding: bytes = b"") -> bytes:
        """Return the record."""
        return _record(Opcode.METADATA, _text(self.name) + _texts(self.metadata) + padding)


@dataclass(frozen=True)
class Content:
    """What a file holds, whatever its form."""

    schemas: Sequence[Schema] = ()
    channels: Sequence[Channel] = ()
    messages: Sequence[Message] = ()
    attachments: Sequence[Attachment] = ()
    metadata: Sequence[Metadata] = ()
    profile: str = ""

    def features(self) -> Iterator[frozenset[str]]:
        """Yield the sets of features that make a difference for it."""
        known = {"st", "sum", "pad"}
        known |= {"ch", "mx", "chx", "rch"} if self.messages else set()
        known |= {"rsh"} if self.schemas else set()
        known |= {"ax"} if self.attachments else set()
        known |= {"mdx"} if self.metadata else set()
        names = [name for name in FEATURES if name in known]
        for chosen in chain.from_iterable(combinations(names, n) for n in range(len(names) + 1)):
            if "ch" in chosen or not {"mx", "chx"} & {*chosen}:
                yield frozenset(chosen)


def _example(messages: Sequence[Message], *, schema: bool = True) -> Content:
    schemas = [Schema(1, "Example", "c", b"\x04\x05\x06")] if schema else []
    channel = (
        Channel(1, 1, "example", "a", {"foo": "bar"})
        if schema
        else Channel(1, 0, "example", "text")
    )
    return Content(schemas, [channel], messages)


_TEN = ((0, 0), (2, 1), (1, 2), (3, 3), (3, 4), (5, 5), (4, 6), (7, 7), (8, 8), (9, 9))
EXAMPLES: Final = {
    "NoData": Content(),
    "OneMessage": _example([Message(1, 10, 2, 1, b"\x01\x02\x03")]),
    "OneSchemalessMessage": _example([Message(1, 10, 2, 1, b"\x01\x02\x03")], schema=False),
    "TenMessages": _example([Message(1, n, t, t, b"\x01\x02\x03") for t, n in _TEN]),
    "OneAttachment": Content(
        attachments=[Attachment(2, 1, "myFile", "application/octet-stream", b"\x01\x02\x03")]
    ),
    "OneMetadata": Content(metadata=[Metadata("myMetadata", {"foo": "bar"})]),
}
"""What the files of MCAP's own tests hold, by their name."""


def mcap_file(
    content: Content,
    features: frozenset[str] = frozenset(FEATURES) - {"pad"},
    compression: str = "",
    messages_a_chunk: int = 0,
) -> bytes:
    """Return a whole file.

    Parameters
    ----------
    features
        Of ``FEATURES``.
    compression
        Of its chunks: none, "zstd" or "lz4".
    messages_a_chunk
        How many messages a chunk has; 0: all in one.
    """
    padding = PADDING if "pad" in features else b""
    header = _text(content.profile) + _text("")
    data = bytearray(MAGIC + _record(Opcode.HEADER, header + padding))
    indices: dict[str, list[bytes]] = {"ax": [], "mdx": [], "chx": []}
    if "ch" in features:
        size = messages_a_chunk or max(len(content.messages), 1)
        for start in range(0, len(content.messages), size):
            part = content.messages[start : start + size]
            indices["chx"].append(
                _add_chunk(data, content, part, features, compression, is_first=start == 0)
            )
    else:
        defined = chain(content.schemas, content.channels)
        data += b"".join(item.record(padding) for item in defined)
        data += b"".join(item.record() for item in content.messages)
    for item in content.attachments:
        record = item.record(padding)
        indices["ax"].append(_attachment_index(item, len(data), len(record), padding))
        data += record
    for item in content.metadata:
        record = item.record(padding)
        place = struct.pack("<QQ", len(data), len(record)) + _text(item.name)
        indices["mdx"].append(_record(Opcode.METADATA_INDEX, place + padding))
        data += record
    data += _record(Opcode.DATA_END, struct.pack("<I", zlib.crc32(data)) + padding)
    return bytes(data) + _summary(content, features, indices, len(data), padding)


def _add_chunk(
    data: bytearray,
    content: Content,
    part: Sequence[Message],
    features: frozenset[str],
    compression: str,
    *,
    is_first: bool,
) -> bytes:
    """Add a chunk and its indices of messages; return the index of the chunk."""
    padding = PADDING if "pad" in features else b""
    records, offsets = bytearray(), dict[int, list[tuple[int, int]]]()
    if is_first:
        records += b"".join(item.record() for item in chain(content.schemas, content.channels))
    for item in part:
        offsets.setdefault(item.channel_id, []).append((item.log_time, len(records)))
        records += item.record()
    times = [item.log_time for item in part]
    packed = _PACK[compression](bytes(records))
    head = struct.pack("<QQQI", min(times), max(times), len(records), zlib.crc32(records))
    start = len(data)
    data += _record(
        Opcode.CHUNK, head + _text(compression) + struct.pack("<Q", len(packed)) + packed
    )
    length, places = len(data) - start, {}
    if "mx" in features:
        for channel, entries in offsets.items():
            places[channel] = len(data)
            array = b"".join(struct.pack("<QQ", *entry) for entry in sorted(entries))
            index = struct.pack("<H", channel) + _sized(array)
            data += _record(Opcode.MESSAGE_INDEX, index + padding)
    index_length = len(data) - start - length
    index = struct.pack("<QQQQ", min(times), max(times), start, length)
    index += _sized(b"".join(struct.pack("<HQ", *place) for place in places.items()))
    index += struct.pack("<Q", index_length) + _text(compression)
    index += struct.pack("<QQ", len(packed), len(records))
    return _record(Opcode.CHUNK_INDEX, index + padding)


def _attachment_index(item: Attachment, offset: int, length: int, padding: bytes) -> bytes:
    content = struct.pack("<QQQQQ", offset, length, item.log_time, item.create_time, len(item.data))
    content += _text(item.name) + _text(item.media_type)
    return _record(Opcode.ATTACHMENT_INDEX, content + padding)


def _summary(
    content: Content,
    features: frozenset[str],
    indices: Mapping[str, Sequence[bytes]],
    start: int,
    padding: bytes,
) -> bytes:
    """Return all that follows the data."""
    groups: list[tuple[Opcode, list[bytes]]] = []
    if "rsh" in features:
        groups.append((Opcode.SCHEMA, [item.record(padding) for item in content.schemas]))
    if "rch" in features:
        groups.append((Opcode.CHANNEL, [item.record(padding) for item in content.channels]))
    if "st" in features:
        chunks = len(indices["chx"])
        groups.append((Opcode.STATISTICS, [_statistics(content, chunks, padding)]))
    for name, opcode in (
        ("mdx", Opcode.METADATA_INDEX),
        ("ax", Opcode.ATTACHMENT_INDEX),
        ("chx", Opcode.CHUNK_INDEX),
    ):
        if name in features:
            groups.append((opcode, list(indices[name])))
    summary, offsets = bytearray(), bytearray()
    for opcode, records in groups:
        group = b"".join(records)
        if group:
            place = struct.pack("<BQQ", opcode, start + len(summary), len(group))
            offsets += _record(Opcode.SUMMARY_OFFSET, place + padding)
            summary += group
    offset_start = 0
    if "sum" in features and offsets:
        offset_start = start + len(summary)
        summary += offsets
    summary += struct.pack("<BQ", Opcode.FOOTER, 20)
    has_summary = bool(groups) and any(records for _, records in groups)
    summary += struct.pack("<QQ", start if has_summary else 0, offset_start)
    return bytes(summary + struct.pack("<I", zlib.crc32(summary)) + MAGIC)


def _statistics(content: Content, chunks: int, padding: bytes) -> bytes:
    times = [item.log_time for item in content.messages] or [0]
    counts: dict[int, int] = {}
    for item in content.messages:
        counts[item.channel_id] = counts.get(item.channel_id, 0) + 1
    record = struct.pack(
        "<QHIIIIQQ",
        len(content.messages),
        len(content.schemas),
        len(content.channels),
        len(content.attachments),
        len(content.metadata),
        chunks,
        min(times),
        max(times),
    )
    record += _sized(b"".join(struct.pack("<HQ", *one) for one in counts.items()))
    return _record(Opcode.STATISTICS, record + padding)


def _record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def _sized(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


def _text(text: str) -> bytes:
    return _sized(text.encode())


def _texts(texts: Mapping[str, str]) -> bytes:
    return _sized(b"".join(_text(name) + _text(value) for name, value in texts.items()))
