# SPDX-License-Identifier: Apache-2.0
"""Tests that may be lost in unreadable or incomplete bags, and the affected units."""

from typing import Any, Final

import duckdb
import pyarrow as pa

from ema_archive.bag_task import DAMAGED, FAILED, unit_name
from ema_archive.sources import calibration_of
from ema_archive.store import Store
from ema_monitor.reasons import Reason

_SUSPECTS: Final = """
WITH suspect AS (
    SELECT * FROM manifest.suspect
    UNION
    SELECT bag, unit FROM manifest.unread ANTI JOIN manifest.part USING (bag)
    JOIN _calibrations USING (calibration_url) SEMI JOIN manifest.unit USING (unit)
),
whole AS (
    SELECT unit, max(end_ns) AS last_ns FROM manifest.part JOIN manifest.bag USING (bag)
    WHERE estimates > 0 AND state = 'done' GROUP BY unit
)
"""
"""Subqueries: the units that each unread bag may contain, also from the calibration in its folder,
and the end of the last complete bag of each unit."""

_LOST: Final = """
SELECT unit, bag, state, reason
FROM suspect JOIN manifest.unread USING (bag) LEFT JOIN whole USING (unit)
WHERE end_ns = 0 OR end_ns >= coalesce(last_ns, 0)
QUALIFY row_number() OVER (PARTITION BY unit ORDER BY end_ns = 0 DESC, end_ns DESC, bag) = 1
"""

_OF_NO_UNIT: Final = "SELECT bag FROM manifest.unread ANTI JOIN suspect USING (bag) ORDER BY bag"


def losses_by_unit(store: Store) -> dict[str, str]:
    """Return why the newest test of a unit may be lost, keyed by the name of the unit.

    A test may be lost in a bag that was not read completely, unless a later complete bag has a
    window of the unit. A bag without any readable message may be the newest bag. A bag that was
    never read may belong to the units in its folder, or to the unit of the calibration in its
    folder.

    Raises
    ------
    ValueError, OSError
        As in ``Store.reading``; also OSError if a calibration cannot be read.
    """
    return {unit: f"later tests may be lost: {_named(*bag)}" for unit, *bag in _rows(store, _LOST)}


def unread_of_no_unit(store: Store) -> list[str]:
    """Return the unread bags that cannot be assigned to a unit; errors as in `losses_by_unit`."""
    return [bag for (bag,) in _rows(store, _OF_NO_UNIT)]


def _rows(store: Store, query: str) -> list[Any]:
    with store.reading() as db:
        db.register("_calibrations", _units_of_calibrations(db))
        rows = db.execute(_SUSPECTS + query).fetchall()
        db.unregister("_calibrations")
    return rows


def _units_of_calibrations(db: duckdb.DuckDBPyConnection) -> pa.Table:
    """Return the units whose calibration is in the folder of a bag that was never read."""
    query = (
        "SELECT DISTINCT calibration_url FROM manifest.unread ANTI JOIN manifest.part USING (bag) "
        "WHERE calibration_url <> ''"
    )
    urls = [url for (url,) in db.execute(query).fetchall()]
    calibrations = [(url, calibration_of(url, ("", ""))) for url in urls]
    rows = [
        {
            "calibration_url": url,
            "unit": unit_name(calibration.actuator_id, calibration.serial_number),
        }
        for url, calibration in calibrations
        if not isinstance(calibration, Reason)
    ]
    columns = pa.schema([("calibration_url", pa.string()), ("unit", pa.string())])
    return pa.Table.from_pylist(rows, columns)


def _named(url: str, state: str, reason: str) -> str:
    if url in reason:
        return reason
    what = {DAMAGED: "cannot be read", FAILED: "could not be read"}
    return f"{url} {what.get(state, 'can be read only in part')}: {reason}"
