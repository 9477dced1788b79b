# SPDX-License-Identifier: Apache-2.0
"""`ema baseline` works on a folder without a monitor, and sends requests to a running monitor."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from ema_cli.main import main
from ema_monitor.baselines.unit_baseline import UnitBaseline, default_folder

from ..monitor.baselines.healthy import JOINT, record

Ema = Callable[..., Result]


@pytest.fixture
def ema(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Ema:
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    return lambda *words: CliRunner().invoke(main, ["baseline", *map(str, words)])


def learned(folder: Path, count: int) -> None:
    with UnitBaseline(folder, JOINT) as baseline:
        for number in range(count):
            baseline.add(record(number, day=number // 3))


def test_joint_is_listed_shown_accepted_extended_and_reset(ema: Ema, tmp_path: Path):
    learned(tmp_path, 6)
    listed = ema("list", "--folder", tmp_path)
    assert listed.exit_code == 0, listed.output
    [row] = [line for line in listed.output.splitlines() if line.startswith("elbow/1")]
    assert row.split()[:5] == ["elbow/1", "7", "LEARNING", "6", "2"]
    shown = ema("show", "elbow/1", "--folder", tmp_path).output
    assert "changes of friction above" in shown
    assert "no change so far" in shown
    accepted = ema("accept", "elbow/1", "--folder", tmp_path, "--person", "Ada", "--note", "new")
    assert accepted.exit_code == 0, accepted.output
    assert "accept by Ada, 6 records" in accepted.output
    row = ema("list", "--folder", tmp_path).output.splitlines()[1]
    assert row.split()[2] == "ACCEPTED"
    assert "Ada, 20" in row
    again = ema("accept", "elbow/1", "--folder", tmp_path, "--person", "Ada")
    assert again.exit_code == 1
    assert "extend it, or reset it first" in again.output
    learned(tmp_path, 8)
    assert ema("extend", "elbow/1", "--folder", tmp_path, "--person", "Bob").exit_code == 0
    assert ema("reset", "elbow/1", "--folder", tmp_path, "--person", "Cy").exit_code == 0
    shown = ema("show", "elbow/1", "--folder", tmp_path).output
    assert "LEARNING" in shown
    assert [word for word in ("Ada", "Bob", "Cy") if word in shown] == ["Ada", "Bob", "Cy"]


def test_unknown_joint_is_refused_with_the_nearest_name(ema: Ema, tmp_path: Path):
    learned(tmp_path, 1)
    refused = ema("show", "elbow1", "--folder", tmp_path)
    assert refused.exit_code == 1
    assert "did you mean 'elbow/1'?" in refused.output


def test_person_is_the_login_name_by_default(
    ema: Ema, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("LOGNAME", "grace")
    learned(tmp_path, 4)
    assert "by grace" in ema("accept", "elbow/1", "--folder", tmp_path).output


def test_baseline_in_use_by_another_process_is_not_changed(ema: Ema, tmp_path: Path):
    learned(tmp_path, 4)
    with UnitBaseline(tmp_path, JOINT):
        refused = ema("accept", "elbow/1", "--folder", tmp_path)
    assert refused.exit_code == 1
    assert "uses this baseline" in refused.output


def test_default_folder_follows_ros_home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    assert default_folder() == tmp_path / "ema" / "baselines"
    monkeypatch.delenv("ROS_HOME")
    assert default_folder() == Path("~/.ros/ema/baselines").expanduser()


@pytest.mark.slow
def test_without_a_monitor_the_default_folder_is_read(ema: Ema, tmp_path: Path):
    learned(tmp_path / "ema" / "baselines", 3)
    listing = subprocess.run(
        ["ema", "baseline", "list"], capture_output=True, text=True, check=True
    )
    assert "elbow/1" in listing.stdout
