# SPDX-License-Identifier: Apache-2.0
"""The level of a unit is unknown if timestamps do not show which test is the newest."""

from dataclasses import replace

import pyarrow as pa
import pytest

from ema_archive.settings import ArchiveSettings
from ema_archive.tables import BAG_TABLES, UNIT_TABLES, estimate_row
from ema_archive.unit_task import UnitEntry, UnitTask, follow_unit
from ema_core.levels import OK, STALE
from ema_monitor.identification.estimate import Verdict

from ..prognosis.made_tests import UNIT, made_test

S = 10**9


@pytest.mark.parametrize(
    ("verdict", "level"),
    [(Verdict.REFUSED, STALE), (Verdict.DEPARTED, STALE), (Verdict.SKIPPED, OK), ("again", OK)],
)
def test_unused_test_after_the_clock_went_back_makes_the_level_unknown(verdict: str, level: int):
    """The bag has the unused test after the healthy one, with an earlier stamp, or the same one."""
    good = made_test(0, friction=0.02)
    unused = replace(
        made_test(0, valid=False), verdict=Verdict.REFUSED if verdict == "again" else verdict
    )
    back_ns = 0 if verdict == "again" else 600 * S
    unused = replace(unused, start_ns=unused.start_ns - back_ns, end_ns=unused.end_ns - back_ns)
    made = {"bag": "bag", "bag_sha256": "", "software": "", "settings": ""}
    rows = [estimate_row(estimate, number) | made for number, estimate in enumerate([good, unused])]
    estimates = pa.Table.from_pylist(rows, BAG_TABLES["estimates"])
    usage, duty = (BAG_TABLES[name].empty_table() for name in ("usage", "duty"))
    health = UNIT_TABLES["health"].empty_table()
    entry = UnitEntry("flap", *UNIT, "", "")
    result = follow_unit(UnitTask(entry, ArchiveSettings(), estimates, usage, duty, health, None))
    assert result.tables["units"]["level"].to_pylist() == [level]
