"""Tables that earlier software wrote with other columns."""

import re

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ema_archive.partitions import SCHEMAS, TABLES, read_unit, replace_rows, write_health
from ema_archive.query import VIEWS, answer
from ema_archive.summaries import UNITS
from ema_archive.tables import ESTIMATES, HEALTH

MONTHS = ("1970-01", "1970-02")


def row_of(number, month):
    return {
        "actuator_id": "flap",
        "serial_number": "1",
        "end_ns": number,
        "valid": True,
        "friction": 0.1 * number,
        "bag": f"/bags/{month}_{number}.mcap",
    }


def make_older(path):
    """Write a file again as software did that knew no friction, and had a column of its own."""
    table = pq.ParquetFile(path).read().drop_columns("friction")
    numbers = table["number"].cast(pa.int64())
    table = table.set_column(table.column_names.index("number"), "number", numbers)
    pq.write_table(table.append_column("dropped", pa.array(["x"] * len(table))), path)


@pytest.fixture
def archive(tmp_path):
    """Two months of a unit, of which the first is of earlier software."""
    for month in MONTHS:
        place = ("model", "flap+1", month)
        replace_rows(tmp_path, "estimates", place, set(), [row_of(1, month)])
    [path] = (tmp_path / TABLES).glob(f"estimates/*/*/month={MONTHS[0]}/*.parquet")
    make_older(path)
    return tmp_path


def test_older_rows_of_a_unit_are_read_with_the_present_columns(archive):
    rows = read_unit(archive, "estimates", "flap+1")
    assert rows.schema.equals(ESTIMATES)
    assert sorted(rows["friction"].to_pylist(), key=str) == [0.1, None]


def test_rows_are_added_to_a_month_that_earlier_software_wrote(archive):
    place = ("model", "flap+1", MONTHS[0])
    replace_rows(archive, "estimates", place, set(), [row_of(2, MONTHS[0])])
    [path] = (archive / TABLES).glob(f"estimates/*/*/month={MONTHS[0]}/*.parquet")
    rows = pq.ParquetFile(path).read()
    assert rows.schema.equals(SCHEMAS["estimates"])
    assert rows["friction"].to_pylist() == [None, 0.2]


def test_tables_of_both_are_asked_as_one(archive):
    question = "select month, friction from estimates order by month"
    assert answer(archive, question)[1] == [(MONTHS[0], None), (MONTHS[1], 0.1)]


def test_views_can_be_read_where_all_tables_are_older(tmp_path):
    """Such as before the first run of newer software."""
    one = {"actuator_id": "flap", "serial_number": "1", "stamp_ns": 1, "tested": 1, "level": 1}
    health = pa.Table.from_pylist([one], HEALTH).drop_columns(["hours", "events"])
    write_health(tmp_path, "model", "flap+1", health)
    units = pa.Table.from_pylist([one | {"model": "model", "unit": "flap+1"}], UNITS)
    pq.write_table(units.drop_columns("rul_known"), tmp_path / TABLES / "units.parquet")
    for view in VIEWS:
        answer(tmp_path, f"select * from {view}")
    assert len(answer(tmp_path, "select * from worst_first")[1]) == 1


def test_column_that_is_of_another_kind_is_named_with_its_file(archive):
    [path] = (archive / TABLES).glob(f"estimates/*/*/month={MONTHS[1]}/*.parquet")
    table = pq.ParquetFile(path).read().drop_columns("friction")
    pq.write_table(table.append_column("friction", pa.array(["much"] * len(table))), path)
    said = re.escape(f"{path}: column 'friction' is no double")
    with pytest.raises(ValueError, match=said):
        read_unit(archive, "estimates", "flap+1")
