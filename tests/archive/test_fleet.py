# SPDX-License-Identifier: Apache-2.0
"""The summary of a fleet agrees with the tables of its archive."""

import json
import math
import re
from dataclasses import asdict
from datetime import UTC, datetime, timedelta

import pyarrow as pa
import pytest

from ema_archive.fleet import fleet_summary, survival
from ema_archive.store import Store
from ema_archive.unit_task import _windows, lives_of
from ema_core.faults import FAULT_NAMES

from ..pages import Page
from .conftest import write_rows

LATEST = datetime(2031, 5, 20, tzinfo=UTC)
# Remission under 6-MP [weeks], and whether it ended (Freireich et al., 1963): a textbook case.
WEEKS = (6, 6, 6, 6, 7, 9, 10, 10, 11, 13, 16, 17, 19, 20, 22, 23, 25, 32, 32, 34, 35)
ENDED = (1, 1, 1, 0, 1, 0, 1, 0, 0, 1, 1, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0)
SHARES = {6: 0.857, 7: 0.807, 10: 0.753, 13: 0.690, 16: 0.627, 22: 0.538, 23: 0.448}


def test_survival_agrees_with_the_textbook_case():
    steps = survival([0.0] * len(WEEKS), WEEKS, [bool(ended) for ended in ENDED])
    # The reference is published with three decimals.
    assert {step.age: round(step.share, 3) for step in steps} == SHARES
    assert [step.at_risk for step in steps] == [21, 17, 15, 12, 11, 7, 6]
    assert all(0.0 < step.lower < step.share < step.upper < 1.0 for step in steps)


def test_surviving_share_is_zero_when_all_have_failed():
    (step,) = survival([0.0, 5.0], [7.0, 5.0], [True, True])
    assert (step.age, step.at_risk, step.share) == (7.0, 1, 0.0)
    assert math.isnan(step.lower)
    assert math.isnan(step.upper)
    assert survival([], [], []) == []


def test_a_repair_begins_another_life_which_ends_at_its_first_error():
    def test(hours, level, kind=""):
        events = [{"kind": kind}] if kind else []
        return {"flight_hours": hours, "level": level, "events": events}

    health = [
        *(test(50.0, 0), test(90.0, 2), test(95.0, 2), test(math.nan, 0, "repair")),
        *(test(100.0, 0), test(130.0, 1, "step")),
    ]
    first, second = lives_of(health)
    assert (first["begin_hours"], first["from_age"], first["to_age"]) == (0.0, 50.0, 90.0)
    assert (second["begin_hours"], second["from_age"], second["to_age"]) == (100.0, 0.0, 30.0)
    assert (first["has_failed"], second["has_failed"]) == (True, False)


# Level, service hours, median life [h], health index, days since the last test, days since the
# calibration
UNITS = (
    (0, 120.0, 900.0, 0.9, 0, None),
    (1, 180.0, 50.0, 0.4, 2, 10),
    (2, 640.0, 0.0, 0.0, 20, 400),
    (2, 660.0, math.inf, 0.1, 100, 50),
    (3, 700.0, math.nan, math.nan, 3, 0),
)


def test_most_informative_copy_of_a_test_counts_and_contradicting_tests_are_refused():
    def row(bag, end_ns, verdict, *, valid):
        rest = {"start_ns": end_ns - 5, "end_ns": end_ns, "number": 0, "fitness": 0.0}
        reported = {"bag": bag, "verdict": verdict, "valid": valid, "reason": verdict}
        return rest | reported | dict.fromkeys(FAULT_NAMES, 0.0)

    copies = [row(verdict, 10, verdict, valid=False) for verdict in ("refused", "departed")]
    copies += [row("valid", 10, "valid", valid=True), row("failed", 10, "failed", valid=False)]
    for count in range(1, 5):
        (windows,), _ = _windows(pa.Table.from_pylist(copies[:count]))
        assert windows["verdict"] == copies[count - 1]["verdict"]
    # Two different tests at the same time.
    rows = [row("a", 10, "departed", valid=True), row("b", 12, "valid", valid=True)]
    windows, refused = _windows(pa.Table.from_pylist(rows))
    assert [window["verdict"] for window in windows] == ["departed", "refused"]
    assert [window["valid"] for window in windows] == [False, False]
    assert [window["bag"] for window in refused] == ["a", "b"]


@pytest.fixture
def archive(tmp_path):
    units = [
        {
            "actuator_id": "flap",
            "serial_number": str(number),
            "level": level,
            "flight_hours": hours,
            "rul": {"known": not math.isnan(median), "hours_50": median},
            "health_index": index,
            "tested": LATEST - timedelta(days=ago),
            "calibrated": None if age is None else LATEST - timedelta(days=ago + age),
        }
        for number, (level, hours, median, index, ago, age) in enumerate(UNITS)
    ]
    lives = [
        {"from_age": 0.0, "to_age": hours, "has_failed": level == 2} for level, hours, *_ in UNITS
    ]
    archive = tmp_path / "archive"
    for number, row in enumerate(units):
        write_rows(archive, "units", [row], f"flap+{number}", "F" if number else "E")
    write_rows(archive, "lives", lives)
    for unit, month, valid in (("a", "2031-04", 9), ("a", "2031-05", 8), ("b", "2031-05", 10)):
        write_rows(archive, "months", [{"month": month, "windows": 10, "valid": valid}], unit, "F")
    return archive


def test_fleet_summary_agrees_with_its_tables(archive):
    summary = fleet_summary(archive, most=3)
    assert summary.levels == {
        **{"units": 5, "latest_test": "2031-05-20T00:00:00Z"},
        **{"ok": 1, "warn": 1, "error": 2, "stale": 1, "health_index": 0.25},
    }
    assert [row["serial_number"] for row in summary.worst] == ["2", "3", "1"]
    # JSON has no infinity: the median of a life without an end is None.
    assert [row["rul"]["hours_50"] for row in summary.worst] == [0.0, None, 50.0]
    first, second = summary.models
    assert (first["model"], first["units"], first["error"], first["rul_50"]) == ("F", 4, 2, 50.0)
    assert (second["model"], second["units"], second["health_index"]) == ("E", 1, 0.9)
    ages = [(row["from_hours"], row["to_hours"], row["units"]) for row in summary.ages]
    assert ages == [(100.0, 200.0, 2), (600.0, 700.0, 2), (700.0, 800.0, 1)]
    assert [row["age"] for row in summary.survival] == [640.0, 660.0]
    assert [row["share"] for row in summary.survival] == pytest.approx([2 / 3, 1 / 3], rel=1e-12)
    assert (summary.lives, summary.failures, summary.longest_age) == (5, 2, 700.0)
    assert [(row["age"], row["units"]) for row in summary.calibrations] == [
        ("below 30 days", 2),
        ("30 to 90 days", 1),
        ("365 days or more", 1),
        ("no date", 1),
    ]
    assert [(row["days"], row["tested"], row["units"]) for row in summary.recent] == [
        *((1, 1, 5), (7, 3, 5), (30, 4, 5), (90, 4, 5))
    ]
    assert summary.months == [
        {"month": "2031-04", "tested": 1, "units": 1, "windows": 10, "valid": 9},
        {"month": "2031-05", "tested": 2, "units": 2, "windows": 20, "valid": 18},
    ]
    json.dumps(asdict(summary), allow_nan=False)


def test_a_fleet_without_tests_has_a_summary(tmp_path):
    archive = tmp_path / "archive"
    with pytest.raises(ValueError, match="is not an archive"):
        fleet_summary(archive)
    with Store(archive, is_new=True):
        pass
    summary = fleet_summary(archive)
    assert (summary.levels["units"], summary.lives) == (0, 0)
    assert summary.worst == summary.survival == []


def test_size_and_time_of_a_summary_are_limited(archive):
    for most in (0, 1001):
        with pytest.raises(ValueError, match=f"most = {most}: expected 1 to 1000"):
            fleet_summary(archive, most)
    rows = [{"from_age": 0.0, "to_age": 1.0 + i % 97, "has_failed": False} for i in range(400_000)]
    write_rows(archive, "lives", rows)
    with pytest.raises(ValueError, match=r"takes more than 1e-05 s"):
        fleet_summary(archive, limit_s=1e-5)


def test_the_report_of_a_fleet_agrees_with_its_summary(archive, ema, tmp_path):
    path = tmp_path / "fleet.html"
    result = ema("report", "--fleet", archive, "-o", path)
    assert result.exit_code == 0, result.output
    page, summary = Page(path), fleet_summary(archive)
    names = ("units", "error", "warn", "stale", "ok", "health_index")
    for caption, rows in (("Units by model", summary.models), ("Units by service", summary.ages)):
        assert page.exactly(caption) == [
            [row[name] for name in names if row[name] is not None] for row in rows
        ]
    assert [row[-1] for row in page.exactly("By level")] == [
        row["flight_hours"] for row in summary.worst
    ]
    assert page.exactly("Age of the calibration") == [
        [row["units"]] for row in summary.calibrations
    ]
    assert [row[0] for row in page.exactly("Units tested in")] == [1.0, 3.0, 4.0, 4.0]
    assert "Of 5 lives 2 ended; 33.3 % live beyond 660 service hours." in page.words
    assert not re.search(r"(?:src|href)=\"(?!#)", page.text)
    assert ema("report", "--fleet", archive, "-o", path).exit_code != 0
    assert ema("report", "--fleet", archive, "--replace", "-o", path).exit_code == 0


def test_the_report_of_a_fleet_without_a_valid_test_states_so_and_shows_nothing_else(ema, tmp_path):
    empty, refused = tmp_path / "empty", tmp_path / "refused"
    unit = {"actuator_id": "flap", "serial_number": "1"}
    stale = unit | {
        "level": 3,
        "last_level": 3,
        "rul": {"known": False},
        "reason": "no calibration",
    }
    month = {"month": "2031-04", "windows": 4, "valid": 0}
    for folder, rows in ((empty, {"units": []}), (refused, {"units": [stale], "months": [month]})):
        for name in rows:
            write_rows(folder, name, rows[name], "flap+1", "F")
        assert ema("report", "--fleet", folder, "-o", f"{folder}.html").exit_code == 0
    pages = [(tmp_path / f"{name}.html").read_text() for name in ("empty", "refused")]
    for page in pages:
        assert "No window has a valid estimate" in page
        assert "No unit has a test with known service hours." in page
        assert "<svg" not in page
        assert '<th scope="col">units</th><th scope="col">units</th>' not in page
    assert "4 refused" in pages[1]
    assert "no calibration" in pages[1]
    assert "Units by model" not in pages[0]
