# SPDX-License-Identifier: Apache-2.0
"""`ema attach` on recordings: a baseline of the healthy records, and the level of later ones."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from ema_cli.bags.joint_course import WORK
from ema_cli.bags.robot_files import find_recordings
from ema_cli.processes import attach_run
from ema_sim.robot.arm import JOINT_NAMES
from ema_sim.robot.work import RobotArm, WorkSettings

from ..commands import ema

CONFIG = Path(__file__).parents[2] / "ros2_ws/src/ema_bringup/config/attach.yaml"
NOV_3 = 1_793_664_000
RATE = 100
WORN = {"wrist_2": 0.04}


def write_work(path: Path, arm: RobotArm, cycles: int, start_s: float, joints, **wear) -> None:
    """Write a recording of ``joints`` at work; the name "payload" adds the payload column."""
    logs = [
        arm.begin_cycle(WorkSettings(cycle_pause=0.5, healthy_cycles=0), wear)
        for _ in range(cycles)
    ]
    blocks = [block for cycle in logs for block in cycle.blocks]
    columns = [start_s + np.arange(sum(map(len, blocks))) / RATE]
    names = ["t"]
    for joint in joints:
        if joint == "payload":
            columns.append(np.concatenate([block.payload for block in blocks]))
            names.append(joint)
            continue
        i = JOINT_NAMES.index(joint)
        for name in ("position", "velocity", "effort"):
            columns.append(np.concatenate([getattr(block, name)[:, i] for block in blocks]))
            names.append(f"{joint}_{name}")
    table = np.column_stack(columns)
    formats = ["%.3f"] + ["%.8g"] * (len(names) - 1)
    np.savetxt(path, table, formats, ",", header=",".join(names), comments="")


@pytest.fixture(scope="module")
def work(tmp_path_factory) -> Path:
    """Return a folder with 8 healthy minutes, and 4 minutes a day later with a worn wrist."""
    folder = tmp_path_factory.mktemp("work")
    arm = RobotArm(seed=3, sample_rate=RATE)
    joints = ("base", "wrist_2")
    write_work(folder / "day_1.csv", arm, 24, NOV_3, joints)
    write_work(folder / "day_2.csv", arm, 12, NOV_3 + 86_400, joints, **WORN)
    return folder


def test_worn_joint_is_reported_and_the_healthy_one_is_not(work, tmp_path):
    page = tmp_path / "page.html"
    result = ema("attach", work, "--healthy", "2026-11-04", "--html", page, "--json")
    joints = {item["joint"]: item for item in json.loads(result.stdout)}
    assert set(joints) == {"base", "wrist_2"}
    assert joints["base"]["level"] == "OK", joints["base"]["reason"]
    assert joints["wrist_2"]["level"] == "WARN"
    changes = {item["name"]: item for item in joints["wrist_2"]["comparison"]["quantities"]}
    friction = changes["friction"]
    # The last record has two or three cycles, with friction of 1.40 to 1.48 times the healthy one.
    assert friction["judgement"] == "changed"
    assert 0.36 < friction["change"] < 0.5
    assert result.exit_code == 3
    text = page.read_text(encoding="utf-8")
    assert "Joints of" in text
    assert text.count("<svg") == 2
    assert text.index("wrist_2") < text.index("base")


def test_table_has_level_since_and_change_of_friction(work):
    result = ema("attach", work, "--healthy", "6", "--joint", "wrist_2")
    assert result.exit_code == 3
    heading, row, reason, *_ = result.stdout.splitlines()
    assert heading.split("  ")[0] == "joint"
    assert "▲ WARN  2026-11-04 00:" in row
    assert "6 healthy" in row
    assert reason.startswith("wrist_2: Coulomb friction rose")


def test_payload_makes_the_friction_of_a_loaded_joint_certain(tmp_path):
    """The friction of the elbow rises by 40 %, and is reported as friction."""
    reports = {}
    for name, joints in (("known", ["elbow", "payload"]), ("unknown", ["elbow"])):
        arm, folder = RobotArm(seed=5, sample_rate=RATE), tmp_path / name
        folder.mkdir()
        write_work(folder / "day_1.csv", arm, 12, NOV_3, joints)
        write_work(folder / "day_2.csv", arm, 10, NOV_3 + 86_400, joints, elbow=0.04)
        result = ema("attach", folder, "--healthy", "2026-11-04", "--json")
        [reports[name]] = json.loads(result.stdout)
        table = ema("attach", folder, "--healthy", "2026-11-04")
        advice = "effort outside the model makes the size of a change of friction uncertain"
        assert (advice in table.stdout) is (name == "unknown")
    changes = {
        name: [record["friction"] for record in joint["records"]] for name, joint in reports.items()
    }
    last = changes["known"][-1]
    assert 0.25 < last["low"] < last["change"] < last["high"] < 0.5
    width = {name: friction[-1]["high"] - friction[-1]["low"] for name, friction in changes.items()}
    assert width["known"] < 0.3 * width["unknown"]
    assert reports["known"]["level"] in ("WARN", "ERROR")


def test_healthy_joint_ends_with_exit_code_0(work):
    assert ema("attach", work, "--healthy", "6", "--joint", "base").exit_code == 0


def test_given_unit_of_the_effort_is_used(work, tmp_path):
    page = tmp_path / "page.html"
    arguments = ("--healthy", "6", "--joint", "wrist_2", "--effort-unit", "N.m")
    assert ema("attach", work, *arguments, "--html", page).exit_code == 3
    assert "kg.m^2" in page.read_text(encoding="utf-8")


def test_joint_without_a_later_record_is_not_judged(work):
    result = ema("attach", work / "day_1.csv", "--healthy", "2026-11-05")
    assert result.exit_code == 3
    assert "base: no record after the healthy ones" in result.stdout
    assert "2 joints, 2 of them not judged" in result.stdout


def test_healthy_end_before_all_records_is_refused_with_the_first_record(work):
    result = ema("attach", work, "--healthy", "2026-11-01")
    assert result.exit_code == 3
    assert "base: no record ends before --healthy: the first begins at 2026-11-03" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "code", "error"),
    [
        (["day_1.csv"], 2, "--healthy is missing: which of the records are healthy?"),
        (["day_1.csv", "--healthy", "soon"], 2, "expected a number of records such as 10"),
        (["day_1.csv", "--healthy", "5", "--namespace", "/x"], 2, "--namespace is for running"),
        (["none.csv", "--healthy", "5"], 1, "none.csv: no such file or folder"),
        (["day_1.csv", "--healthy", "5", "--html", "page.txt"], 2, "page.txt: expected a name"),
        (["--html", "page.html"], 2, "--html needs RECORDINGS"),
        (["--accept-after", "61"], 2, "61 is not in the range 0<=x<=60"),
    ],
)
def test_wrong_use_is_refused_with_what_is_expected(work, monkeypatch, arguments, code, error):
    monkeypatch.chdir(work)
    result = ema("attach", *arguments)
    assert result.exit_code == code
    assert error in result.stderr


def test_folder_without_a_recording_is_refused(tmp_path):
    result = ema("attach", tmp_path, "--healthy", "5")
    assert result.exit_code == 1
    assert "this folder contains no recording (a bag, .mcap, .db3, .csv" in result.stderr


def test_recordings_are_cut_like_live_motion():
    settings = yaml.safe_load(CONFIG.read_text())["/**/monitor"]["ros__parameters"]
    assert (
        settings.items() >= {"record_s": WORK.record_s, "record_rest_s": WORK.record_rest_s}.items()
    )


def test_numbers_in_names_determine_the_order_of_recordings(tmp_path):
    for name in ("run_10.csv", "run_2.csv", "run_1.csv"):
        (tmp_path / name).touch()
    names = [path.name for path in find_recordings([tmp_path])]
    assert names == ["run_1.csv", "run_2.csv", "run_10.csv"]


def test_joints_of_all_recordings_are_detected(work, tmp_path):
    """Each recording has a different joint and a different order of columns."""
    arm = RobotArm(seed=3, sample_rate=RATE)
    write_work(tmp_path / "a.csv", arm, 12, NOV_3, ["wrist_2"])
    write_work(tmp_path / "b.csv", arm, 12, NOV_3, ["base", "elbow"])
    result = ema("attach", tmp_path, "--healthy", "3", "--json")
    joints = {item["joint"]: item["healthy_records"] for item in json.loads(result.stdout)}
    assert joints == {"base": 3, "elbow": 3, tmp_path.name: 3}
    assert "warning" not in result.stderr
    selected = ema("attach", tmp_path, "--healthy", "3", "--json", "--joint", "el*")
    assert [item["joint"] for item in json.loads(selected.stdout)] == ["elbow"]
    missing = ema("attach", tmp_path, "--healthy", "3", "--joint", "hip")
    assert missing.exit_code == 1
    assert f"there is no joint 'hip': expected {tmp_path.name!r}, 'base'" in missing.stderr


def test_actuator_file_next_to_a_table_names_its_joint(tmp_path):
    arm = RobotArm(seed=3, sample_rate=RATE)
    write_work(tmp_path / "log.csv", arm, 12, NOV_3, ["wrist_2"])
    (tmp_path / "actuator.yaml").write_text(
        'actuator_id: hand\nserial_number: "4711"\ndrive: unknown\n'
    )
    result = ema("attach", tmp_path / "log.csv", "--healthy", "3", "--json")
    [joint] = json.loads(result.stdout)
    assert joint["joint"] == "hand"


def test_dated_recordings_are_sorted_by_time_and_unreadable_ones_are_named(work, tmp_path):
    """The later recording comes first by name, but its worn records are not used as healthy."""
    (tmp_path / "a.csv").write_bytes((work / "day_2.csv").read_bytes())
    (tmp_path / "b.csv").write_bytes((work / "day_1.csv").read_bytes())
    (tmp_path / "c.csv").write_text("x,y\n1,2\n")
    result = ema("attach", tmp_path, "--healthy", "6", "--joint", "wrist_2")
    assert "▲ WARN" in result.stdout
    assert f"warning: {tmp_path / 'c.csv'}: " in result.stderr


def test_healthy_records_with_rising_friction_are_doubted(tmp_path):
    arm = RobotArm(seed=3, sample_rate=RATE)
    write_work(tmp_path / "day.csv", arm, 36, NOV_3, ["wrist_2"], **WORN)
    result = ema("attach", tmp_path, "--healthy", "10")
    assert "warning: day: the healthy records may not be healthy: " in result.stderr


def test_oldest_runs_are_deleted_and_other_folders_remain(tmp_path):
    names = ("20251129T095444Z", "20261129T095444Z", "20261130T095444Z", "factory_acceptance")
    for name in names:
        (tmp_path / name).mkdir()
        (tmp_path / name / "data.mcap").write_bytes(bytes(6000))
        (tmp_path / name / "small.log").write_bytes(bytes(6))
    attach_run._limit_size(tmp_path, 21_000)
    assert sorted(path.name for path in tmp_path.iterdir()) == list(names[1:])
    attach_run._limit_size(tmp_path, 1)
    assert sorted(path.name for path in tmp_path.iterdir()) == list(names[2:])
