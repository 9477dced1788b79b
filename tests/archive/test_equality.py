# SPDX-License-Identifier: Apache-2.0
"""An archive holds, bit for bit, the results of the commands for single bags and units."""

import json
import subprocess

import numpy as np
import pyarrow as pa
import pytest

from ema_archive.manifest import Manifest
from ema_archive.running import scan
from ema_archive.tables import BAG_TABLES, estimate_from, estimate_row
from ema_cli.show.prognosis_table import as_values
from ema_core.faults import FAULT_NAMES
from ema_monitor.identification.estimate import estimate_record

from .conftest import exactly, rows_of_unit, table_of

pytestmark = pytest.mark.slow

RECORD = (
    *("flight_hours", "cycles", "level", "health_index", "dominant_fault", "events"),
    *("rul_faults", "rul_requirements", "rul"),
)
EVENTS = {"events"}
"""Not compared for the newest message: its events are those after the previous message."""


def units(archive):
    return sorted(table_of(archive, "units")["unit"].to_pylist())


def in_columns(value):
    """Return a value of a record in the layout of an archive, where a stamp is in whole
    nanoseconds.
    """
    if isinstance(value, list):
        return [in_columns(item) for item in value]
    return columns_of(value) if isinstance(value, dict) else value


def columns_of(record):
    columns = {}
    for name, item in record.items():
        is_stamp = isinstance(item, dict) and item.keys() == {"sec", "nanosec"}
        nanoseconds = 1_000_000_000 * item["sec"] + item["nanosec"] if is_stamp else None
        columns |= {f"{name}_ns": nanoseconds} if is_stamp else {name: in_columns(item)}
    return columns


def test_archived_estimates_equal_those_of_the_command(ema, whole, made_fleet):
    compared = 0
    for number, unit in enumerate(units(whole)):
        folder = made_fleet / f"unit_{number}"
        rows = rows_of_unit(whole, "estimates", unit).to_pylist()
        calibration = ("--calibration", folder / "calibration.yaml")
        for bag in sorted(folder.glob("*.mcap")):
            result = ema("estimate", bag, "-p", "warm_start=false", *calibration, "--json")
            report_made = json.loads(result.stdout)
            kept = [row for row in rows if row["bag"] == str(bag)]
            assert len(kept) == len(report_made)
            for row, printed in zip(kept, report_made, strict=True):
                record = estimate_record(estimate_from(row))
                del record["computing_time"]
                assert {name: printed[name] for name in record} == record
                compared += 1
    assert compared >= 10


def test_archived_health_and_life_equal_those_of_the_command(ema, whole, made_fleet):
    for number, unit in enumerate(units(whole)):
        folder = made_fleet / f"unit_{number}"
        report_made = json.loads(ema("predict", folder, "-p", "warm_start=false", "--json").stdout)
        rows = rows_of_unit(whole, "health", unit).to_pylist()
        tests = [test for test in report_made["tests"] if "level" in test]
        assert len(rows) == len(tests) > 2
        for row, test in zip(rows, tests, strict=True):
            assert row["tested_ns"] == test["end_ns"]
            compared = {name: value for name, value in as_values(row).items() if name in RECORD}
            assert {name: in_columns(test[name]) for name in RECORD} == compared
        reported, newest = columns_of(report_made), as_values(rows[-1])
        names = newest.keys() & reported.keys() - EVENTS
        assert {*RECORD, "severity", "removal_days", "tested_ns", "reason"} - EVENTS <= names
        assert {name: newest[name] for name in names} == {name: reported[name] for name in names}
        printed = {
            item["name"]: item for item in (*report_made["faults"], *report_made["requirements"])
        }
        growth = rows_of_unit(whole, "growth", unit).to_pylist()
        assert {row["name"] for row in growth} == set(printed)
        for row in growth:
            of_item = {
                name: value for name, value in printed[row["name"]].items() if name != "unit"
            }
            assert {name: as_values(row)[name] for name in of_item} == of_item


def scanned_in_reverse(made_fleet, tmp_path):
    """Return an archive of the units in reverse order, scanned but not run."""
    archive = tmp_path / "other"
    with Manifest(archive, is_new=True) as manifest:
        scan(manifest, [str(made_fleet / "unit_1"), str(made_fleet / "unit_0")])
    return archive


def assert_same(archive, whole):
    for name in ("estimates", "usage", "duty", "health"):
        assert exactly(archive, name) == exactly(whole, name), name


def test_results_do_not_depend_on_executor_or_workers(ema, whole, made_fleet, tmp_path):
    archive = scanned_in_reverse(made_fleet, tmp_path)
    done = ema("archive", "run", archive, "--executor", "threads", "--workers", "2")
    assert done.stdout == (
        "10 bags and 2 units processed; 0 damaged, 0 read in part, 0 unreadable\n"
        "2 of 10 windows refused, most often because: "
        "gap of 300 samples: index 44501 follows 44200\neverything is up to date\n"
    )
    assert_same(archive, whole)


@pytest.mark.long
def test_workers_of_dask_give_the_same_results(whole, made_fleet, tmp_path):
    archive = scanned_in_reverse(made_fleet, tmp_path)
    # In a separate process: the threads of Dask's client run until the process ends.
    command = ["ema", "archive", "run", archive, "--executor", "dask", "--workers", "2"]
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert_same(archive, whole)


def test_row_holds_every_number_of_an_estimate_exactly(whole):
    for row in rows_of_unit(whole, "estimates", units(whole)[0]).to_pylist():
        again = estimate_row(estimate_from(row), row["number"])
        table = pa.Table.from_pylist([again], BAG_TABLES["estimates"])
        for name in ("covariance", *FAULT_NAMES, "fitness", "unexplained_share"):
            np.testing.assert_array_equal(table[name].to_pylist()[0], row[name])
