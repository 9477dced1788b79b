# SPDX-License-Identifier: Apache-2.0
"""``ema calibrate`` on records with a record that is not healthy."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.monitor.joint.plant import Joint, Sensors, healthy_telemetry, telemetry_of, tones

from ema_core.telemetry import Telemetry

MAPPING = """\
position: {source: position, unit: rad}
command: {source: command, unit: rad}
current: {source: current, unit: A, kind: equivalent, sampling: instantaneous}
clock: {source: time_s}
"""
ACTUATOR = "actuator_id: joint\nserial_number: J1\nsample_period: 0.01\ndrive: unknown\n"


def write(telemetry: Telemetry, path: Path) -> Path:
    seconds = 1e-9 * telemetry.stamp_ns + telemetry.sample_period * np.arange(len(telemetry))
    columns = (seconds, telemetry.position, telemetry.command, telemetry.current)
    return write_rows(np.column_stack(columns), path)


def write_rows(rows: NDArray[Any], path: Path) -> Path:
    header = "time_s,position,command,current"
    np.savetxt(path, rows, "%.6f", ",", header=header, comments="")
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return six healthy records on two days, and a record of a worn joint on the second day."""
    path = tmp_path_factory.mktemp("records")
    (path / "mapping.yaml").write_text(MAPPING)
    (path / "actuator.yaml").write_text(ACTUATOR)
    for number, telemetry in enumerate(healthy_telemetry(days=2, a_day=3)):
        write(telemetry, path / f"healthy_{number}.csv")
    worn = Joint().times(coulomb=1.31)
    record = telemetry_of(worn, tones(), Sensors(), seed=5, day=1, second=500)
    write(record, path / "healthy_6.csv")
    return path


def test_record_unlike_the_others_is_named_with_its_change(ema, folder: Path):
    bags = sorted(folder.glob("healthy_*.csv"))
    result = ema("calibrate", *bags, "-o", folder / "all.yaml")
    assert result.exit_code == 0
    (warning,) = [line for line in result.stderr.splitlines() if line.startswith("warning: ")]
    assert warning.startswith(
        f"warning: {folder / 'healthy_6.csv'} differs from the other healthy records: "
        "Coulomb friction rose 3"
    )
    assert warning.endswith("Leave it out, or confirm that the unit was healthy")
    assert "from 7 records on 2 days, 1 outlier" in result.stdout


def test_records_like_each_other_are_calibrated_without_a_warning(ema, folder: Path):
    bags = sorted(folder.glob("healthy_[0-5].csv"))
    result = ema("calibrate", *bags, "-o", folder / "healthy.yaml")
    assert result.exit_code == 0
    assert "warning" not in result.stderr
    assert "from 6 records on 2 days:" in result.stdout


def test_record_that_cannot_be_used_is_named_with_the_reason(ema, folder: Path, tmp_path: Path):
    bags = sorted(folder.glob("healthy_[0-5].csv"))
    slow = telemetry_of(Joint(), tones(speed=0.3), Sensors(), seed=5, day=1, second=700)
    write(slow, folder / "slow.csv")
    result = ema("calibrate", *bags, folder / "slow.csv", "-o", tmp_path / "calibration.yaml")
    assert result.exit_code == 0
    assert f"warning: {folder / 'slow.csv'} is not used: the speed is 0.3" in result.stderr
    assert "from 6 records on 2 days:" in result.stdout


@pytest.fixture(scope="module")
def undated(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return healthy records with a worn record in third place; each begins at time 0.

    Without dates, the scatter between days is unknown: a record must differ by more to be named.
    """
    path = tmp_path_factory.mktemp("undated")
    for name in ("mapping.yaml", "actuator.yaml"):
        (path / name).write_text((folder / name).read_text())
    worn = telemetry_of(Joint().times(coulomb=1.6), tones(), Sensors(), seed=5)
    write(replace(worn, stamp_ns=0), path / "healthy_2.csv")
    for number, source in ((0, 0), (1, 1), (3, 2), (4, 3), (5, 4)):
        rows = np.loadtxt(folder / f"healthy_{source}.csv", delimiter=",", skiprows=1)
        rows[:, 0] -= rows[0, 0]
        write_rows(rows, path / f"healthy_{number}.csv")
    return path


def test_undated_file_is_named_if_it_differs_or_is_unused(ema, undated: Path):
    moved = telemetry_of(Joint(), tones(speed=0.3), Sensors(), seed=5)
    slow = write(replace(moved, stamp_ns=0), undated / "a_slow.csv")
    bags = [slow, *sorted(undated.glob("healthy_*.csv"))]
    result = ema("calibrate", *bags, "-o", undated / "all.yaml")
    assert result.exit_code == 0, result.stderr
    warnings = [line for line in result.stderr.splitlines() if line.startswith("warning: ")]
    assert len(warnings) == 2
    assert warnings[0].startswith(f"warning: {slow} is not used: the speed is 0.3")
    assert warnings[1].startswith(f"warning: {undated / 'healthy_2.csv'} differs from the other ")
    assert "from 6 records without a date, 1 outlier" in result.stdout


def test_time_since_the_start_of_a_clock_is_not_a_date(ema, undated: Path, tmp_path: Path):
    for name in ("mapping.yaml", "actuator.yaml"):
        (tmp_path / name).write_text((undated / name).read_text())
    for number in range(2):
        rows = np.loadtxt(undated / f"healthy_{number}.csv", delimiter=",", skiprows=1)
        rows[:, 0] += 5 * 86_400.0 + 600.0 * number
        write_rows(rows, tmp_path / f"healthy_{number}.csv")
    result = ema("calibrate", *sorted(tmp_path.glob("*.csv")), "-o", tmp_path / "all.yaml")
    assert result.exit_code == 0
    assert "from 2 records without a date" in result.stdout
    assert "healthy records have no date" in result.stdout


@pytest.mark.parametrize("slower", [1.025, 1.25])
def test_records_of_slightly_different_rates_are_calibrated_together(
    ema, undated: Path, tmp_path: Path, slower: float
):
    for name in ("mapping.yaml", "actuator.yaml"):
        (tmp_path / name).write_text((undated / name).read_text())
    for number in range(3):
        rows = np.loadtxt(undated / f"healthy_{number}.csv", delimiter=",", skiprows=1)
        rows[:, 0] *= slower if number == 2 else 1.0
        write_rows(rows, tmp_path / f"healthy_{number}.csv")
    result = ema("calibrate", *sorted(tmp_path.glob("*.csv")), "-o", tmp_path / "all.yaml")
    assert result.exit_code == 0, result.stderr
    assert "from 3 records" in result.stdout


def test_files_of_different_actuators_are_refused_with_the_fields_that_differ(
    ema, undated: Path, tmp_path: Path
):
    for number, text in enumerate((ACTUATOR, ACTUATOR.replace("J1", "J2"))):
        place = tmp_path / str(number)
        place.mkdir()
        (place / "actuator.yaml").write_text(text)
        (place / "mapping.yaml").write_text(MAPPING)
        rows = np.loadtxt(undated / f"healthy_{number}.csv", delimiter=",", skiprows=1)
        write_rows(rows, place / "healthy.csv")
    bags = [tmp_path / str(number) / "healthy.csv" for number in range(2)]
    result = ema("calibrate", *bags, "-o", tmp_path / "all.yaml")
    assert result.exit_code != 0
    assert f"serial_number J1 in {bags[0]}, J2 in {bags[1]}" in result.stderr
