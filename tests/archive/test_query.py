# SPDX-License-Identifier: Apache-2.0
"""SQL queries: the predefined views, and no access outside the tables."""

import csv
import json
from dataclasses import replace

import duckdb
import pyarrow.parquet as pq
import pytest

from ema_archive.bag_task import unit_name
from ema_archive.manifest import Manifest
from ema_archive.query import answer, columns_of, export
from ema_archive.running import scan
from ema_archive.settings import ArchiveSettings
from ema_archive.store import FILE
from ema_core.faults import FAULT_NAMES
from ema_core.levels import LEVEL_NAMES
from ema_monitor.identification.estimate import Verdict
from ema_monitor.prognosis.growth.tracker_settings import NOMINAL_LAWS
from ema_monitor.reasons import StampsContradict

from .conftest import rows_of_unit, write_rows

UNIT = {"actuator_id": "flap", "serial_number": "1"}


def test_every_view_can_be_read_in_an_archive_without_bags(tmp_path):
    (tmp_path / "empty").mkdir()
    with Manifest(tmp_path / "archive", is_new=True) as manifest:
        assert scan(manifest, [str(tmp_path / "empty")]) == 0
    for view in columns_of(tmp_path / "archive"):
        assert answer(tmp_path / "archive", f"select * from {view}")[1] == []


@pytest.mark.parametrize(
    ("question", "message"),
    [
        ("select * from read_csv('/etc/passwd')", "Permission Error"),
        ("select * from '/etc/passwd'", "Permission|Catalog"),
        ("drop view worst_first", "expected one query"),
        ("copy (select 1) to '/tmp/x.csv'", "expected one query"),
        ("select 1; select 2", "expected one query"),
        ("set enable_external_access = true", "expected one query"),
        ("select nothing from worst_first", "nothing"),
        ("selec 1", "syntax error"),
        # This error occurs only while rows are read.
        ("select unit::int from estimates", "Conversion Error"),
        ("", "expected one query"),
    ],
)
def test_query_that_is_invalid_or_reaches_outside_is_refused(whole, question, message):
    with pytest.raises(ValueError, match=message):
        answer(whole, question)


@pytest.mark.slow
@pytest.mark.parametrize("query", ["worst_first", "select serial_number, level from units"])
def test_export_writes_the_result_of_a_query(ema, whole, tmp_path, query):
    for name in ("export.csv", "export.parquet"):
        result = ema("archive", "export", whole, query, "-o", tmp_path / name)
        assert (result.exit_code, result.stdout) == (0, f"{tmp_path / name}: 2 rows\n")
    table = pq.read_table(tmp_path / "export.parquet")
    with (tmp_path / "export.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == table.column_names
    assert [row["serial_number"] for row in rows] == table["serial_number"].to_pylist()
    again = ema("archive", "export", whole, query, "-o", tmp_path / "export.csv")
    assert again.exit_code == 1
    assert "already exists: use --replace to overwrite it" in again.stderr
    for name in ("export.csv", "export.parquet"):
        # A partial file that a killed export left behind is overwritten.
        (tmp_path / f"{name}.partial").write_text("left")
        forced = ema("archive", "export", whole, "units", "-o", tmp_path / name, "--replace")
        assert (forced.exit_code, forced.stdout) == (0, f"{tmp_path / name}: 2 rows\n")
    assert "dominant_fault" in pq.read_table(tmp_path / "export.parquet").column_names
    assert not list(tmp_path.glob("*.partial"))
    misnamed = ema("archive", "export", whole, query, "-o", tmp_path / "export.txt")
    assert "expected a name that ends in .csv or .parquet" in misnamed.stderr


@pytest.mark.slow
def test_export_that_fails_leaves_the_file_as_it_was(ema, whole, tmp_path):
    path = tmp_path / "export.csv"
    path.write_text("before")
    question = "select unit::int from estimates"
    result = ema("archive", "export", whole, question, "-o", path, "--replace")
    assert result.exit_code == 1
    assert "Conversion Error" in result.stderr
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]
    result = ema("archive", "export", whole, "units", "-o", tmp_path / "none" / "export.csv")
    assert result.exit_code == 1
    assert f"{tmp_path / 'none' / 'export.csv'}: cannot be written" in result.stderr


def test_other_programs_read_tables_and_views(whole):
    with duckdb.connect(whole / FILE, read_only=True) as db:
        assert db.sql("select count(*) from estimates").fetchall() == [(10,)]
        assert len(db.sql("from worst_first").fetchall()) == 2


def test_folder_that_is_not_an_archive_is_named(ema, tmp_path):
    result = ema("archive", "query", tmp_path, "select 1")
    assert result.exit_code == 1
    assert f"{tmp_path} is not an archive, it has no archive.duckdb" in result.stderr
    (tmp_path / "letter.txt").touch()
    result = ema("archive", "scan", tmp_path, tmp_path)
    assert "is a folder with other files: an archive needs a new folder" in result.stderr


def write_course(archive, levels, repairs):
    """Write the health of a unit: a test per level, 10 h apart, with repairs at some positions."""
    rows = [
        {
            **UNIT,
            "tested_ns": number,
            "tested": number,
            "flight_hours": 10.0 * number,
            "cycles": number,
            "level": level,
            "dominant_fault": "friction" if level else "",
            "events": [{"kind": "repair", "text": "", "flight_hours": 0.0, "stamp_ns": number}]
            if number in repairs
            else [],
        }
        for number, level in enumerate(levels)
    ]
    write_rows(archive, "health", rows)


@pytest.mark.parametrize(
    ("levels", "repairs", "alarms"),
    [
        ([0, 1, 0], [], 1),
        ([0, 1, 2, 0, 0, 1, 1, 0], [], 2),
        ([0, 1, 1], [], 0),
        ([0, 1, 0], [2], 0),
        ([1, 3, 0], [], 1),
    ],
)
def test_false_alarm_is_one_that_later_tests_clear_without_a_repair(
    tmp_path, levels, repairs, alarms
):
    write_course(tmp_path / "archive", levels, repairs)
    assert len(answer(tmp_path / "archive", "select tests, level from false_alarms")[1]) == alarms


def test_runs_to_failure_are_labelled_with_the_hours_left(tmp_path):
    """A repair begins another life; the hours left in an unfinished life are unknown."""
    levels, archive = [0, 1, 2, 2, 0, 0], tmp_path / "archive"
    write_course(archive, levels, [4])
    estimates = [
        UNIT | {"end_ns": number, "valid": True, "friction": 0.1 * number, "bag": str(number)}
        for number in range(len(levels))
    ]
    write_rows(archive, "estimates", estimates)
    names, rows = answer(archive, "select * from runs_to_failure")
    assert {*FAULT_NAMES, *(f"{name}_sigma" for name in FAULT_NAMES)} <= {*names}
    runs = [dict(zip(names, row, strict=True)) for row in rows]
    assert [row["life"] for row in runs] == [0, 0, 0, 0, 1, 1]
    assert [row["hours_left"] for row in runs] == [20.0, 10.0, 0.0, 0.0, None, None]
    assert [row["friction"] for row in runs] == [0.1 * number for number in range(len(levels))]


def test_views_have_the_names_of_levels_and_reasons(tmp_path):
    archive = tmp_path / "archive"
    units = [UNIT | {"level": level, "last_level": 0} for level in range(len(LEVEL_NAMES))]
    write_rows(archive, "units", units)
    _, rows = answer(archive, "select health from worst_first")
    assert sorted(rows) == sorted((name,) for name in LEVEL_NAMES)
    write_rows(archive, "unordered", [{"bag": "a.mcap", "number": 0, "reason": "another order"}])
    _, rows = answer(archive, "select what, codes from refused")
    assert rows == [(Verdict.REFUSED, [StampsContradict.code])]


def test_settings_of_the_archive_are_kept_exactly():
    settings = ArchiveSettings(calibration="/c/{serial_number}.yaml")
    tracker = replace(settings.prognosis.tracker, laws={"friction": NOMINAL_LAWS["friction"]})
    settings = replace(settings, prognosis=replace(settings.prognosis, tracker=tracker))
    again = ArchiveSettings.of_mapping(json.loads(json.dumps(settings.as_mapping())))
    assert again == settings
    assert again.prognosis_id == settings.prognosis_id != ArchiveSettings().prognosis_id
    assert again.estimation_id == ArchiveSettings().estimation_id


def test_text_that_a_spreadsheet_would_evaluate_is_quoted_in_csv(whole, tmp_path):
    path = tmp_path / "export.csv"
    texts = ("=HYPERLINK('http://x')", "-1", "+a", "@b", "plain", "\ta")
    question = " UNION ALL ".join(
        f"SELECT '{text.replace(chr(39), chr(39) * 2)}' AS cell" for text in texts
    )
    export(whole, question, path)
    lines = path.read_text().splitlines()[1:]
    assert [line.strip('"')[0] for line in lines] == ["'", "'", "'", "'", "p", "'"]


LONG = "левый закрылок внешний"
NAMES = ("flap", "a/b", "é", LONG, 5 * LONG, "x" * 240, "x" * 241, "x" * 1000)


def test_unit_with_any_name_keeps_its_rows(tmp_path):
    units = {unit_name(actuator_id, LONG): actuator_id for actuator_id in NAMES}
    archive = tmp_path / "archive"
    for unit, actuator_id in units.items():
        row = {"actuator_id": actuator_id, "tested_ns": 1}
        write_rows(archive, "health", [row], unit, model=actuator_id)
        [kept] = rows_of_unit(archive, "health", unit).to_pylist()
        assert (kept["actuator_id"], kept["tested_ns"]) == (actuator_id, 1)
    _, rows = answer(archive, "select unit, model, actuator_id from health")
    assert sorted(rows) == sorted((unit, name, name) for unit, name in units.items())


def test_long_names_of_units_stay_distinct():
    units = {unit_name(name, serial) for name in NAMES for serial in ("1", "2", LONG, 3 * LONG)}
    assert len(units) == 4 * len(NAMES)
    assert unit_name("left flap", "2031/7") == "left flap+2031%2F7"
