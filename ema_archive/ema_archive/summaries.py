"""Tables of an archive that are one file each: its bags, its units, and how these grow."""

from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from ema_archive.manifest import Manifest
from ema_archive.partitions import TABLES, write_whole
from ema_archive.service_record import LIVES, MONTHS
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
UNITS: Final = pa.schema([*_PLACE, *HEALTH, ("calibrated", pa.timestamp("us"))])
"""A row for each unit: its row of health after the newest test, and when the file of its
calibration was changed."""

UNIT_GROWTH: Final = pa.schema([*_PLACE, *GROWTH])
"""A row for each fault and requirement of each unit."""

UNIT_LIVES: Final = pa.schema([*_PLACE, *LIVES])
UNIT_MONTHS: Final = pa.schema([*_PLACE, *MONTHS])
"""A row for each life of a unit, and for each month with tests of it."""

SUMMARIES: Final = {
    "bags": BAGS,
    "units": UNITS,
    "growth": UNIT_GROWTH,
    "lives": UNIT_LIVES,
    "months": UNIT_MONTHS,
}
"""Columns of these tables by name."""

_ROWS: Final = 50_000


def write_summaries(manifest: Manifest) -> None:
    """Write the tables as the archive is.

    Raises
    ------
    OSError
        When they cannot be written; those before stay.
    """
    rows: dict[str, list[dict[str, Any]]] = {"units": [], "growth": [], "lives": [], "months": []}
    for known in manifest.units():
        place, record = {"model": known.entry.model, "unit": known.entry.unit}, known.record
        if known.latest is not None:
            changed_ns = record.calibrated_ns
            calibrated = None if changed_ns is None else changed_ns // 1000
            rows["units"].append(known.latest | place | {"calibrated": calibrated})
        rows["growth"] += [item | place for item in known.growth]
        rows["lives"] += [life | place for life in record.lives]
        rows["months"] += [month | place for month in record.months]
    for name, found in rows.items():
        write_whole(manifest.archive, name, pa.Table.from_pylist(found, SUMMARIES[name]))
    # By parts: of millions of bags there is no need to hold all.
    with (
        complete_file(manifest.archive / TABLES / "bags.parquet") as partial,
        pq.ParquetWriter(partial, BAGS, compression="zstd") as writer,
    ):
        bags = manifest.bags()
        while page := bags.fetchmany(_ROWS):
            columns = list(zip(*page, strict=True))
            arrays = [
                pa.array([bool(v) for v in values] if kind == pa.bool_() else values, kind)
                for values, kind in zip(columns, BAGS.types, strict=True)
            ]
            writer.write_table(pa.Table.from_arrays(arrays, schema=BAGS))
