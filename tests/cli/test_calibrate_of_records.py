"""``ema calibrate`` of records, one of which is not healthy."""

from pathlib import Path

import numpy as np
import pytest
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
    header = "time_s,position,command,current"
    np.savetxt(path, np.column_stack(columns), "%.6f", ",", header=header, comments="")
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six healthy records on two days, and one of a worn joint on the second day."""
    path = tmp_path_factory.mktemp("records")
    (path / "mapping.yaml").write_text(MAPPING)
    (path / "actuator.yaml").write_text(ACTUATOR)
    for number, one in enumerate(healthy_telemetry(days=2, a_day=3)):
        write(one, path / f"healthy_{number}.csv")
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
    assert "from 7 records on 2 days, 1 of them unlike the others" in result.stdout


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
