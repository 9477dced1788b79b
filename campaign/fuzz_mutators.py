"""Changes of inputs that keep their structure, so that what lies behind a checksum is reached."""

import json
import random
import sqlite3
import struct
import tempfile
import zlib
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from malformed import Record, records_of
from mcap.opcode import Opcode
from mcap_form import MAGIC

_ODD: Final = (0, 1, 2, 2**15, 2**31 - 1, 2**32 - 1, 2**62, 2**63, 2**64 - 1)
_VALUES: Final[tuple[Any, ...]] = (
    *(None, True, "", "x", 0, -1, 2**63, 2**64, 10**400, 1e308, -0.0, [], {}, [[]], "nan", "inf"),
    "\u0000",
)
_CHUNK_HEAD: Final = 40


def change_bag(data: bytes, seed: int) -> bytes:
    """Change records of a recording, those in chunks as well; checksums and places are right."""
    rng = random.Random(seed)
    try:
        records = records_of(data)
    except (struct.error, IndexError):
        return data
    for _ in range(rng.randint(1, 3)):
        if records:
            _change_records(records, rng)
    return _joined(records)


def _change_records(records: list[Record], rng: random.Random) -> None:
    place = rng.randrange(len(records))
    record = records[place]
    if record.opcode == Opcode.CHUNK and rng.random() < 0.7:
        with suppress(struct.error, IndexError):
            inner = records_of(MAGIC + record.content[_CHUNK_HEAD:] + MAGIC)
            if inner:
                _change_records(inner, rng)
            packed = b"".join(item.packed() for item in inner)
            head = record.content[:16] + struct.pack("<QI", len(packed), zlib.crc32(packed))
            content = head + struct.pack("<IQ", 0, len(packed)) + packed
            records[place] = replace(record, content=content)
            return
    how = rng.randrange(6)
    if how == 0:
        del records[place]
    elif how == 1:
        records.insert(rng.randrange(len(records) + 1), record)
    elif how == 2:
        other = rng.randrange(len(records))
        records[place], records[other] = records[other], records[place]
    elif how == 3:
        records[place] = replace(record, opcode=rng.choice((0, *range(1, 18), 128, 255)))
    else:
        records[place] = replace(record, content=_changed(record.content, rng))


def _changed(content: bytes, rng: random.Random) -> bytes:
    if not content or rng.random() < 0.1:
        return content + rng.randbytes(rng.randint(1, 9))
    changed = bytearray(content)
    offset, size = rng.randrange(len(content)), rng.choice((1, 2, 4, 8))
    if rng.random() < 0.5:
        value = rng.choice(_ODD) % 256**size
        changed[offset : offset + size] = value.to_bytes(size, "little")
    elif rng.random() < 0.3:
        del changed[offset : offset + size]
    else:
        changed[offset] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _joined(records: list[Record]) -> bytes:
    """Return a file of records; places and checksum of its summary are those of its records."""
    data, summary_start = bytearray(MAGIC), 0
    chunks: list[tuple[int, int]] = []
    for record in records:
        offset, content = len(data), record.content
        if record.opcode == Opcode.CHUNK:
            chunks.append((offset, 9 + len(content)))
        elif record.opcode == Opcode.CHUNK_INDEX and chunks and len(content) >= 32:
            place = chunks.pop(0)
            content = content[:16] + struct.pack("<QQ", *place) + content[32:]
        elif record.opcode == Opcode.FOOTER and len(content) == 20 and summary_start:
            head = struct.pack("<BQ", Opcode.FOOTER, 20) + struct.pack("<Q", summary_start)
            head += content[8:16]
            checksum = zlib.crc32(head, zlib.crc32(data[summary_start:]))
            content = head[9:] + struct.pack("<I", checksum)
        data += replace(record, content=content).packed()
        if record.opcode == Opcode.DATA_END:
            summary_start = len(data)
    return bytes(data) + MAGIC


def change_lines(data: bytes, seed: int) -> bytes:
    """Change a value in a line of a history of an earlier version; its checksum is right."""
    rng = random.Random(seed)
    lines = data.split(b"\n")
    place = rng.randrange(len(lines))
    with suppress(ValueError, RecursionError):
        record = json.loads(lines[place])
        if isinstance(record, dict):
            record.pop("crc32", None)
            change_value(record, rng)
            body = json.dumps(record)[:-1].encode()
            mark = b'"crc32": "' + f"{zlib.crc32(body):08x}".encode() + b'"}'
            lines[place] = body + b", " + mark
    return b"\n".join(lines)


def change_value(record: Any, rng: random.Random) -> None:
    """Change a value somewhere in nested plain ones."""
    while True:
        keys: list[Any] = list(record) if isinstance(record, dict) else list(range(len(record)))
        if not keys:
            return
        key = rng.choice(keys)
        if isinstance(record[key], dict | list) and record[key] and rng.random() < 0.8:
            record = record[key]
            continue
        if rng.random() < 0.2:
            del record[key]
        else:
            record[key] = rng.choice(_VALUES)
        return


def change_history(data: bytes, seed: int) -> bytes:
    """Change rows of a history by SQL; half of the time their checksums are right."""
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory(
        dir="/dev/shm" if Path("/dev/shm").is_dir() else None
    ) as folder:
        path = Path(folder) / "changed.sqlite"
        path.write_bytes(data)
        with (
            suppress(sqlite3.Error, ValueError, OverflowError, RecursionError),
            closing(sqlite3.connect(path, isolation_level=None)) as db,
        ):
            db.execute("PRAGMA synchronous = OFF")
            db.execute("PRAGMA journal_mode = DELETE")
            _change_rows(db, rng)
        return path.read_bytes()


def _change_rows(db: sqlite3.Connection, rng: random.Random) -> None:
    tables = [row[0] for row in db.execute("SELECT name FROM sqlite_schema WHERE type = 'table'")]
    table = rng.choice(tables)
    columns = [row[1] for row in db.execute(f'PRAGMA table_info("{table}")')]
    column, rowid = rng.choice(columns), rng.randint(1, 4)
    value = rng.choice((None, 0, -1, 2**62, 1.5, "", "x", b"", b"\xff" * 32))
    how = rng.randrange(7)
    if how == 0:
        db.execute(f'DELETE FROM "{table}" WHERE rowid = ?', (rowid,))
    elif how == 1:
        db.execute(f'UPDATE "{table}" SET "{column}" = ? WHERE rowid = ?', (value, rowid))
    elif how == 2:
        db.execute(f'INSERT INTO "{table}" SELECT * FROM "{table}" LIMIT 1')
    elif how == 3:
        db.execute(f'DROP TABLE "{table}"')
    elif how == 4:
        db.execute(f"PRAGMA user_version = {rng.choice((0, 1, 3, 4, 5, 6, 7, -1))}")
    else:
        found = db.execute("SELECT record FROM test WHERE rowid = ?", (rowid,)).fetchone()
        if found:
            record = json.loads(found[0])
            change_value(record, rng)
            text = json.dumps(record)
            db.execute(
                "UPDATE test SET record = ?, crc32 = ? WHERE rowid = ?",
                (text, zlib.crc32(text.encode()), rowid),
            )
