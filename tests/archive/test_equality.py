"""An archive holds what the commands for one bag and one unit say, to the bit."""

import json
import math
import subprocess

import numpy as np
import pyarrow as pa
import pytest

from ema_archive.manifest import Manifest
from ema_archive.partitions import read_unit
from ema_archive.running import scan
from ema_archive.tables import ESTIMATES, estimate_from, estimate_row
from ema_core.faults import FAULT_NAMES
from ema_monitor.identification.estimate import estimate_record

from .conftest import exactly, table_of


@pytest.fixture(scope="module")
def archive(ema, made_fleet, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "archive"
    assert ema("archive", "scan", folder, made_fleet).exit_code == 0
    result = ema("archive", "run", folder, "--workers", "2")
    assert result.exit_code == 0, result.output
    assert result.stdout.endswith("all is up to date\n")
    return folder


def units(archive):
    with Manifest(archive, writes=False) as manifest:
        return [known.entry for known in manifest.units()]


@pytest.mark.slow
def test_estimates_are_those_of_the_command(ema, archive, made_fleet):
    compared = 0
    for number, entry in enumerate(units(archive)):
        folder = made_fleet / f"unit_{number}"
        rows = read_unit(archive, "estimates", entry.unit).to_pylist()
        for bag in sorted(folder.glob("*.mcap")):
            told = json.loads(
                ema(
                    "estimate",
                    bag,
                    "--no-warm-start",
                    "--calibration",
                    folder / "calibration.yaml",
                    "--json",
                ).stdout
            )
            kept = [row for row in rows if row["bag"] == str(bag)]
            assert len(kept) == len(told)
            for row, said in zip(kept, told, strict=True):
                record = estimate_record(estimate_from(row))
                record["play_offset"] = record.pop("play")
                record["calibration"] = record.pop("calibration_id")
                del record["computing_time_s"]
                assert {name: said[name] for name in record} == record
                compared += 1
    assert compared >= 10


@pytest.mark.slow
def test_health_and_life_are_those_of_the_command(ema, archive, made_fleet):
    for number, entry in enumerate(units(archive)):
        told = json.loads(
            ema("prognose", made_fleet / f"unit_{number}", "--no-warm-start", "--json").stdout
        )
        rows = table_of(archive, "health").to_pylist()
        rows = [row for row in rows if row["serial_number"] == entry.serial_number]
        rows.sort(key=lambda row: row["stamp_ns"])
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
                    value = row[f"{life}_{quantile}"]
                    assert (value if math.isfinite(value) else None) == said[f"hours_{quantile}"]
        assert rows[-1]["severity"] == told["severity"]
        growth = archive / "tables" / "growth.parquet"
        said = {item["name"]: item for item in (*told["faults"], *told["requirements"])}
        kept = [row for row in table_of_file(growth) if row["unit"] == entry.unit]
        assert {row["item"] for row in kept} == set(said)
        for row in kept:
            for name, value in (("value", "value"), ("sigma", "sigma"), ("limit", "limit")):
                here = row[name] if math.isfinite(row[name]) else None
                assert here == said[row["item"]][value]


SAME = ("cycles", "level", "health_index", "dominant_fault")


def table_of_file(path):
    import pyarrow.parquet as pq

    return pq.read_table(path).to_pylist()


@pytest.mark.slow
@pytest.mark.parametrize(
    "where",
    [
        ("threads", "--workers", "2"),
        pytest.param(("dask", "--workers", "2"), marks=pytest.mark.long),
    ],
    ids=lambda where: where[0],
)
def test_executor_and_workers_change_nothing(archive, made_fleet, tmp_path, where):
    other = tmp_path / "other"
    with Manifest(other, is_new=True) as manifest:
        # The units the other way round.
        scan(manifest, [str(made_fleet / "unit_1"), str(made_fleet / "unit_0")])
    # A process of its own: the threads of Dask's client stay until its end.
    done = subprocess.run(
        ["ema", "archive", "run", other, "--executor", *where],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("10 bags done, 2 units followed; 0 damaged, 0 could not be read")
    for name in ("estimates", "usage", "health"):
        assert exactly(other, name) == exactly(archive, name), name


def test_row_holds_every_figure_of_an_estimate_to_the_bit(archive):
    table = read_unit(archive, "estimates", units(archive)[0].unit)
    for row in table.to_pylist():
        estimate = estimate_from(row)
        again = pa.Table.from_pylist([estimate_row(estimate, row["number"])], ESTIMATES)
        for name in ("covariance", *FAULT_NAMES, "fitness", "unexplained_share"):
            np.testing.assert_array_equal(again[name].to_pylist()[0], row[name])
