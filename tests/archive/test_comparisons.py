# SPDX-License-Identifier: Apache-2.0
"""Comparisons of records are stored in the table of estimates and can be queried with SQL."""

from dataclasses import replace
from pathlib import Path

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.monitor.comparisons import CASES, HEALTHY, compared
from tests.monitor.windows import estimated

from ema_archive.tables import BAG_TABLES, estimate_from, estimate_row
from ema_monitor.joint.comparison import Comparison, FigureChange, Improvement
from ema_monitor.quantities import FRICTION

FULL = replace(
    HEALTHY,
    figures=(FigureChange("tracking_error", 2.0, 1e-5),),
    states={"worn": 0.9, "healthy": 0.1},
    improvements=(Improvement(FRICTION, 2, 6, 0.06, 0.05),),
)
_SQL = """
    SELECT one.name, one.judgement, one.change
    FROM (SELECT unnest(comparison.quantities) AS one FROM read_parquet(?)) WHERE one.name = ?
"""


def written(path: Path, *estimates: object) -> Path:
    rows = [estimate_row(estimate, number) for number, estimate in enumerate(estimates)]  # pyright: ignore[reportArgumentType]
    pq.write_table(pa.Table.from_pylist(rows, BAG_TABLES["estimates"]), path)
    return path


@pytest.mark.parametrize("of", [*CASES.values(), FULL], ids=[*CASES, "full"])
def test_comparison_is_read_from_a_table_exactly_as_written(tmp_path: Path, of: Comparison):
    [row] = pq.read_table(written(tmp_path / "one.parquet", compared(of))).to_pylist()
    assert repr(estimate_from(row).comparison) == repr(of)


def test_estimate_of_a_modelled_drive_has_no_comparison(tmp_path: Path):
    [row] = pq.read_table(written(tmp_path / "one.parquet", estimated())).to_pylist()
    assert estimate_from(row).comparison is None


def test_changes_can_be_queried_by_name(tmp_path: Path):
    file = written(tmp_path / "one.parquet", compared(CASES["friction"]), estimated())
    changes = duckdb.execute(_SQL, [str(file), FRICTION]).fetchall()
    assert changes == [("friction", "changed", pytest.approx(0.152))]
