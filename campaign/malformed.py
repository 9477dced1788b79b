"""MCAP files that break a rule of the specification, one each."""

import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from mcap.opcode import Opcode
from mcap_form import MAGIC, Content, mcap_file

_HEAD: Final = struct.Struct("<BQ")
_FOOTER_BYTES: Final = 29
_INDEXED: Final = frozenset({"ch", "mx", "st", "rsh", "rch", "chx", "sum"})
_UNINDEXED: Final = frozenset({"ch"})
_PLAIN: Final = frozenset[str]()

MAKES_OTHERS: Final = frozenset({"a bit of a message outside of chunks is turned, plain"})
"""Defects that make another message of one; the checksum over all data shows that there is one."""

_WITHOUT_MEANING: Final = frozenset(
    {
        # Where there is no index, the times of the messages themselves are used.
        "a message is later than its chunk, indexed",
        "a message is later than its chunk, plain",
        "a message is later than its chunk, unindexed",
        # It is a chunk like any other.
        "a chunk is in a chunk, plain",
        # There is no summary.
        "the checksum of the summary is wrong, plain",
        "the checksum of the summary is wrong, unindexed",
    }
)


@dataclass(frozen=True)
class Record:
    """A record of a file: where it begins, its opcode and its content."""

    offset: int
    opcode: int
    content: bytes

    def packed(self) -> bytes:
        """Return it as it is in a file."""
        return _HEAD.pack(self.opcode, len(self.content)) + self.content


def records_of(data: bytes) -> list[Record]:
    """Return the records of a whole file, those of its chunks within them."""
    found, offset = [], len(MAGIC)
    while offset < len(data) - len(MAGIC):
        opcode, length = _HEAD.unpack_from(data, offset)
        start = offset + _HEAD.size
        found.append(Record(offset, opcode, data[start : start + length]))
        offset = start + length
    return found


def file_of(records: Sequence[Record], begin: bytes = MAGIC, end: bytes = MAGIC) -> bytes:
    """Return a file of records as they are; offsets in them stay what they were."""
    return begin + b"".join(record.packed() for record in records) + end


Change = Callable[[list[Record], np.random.Generator], bytes]


def files(content: Content, rng: np.random.Generator) -> Iterator[tuple[str, bytes]]:
    """Yield each kind of malformed file of a content, with the defect in words."""
    for name, features in (("indexed", _INDEXED), ("unindexed", _UNINDEXED), ("plain", _PLAIN)):
        whole = mcap_file(content, features, messages_a_chunk=5)
        for what, data in _bytewise(whole, rng):
            yield f"{what}, {name}", data
        for what, change in _CHANGES.items():
            records = records_of(whole)
            data = change(records, rng)
            # What is drawn may already be as the change makes it.
            if data and data != whole and f"{what}, {name}" not in _WITHOUT_MEANING:
                yield f"{what}, {name}", data


def _bytewise(whole: bytes, rng: np.random.Generator) -> Iterator[tuple[str, bytes]]:
    """Yield files that differ in single bytes or their length."""
    yield "its magic is another one", bytes([whole[0] ^ 1]) + whole[1:]
    cut = int(rng.integers(len(MAGIC), len(whole) - 1))
    yield "its end is cut off", whole[:cut]
    yield "its last magic is missing", whole[: -len(MAGIC)]
    yield "something stands behind its end", whole + b"\0" * int(rng.integers(1, 40))


def _of(records: Sequence[Record], opcode: int) -> list[int]:
    return [n for n, record in enumerate(records) if record.opcode == opcode]


def _first(records: list[Record], opcode: int, change: Callable[[bytes], bytes]) -> bytes:
    """Return the file with the first record of an opcode changed, its length kept or not."""
    places = _of(records, opcode)
    if not places:
        return b""
    place = places[0]
    records[place] = replace(records[place], content=change(records[place].content))
    return file_of(records)


def _put(content: bytes, offset: int, value: bytes) -> bytes:
    return content[:offset] + value + content[offset + len(value) :]


def _in_chunk(change: Callable[[list[Record]], None]) -> Change:
    """Return what changes the records in the first chunk that has channels, its checksum right."""

    def changed(records: list[Record], _: np.random.Generator) -> bytes:
        places = _of(records, Opcode.CHUNK)
        if not places:
            inner = records[:]
            change(inner)
            return b"" if inner == records else _closed(inner)
        place = places[0]
        content = records[place].content
        inner = records_of(MAGIC + content[40:] + MAGIC)
        before = inner[:]
        change(inner)
        if inner == before:
            return b""
        data = b"".join(record.packed() for record in inner)
        head = content[:16] + struct.pack("<QI", len(data), zlib.crc32(data))
        head += struct.pack("<I", 0) + struct.pack("<Q", len(data))
        records[place] = replace(records[place], content=head + data)
        return _closed(records)

    return changed


def _closed(records: list[Record]) -> bytes:
    """Return a file of records, with the checksum of its data, without a summary."""
    end = _of(records, Opcode.DATA_END)[0]
    data = MAGIC + b"".join(record.packed() for record in records[:end])
    data += _HEAD.pack(Opcode.DATA_END, 4) + struct.pack("<I", zlib.crc32(data))
    footer = _HEAD.pack(Opcode.FOOTER, 20) + struct.pack("<QQ", 0, 0)
    return data + footer + struct.pack("<I", zlib.crc32(footer)) + MAGIC


def _second_channel(records: list[Record]) -> None:
    places = _of(records, Opcode.CHANNEL)
    if places:
        content = records[places[0]].content
        records.append(replace(records[places[0]], content=_put(content, 8, b"#")))
        records.insert(places[0] + 1, records.pop())


def _second_schema(records: list[Record]) -> None:
    places = _of(records, Opcode.SCHEMA)
    if places:
        content = records[places[0]].content
        records.insert(places[0] + 1, replace(records[places[0]], content=_put(content, 6, b"#")))


def _no_schema(records: list[Record]) -> None:
    if all(records[n].content[2:4] == b"\0\0" for n in _of(records, Opcode.CHANNEL)):
        return  # no channel has one
    for place in reversed(_of(records, Opcode.SCHEMA)):
        del records[place]


def _no_channel(records: list[Record]) -> None:
    for place in reversed(_of(records, Opcode.CHANNEL)):
        del records[place]


def _opcode_zero(records: list[Record]) -> None:
    records.insert(len(records) // 2, Record(0, 0, b"abc"))


def _long_text(records: list[Record]) -> None:
    places = _of(records, Opcode.CHANNEL)
    if places:
        content = records[places[0]].content
        records[places[0]] = replace(
            records[places[0]], content=_put(content, 4, struct.pack("<I", 2**31))
        )


def _short_message(records: list[Record]) -> None:
    places = _of(records, Opcode.MESSAGE)
    if places:
        records[places[-1]] = replace(records[places[-1]], content=b"\0" * 10)


def _late_message(records: list[Record]) -> None:
    places = _of(records, Opcode.MESSAGE)
    if places:
        content = records[places[0]].content
        late = struct.pack("<Q", 10**6)
        records[places[0]] = replace(records[places[0]], content=_put(content, 6, late))


def _chunk_in_chunk(records: list[Record]) -> None:
    places = _of(records, Opcode.MESSAGE)
    if places:
        data = records[places[0]].packed()
        head = struct.pack("<QQQIIQ", 0, 0, len(data), zlib.crc32(data), 0, len(data))
        records[places[0]] = Record(0, Opcode.CHUNK, head + data)


def _bit_of_message(records: list[Record], rng: np.random.Generator) -> bytes:
    """Turn a bit of a message outside of chunks; the checksum of the data stays."""
    places = [n for n in _of(records, Opcode.MESSAGE) if len(records[n].content) > 22]
    if not places:
        return b""
    place = places[int(rng.integers(len(places)))]
    content = bytearray(records[place].content)
    content[-1] ^= 1 << int(rng.integers(8))
    records[place] = replace(records[place], content=bytes(content))
    return file_of(records)


def _bit_of_chunk(records: list[Record], rng: np.random.Generator) -> bytes:
    places = _of(records, Opcode.CHUNK)
    if not places:
        return b""
    place = places[int(rng.integers(len(places)))]
    content = bytearray(records[place].content)
    content[int(rng.integers(40, len(content)))] ^= 1 << int(rng.integers(8))
    records[place] = replace(records[place], content=bytes(content))
    return file_of(records)


def _footer(offset: int, value: int, size: int) -> Change:
    """Return what puts a value into the footer."""

    def changed(records: list[Record], _: np.random.Generator) -> bytes:
        data = file_of(records)
        place = len(data) - len(MAGIC) - 20 + offset
        packed = value.to_bytes(size, "little")
        return b"" if data[place : place + size] == packed else _put(data, place, packed)

    return changed


def _summary(opcode: int, offset: int, value: int, size: int = 8) -> Change:
    """Return what puts a value into a record of the summary, its checksum right."""

    def changed(records: list[Record], _: np.random.Generator) -> bytes:
        places = _of(records, opcode)
        if not places or not _of(records, Opcode.STATISTICS):
            return b""
        place = places[-1]
        packed = value.to_bytes(size, "little")
        records[place] = replace(
            records[place], content=_put(records[place].content, offset, packed)
        )
        return checked(file_of(records))

    return changed


def checked(data: bytes) -> bytes:
    """Return a file with the checksum of its summary as it is now."""
    footer = len(data) - len(MAGIC) - _FOOTER_BYTES
    start = struct.unpack_from("<Q", data, footer + 9)[0] or footer
    end = len(data) - len(MAGIC) - 4
    return _put(data, end, struct.pack("<I", zlib.crc32(data[start:end])))


def _without(opcode: int) -> Change:
    def changed(records: list[Record], _: np.random.Generator) -> bytes:
        places = _of(records, opcode)
        if not places:
            return b""
        del records[places[0]]
        return file_of(records)

    return changed


_CHANGES: Final[dict[str, Change]] = {
    "a bit of a message outside of chunks is turned": _bit_of_message,
    "a bit of a chunk is turned": _bit_of_chunk,
    "the checksum of a chunk is wrong": lambda records, _: _first(
        records, Opcode.CHUNK, lambda c: _put(c, 24, b"\x01\x02\x03\x04")
    ),
    "the size of a chunk is wrong": lambda records, _: _first(
        records, Opcode.CHUNK, lambda c: _put(c, 16, struct.pack("<Q", 7))
    ),
    "the size of a chunk is huge": lambda records, _: _first(
        records, Opcode.CHUNK, lambda c: _put(c, 16, struct.pack("<Q", 2**62))
    ),
    "the compression of a chunk is unknown": lambda records, _: _first(
        records, Opcode.CHUNK, lambda c: c[:28] + b"\x02\0\0\0xz" + c[32:]
    ),
    "a chunk is empty": lambda records, _: _first(records, Opcode.CHUNK, lambda _: b""),
    "two channels have one id": _in_chunk(_second_channel),
    "two schemas have one id": _in_chunk(_second_schema),
    "a schema is not defined": _in_chunk(_no_schema),
    "a channel is not defined": _in_chunk(_no_channel),
    "a record has opcode 0": _in_chunk(_opcode_zero),
    "a text is longer than its record": _in_chunk(_long_text),
    "a message is shorter than its head": _in_chunk(_short_message),
    "a message is later than its chunk": _in_chunk(_late_message),
    "a chunk is in a chunk": _in_chunk(_chunk_in_chunk),
    "the summary begins beyond the end": _footer(0, 2**40, 8),
    "the summary begins within the magic": _footer(0, 3, 8),
    "the checksum of the summary is wrong": _footer(16, 12345, 4),
    "a chunk begins elsewhere": _summary(Opcode.CHUNK_INDEX, 16, 9),
    "a chunk begins beyond the end": _summary(Opcode.CHUNK_INDEX, 16, 2**50),
    "a chunk is shorter than it is": _summary(Opcode.CHUNK_INDEX, 24, 20),
    "the messages of a chunk are later than said": _summary(Opcode.CHUNK_INDEX, 8, 0),
    "there are more messages than said": _summary(Opcode.STATISTICS, 0, 0),
    "there are fewer chunks than said": _summary(Opcode.STATISTICS, 22, 77, 4),
    "the header is missing": _without(Opcode.HEADER),
    "the end of the data is missing": _without(Opcode.DATA_END),
    "the footer is missing": _without(Opcode.FOOTER),
    "a chunk is missing": _without(Opcode.CHUNK),
}
