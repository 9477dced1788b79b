"""An archive holds what the commands for one bag and one unit say, to the bit."""

import json
import math
import subprocess

import numpy as np
import pyarrow as pa
import pytest

from ema_archive.manifest import Manifest
from ema_archive.running import scan
from ema_archive.tables import BAG_TABLES, estimate_from, estimate_row
from ema_core.faults import FAULT_NAMES
from ema_monitor.identification.estimate import estimate_record

from .conftest import exactly, rows_of_unit, table_of

pytestmark = pytest.mark.slow

SAME = ("cycles", "level", "health_index", "dominant_fault")


def units(archive):
    return sorted(table_of(archive, "units")["unit"].to_pylist())


def finite(value):
    return value if math.isfinite(value) else None


def test_estimates_are_those_of_the_command(ema, whole, made_fleet):
    compared = 0
    for number, unit in enumerate(units(whole)):
        folder = made_fleet / f"unit_{number}"
        rows = rows_of_unit(whole, "estimates", unit).to_pylist()
        calibration = ("--calibration", folder / "calibration.yaml")
        for bag in sorted(folder.glob("*.mcap")):
            result = ema("estimate", bag, "-p", "warm_start=false", *calibration, "--json")
            told = json.loads(result.stdout)
            kept = [row for row in rows if row["bag"] == str(bag)]
            assert len(kept) == len(told)
            for row, said in zip(kept, told, strict=True):
                record = estimate_record(estimate_from(row))
                del record["computing_time"]
                assert {name: said[name] for name in record} == record
                compared += 1
    assert compared >= 10


def test_health_and_life_are_those_of_the_command(ema, whole, made_fleet):
    for number, unit in enumerate(units(whole)):
        folder = made_fleet / f"unit_{number}"
        told = json.loads(ema("predict", folder, "-p", "warm_start=false", "--json").stdout)
        rows = rows_of_unit(whole, "health", unit).to_pylist()
        tests = [test for test in told["tests"] if "level" in test]
        assert len(rows) == len(tests) > 2
        for row, test in zip(rows, tests, strict=True):
            assert row["stamp_ns"] == test["end_ns"]
            for here, there in (("hours", "flight_hours"), *((n, n) for n in SAME)):
                assert row[here] == test[there], here
            assert [(event["kind"], event["hours"], event["text"]) for event in row["events"]] == [
                (event["kind"], event["flight_hours"], event["text"]) for event in test["events"]
            ]
            for life in ("rul", "rul_faults", "rul_requirements"):
                said = test[life]
                assert row[f"{life}_known"] == said["known"]
                for quantile in ("05", "50", "95"):
                    assert finite(row[f"{life}_{quantile}"]) == said[f"hours_{quantile}"]
        assert rows[-1]["severity"] == told["severity"]
        said = {item["name"]: item for item in (*told["faults"], *told["requirements"])}
        growth = rows_of_unit(whole, "growth", unit).to_pylist()
        assert {row["item"] for row in growth} == set(said)
        for row in growth:
            for name in ("value", "sigma", "limit"):
                assert finite(row[name]) == said[row["item"]][name]


def the_other_way_round(made_fleet, tmp_path):
    """Return an archive of the units in another order, nothing of it done."""
    other = tmp_path / "other"
    with Manifest(other, is_new=True) as manifest:
        scan(manifest, [str(made_fleet / "unit_1"), str(made_fleet / "unit_0")])
    return other


def assert_same(other, whole):
    for name in ("estimates", "usage", "duty", "health"):
        assert exactly(other, name) == exactly(whole, name), name


def test_executor_and_workers_change_nothing(ema, whole, made_fleet, tmp_path):
    other = the_other_way_round(made_fleet, tmp_path)
    done = ema("archive", "run", other, "--executor", "threads", "--workers", "2")
    assert done.stdout == (
        "10 bags done, 2 units followed; 0 damaged, 0 read in part, 0 could not be read\n"
        "2 of 10 windows refused, most of them: "
        "gap of 300 samples: index 44501 follows 44200\nall is up to date\n"
    )
    assert_same(other, whole)


@pytest.mark.long
def test_workers_of_dask_change_nothing(whole, made_fleet, tmp_path):
    other = the_other_way_round(made_fleet, tmp_path)
    # A process of its own: the threads of Dask's client stay until its end.
    command = ["ema", "archive", "run", other, "--executor", "dask", "--workers", "2"]
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert_same(other, whole)


def test_row_holds_every_figure_of_an_estimate_to_the_bit(whole):
    for row in rows_of_unit(whole, "estimates", units(whole)[0]).to_pylist():
        again = estimate_row(estimate_from(row), row["number"])
        table = pa.Table.from_pylist([again], BAG_TABLES["estimates"])
        for name in ("covariance", *FAULT_NAMES, "fitness", "unexplained_share"):
            np.testing.assert_array_equal(table[name].to_pylist()[0], row[name])
