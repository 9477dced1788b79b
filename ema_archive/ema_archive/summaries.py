"""Tables of an archive that are one file each: its bags, its units, and how these grow."""

from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from ema_archive.manifest import Manifest
from ema_archive.partitions import TABLES, write_whole
from ema_archive.tables import GROWTH, HEALTH
from ema_core.files import complete_file

BAGS: Final = pa.schema(
    [
        ("bag", pa.string()),
        ("bytes", pa.int64()),
        ("is_there", pa.bool_()),
        ("state", pa.string()),
        ("bag_sha256", pa.string()),
        ("software", pa.string()),
        ("settings", pa.string()),
        ("reason", pa.string()),
        ("remarks", pa.string()),
        ("windows", pa.int32()),
        ("valid", pa.int32()),
    ]
)
"""A row for each bag, the damaged ones included."""

_PLACE: Final = [("model", pa.string()), ("unit", pa.string())]
UNITS: Final = pa.schema([*_PLACE, *HEALTH])
"""A row for each unit with a valid test: its latest row of health."""

UNIT_GROWTH: Final = pa.schema([*_PLACE, *GROWTH])
"""A row for each fault and requirement of each unit."""

SUMMARIES: Final = {"bags": BAGS, "units": UNITS, "growth": UNIT_GROWTH}
"""Columns of these tables by name."""

_GENERATION: Final = b"ema_generation"
_ROWS: Final = 50_000


def write_summaries(manifest: Manifest) -> None:
    """Write the tables, unless they are as the archive is.

    Raises
    ------
    OSError
        When they cannot be written; those before stay.
    """
    if are_current(manifest):
        return
    mark = {_GENERATION: str(manifest.generation).encode()}
    units: list[dict[str, Any]] = []
    growth: list[dict[str, Any]] = []
    for entry, latest, items in manifest.units():
        place = {"model": entry.model, "unit": entry.unit}
        if latest is not None:
            units.append(latest | place)
        growth += [item | place for item in items]
    write_whole(manifest.archive, "units", pa.Table.from_pylist(units, UNITS))
    write_whole(manifest.archive, "growth", pa.Table.from_pylist(growth, UNIT_GROWTH))
    schema = BAGS.with_metadata(mark)
    # By parts: of millions of bags there is no need to hold all.
    with (
        complete_file(manifest.archive / TABLES / "bags.parquet") as partial,
        pq.ParquetWriter(partial, schema, compression="zstd") as writer,
    ):
        rows = manifest.bags()
        while page := rows.fetchmany(_ROWS):
            columns = list(zip(*page, strict=True))
            arrays = [
                pa.array([bool(v) for v in values] if kind == pa.bool_() else values, kind)
                for values, kind in zip(columns, BAGS.types, strict=True)
            ]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))


def are_current(manifest: Manifest) -> bool:
    """Return whether the tables are as the archive is."""
    path = manifest.archive / TABLES / "bags.parquet"
    if not path.exists():
        return False
    metadata = pq.read_schema(path).metadata or {}
    return metadata.get(_GENERATION) == str(manifest.generation).encode()
