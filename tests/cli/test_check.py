# SPDX-License-Identifier: Apache-2.0
"""``ema check`` recognises the columns of joints in ordinary log files."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from click.testing import Result

from ema_bags import read_telemetry
from ema_core.telemetry import join

from ..inputs import lerobot_data_set
from ..inputs.joint_motion import TAU, moves
from ..inputs.other_makes import OtherBag

DEG = 180.0 / np.pi
RPM = 30.0 / np.pi
REAL = Path(__file__).parents[2] / "bags" / "real"
MOTION = {"position": 1.0, "command": 1.0, "speed": 1.0, "current": 1.0}
Columns = Mapping[str, Any]


def motion(number: int, seconds: float = 16.0, rate_hz: float = 200.0) -> dict[str, Any]:
    """Return the columns of a joint in SI units; each joint number moves at different times."""
    cycle = round(1.2 * rate_hz)
    columns, stamps = moves(seconds + 1.2, rate_hz, 0.5 + 0.1 * number, number)
    start = (37 * number) % cycle
    part = slice(start, start + round(seconds * rate_hz))
    columns["speed"] = TAU * columns["speed"]
    selected = {name: values[part] for name, values in columns.items()}
    return selected | {"time": 1e-9 * (stamps[: len(selected["position"])] - stamps[0])}


def table(joints: Mapping[str, int], names: Mapping[str, tuple[str, float]]) -> dict[str, Any]:
    """Return the columns of joints by name; a template maps a quantity to a name and a factor."""
    return {
        template.format(joint=joint): motion(number)[quantity] * factor
        for joint, number in joints.items()
        for template, (quantity, factor) in names.items()
    }


def numbered(count: int) -> dict[str, int]:
    return {str(number + 1): number for number in range(count)}


ONE = motion(0)
RNG = np.random.default_rng(5)
FORMS: dict[str, tuple[Columns, dict[str, Any]]] = {
    "robotics": (
        {"time": ONE["time"], "q": ONE["position"], "qd": ONE["speed"], "q_cmd": ONE["command"]}
        | {"tau": ONE["current"]},
        {"position": "q", "speed": "qd", "command": "q_cmd", "current": "tau"},
    ),
    "desired position named as a speed": (
        {"t": ONE["time"], "q": ONE["position"], "qd": ONE["command"], "dq": ONE["speed"]}
        | {"tau": ONE["current"]},
        {"position": "q", "speed": "dq", "command": "qd", "current": "tau"},
    ),
    "one joint of seven": (
        {"t": ONE["time"], "q7": ONE["position"], "dq7": ONE["speed"]},
        {"position": "q7", "speed": "dq7"},
    ),
    "seven joints": (
        {"t": ONE["time"]}
        | table(
            numbered(7),
            {
                "q{joint}": ("position", 1.0),
                "dq{joint}": ("speed", 1.0),
                "tau{joint}": ("current", 1.0),
            },
        ),
        {"position": "q{joint}", "speed": "dq{joint}", "current": "tau{joint}"}
        | {"joints": list(numbered(7))},
    ),
    "machine tool": (
        {"Timestamp": ONE["time"]}
        | table(
            {"X": 0, "Y": 1, "Z": 2},
            {
                "{joint}_SetPosition": ("command", 1e3),
                "{joint}_ActualPosition": ("position", 1e3),
                "{joint}_ActualVelocity": ("speed", 1e3),
                "{joint}_CurrentFeedback": ("current", 1.0),
            },
        ),
        {
            "position": "{joint}_ActualPosition",
            "command": "{joint}_SetPosition",
            "speed": "{joint}_ActualVelocity",
            "current": "{joint}_CurrentFeedback",
            "joints": ["X", "Y", "Z"],
        },
    ),
    "one axis of a machine tool": (
        {"t": ONE["time"], "X_SetPosition": ONE["command"], "X_ActualPosition": ONE["position"]},
        {"position": "X_ActualPosition", "command": "X_SetPosition"},
    ),
    "desired and actual": (
        {"t": ONE["time"], "posDes": ONE["command"] * DEG, "posAct": ONE["position"] * DEG}
        | {"cur": ONE["current"]},
        {"position": "posAct", "command": "posDes", "current": "cur"},
    ),
    "commanded current": (
        {"Time (s)": ONE["time"], "position [deg]": ONE["position"] * DEG}
        | {"q-axis cmd [A]": ONE["current"]},
        {"position": "position [deg]", "current": "q-axis cmd [A]"},
    ),
    "German": (
        {"Zeit [ms]": ONE["time"] * 1e3, "Soll [grad]": ONE["command"] * DEG}
        | {"Ist [grad]": ONE["position"] * DEG, "Drehzahl [1/min]": ONE["speed"] * RPM}
        | {"Strom [mA]": ONE["current"] * 1e3},
        {"position": "Ist [grad]", "command": "Soll [grad]", "speed": "Drehzahl [1/min]"}
        | {"current": "Strom [mA]"},
    ),
    "legs": (
        {"t": ONE["time"]}
        | table(
            {"FR_hip": 0, "FR_thigh": 1, "RL_hip": 2},
            {
                "{joint}_q": ("position", 1.0),
                "{joint}_dq": ("speed", 1.0),
                "{joint}_tauEst": ("current", 1.0),
            },
        ),
        {"position": "{joint}_q", "speed": "{joint}_dq", "current": "{joint}_tauEst"}
        | {"joints": ["FR_hip", "FR_thigh", "RL_hip"]},
    ),
    "real-time interface of an arm": (
        {"timestamp": 1.7e9 + ONE["time"]}
        | table(
            {str(number): number for number in range(6)},
            {
                "target_q_{joint}": ("command", 1.0),
                "actual_q_{joint}": ("position", 1.0),
                "actual_qd_{joint}": ("speed", 1.0),
                "actual_current_{joint}": ("current", 1.0),
            },
        ),
        {"position": "actual_q_{joint}", "command": "target_q_{joint}"}
        | {"speed": "actual_qd_{joint}", "current": "actual_current_{joint}"}
        | {"joints": [str(number) for number in range(6)]},
    ),
    "units in brackets": (
        {"t [us]": ONE["time"] * 1e6}
        | table(
            numbered(2),
            {
                "J{joint} [A]": ("current", 1.0),
                "J{joint} [deg]": ("position", DEG),
                "J{joint} [deg/s]": ("speed", DEG),
            },
        ),
        {"position": "J{joint} [deg]", "speed": "J{joint} [deg/s]", "current": "J{joint} [A]"}
        | {"joints": ["1", "2"]},
    ),
    "registers of a servo": (
        {"time": ONE["time"]}
        | {"present_position": np.round(2048 + ONE["position"] * 4096 / (2 * np.pi))}
        | {"goal_position": np.round(2048 + ONE["command"] * 4096 / (2 * np.pi))}
        | {"present_current": np.round(ONE["current"] / 2.69e-3)},
        {"position": "present_position", "command": "goal_position"}
        | {"current": "present_current"},
    ),
    "motor and joint": (
        {"t_us": np.round(ONE["time"] * 1e6), "motor_pos": 50 * ONE["position"]}
        | {"joint_pos": ONE["position"] + RNG.normal(0.0, 1e-4, len(ONE["time"]))}
        | {"motor_current": ONE["current"], "motor_temp": 25.0 + np.round(ONE["time"]) / 10.0},
        {"position": "joint_pos", "current": "motor_current", "temperature": "motor_temp"},
    ),
    "voltages and names of none": (
        {"c0": ONE["time"], "c1": ONE["current"], "c2": ONE["position"], "c3": ONE["speed"]}
        | {"c4": ONE["command"]},
        {"position": "c2", "speed": "c3", "command": "c4", "current": "c1"},
    ),
    "arms of a robot": (
        {"t": ONE["time"]}
        | table(
            {"left_elbow": 0, "right_elbow": 1, "left_wrist": 2},
            {
                "{joint}.position": ("position", 1.0),
                "{joint}.velocity": ("speed", 1.0),
                "{joint}.effort": ("current", 1.0),
            },
        ),
        {"position": "{joint}.position", "speed": "{joint}.velocity"}
        | {"current": "{joint}.effort", "joints": ["left_elbow", "right_elbow", "left_wrist"]},
    ),
}
SECTIONS = ("position", "command", "speed", "current", "temperature")


def checked(ema: Callable[..., Result], path: Path, *words: str) -> dict[str, Any]:
    result = ema("check", path, *words, "--json")
    assert result.exit_code in (0, 3), result.output
    [examination] = json.loads(result.stdout)
    return examination


@pytest.mark.parametrize("form", FORMS)
def test_columns_of_every_joint_are_recognised(ema, tmp_path, form):
    columns, expected = FORMS[form]
    path = tmp_path / "log.csv"
    separator, decimal = (";", ",") if form == "German" else (",", ".")
    pd.DataFrame(columns).to_csv(path, index=False, sep=separator, decimal=decimal)
    examination = checked(ema, path)
    [mapping] = map(yaml.safe_load, examination["mappings"])
    sources = {name: mapping[name]["source"] for name in SECTIONS if name in mapping}
    if "joints" in mapping:
        sources["joints"] = mapping["joints"]
    assert sources == expected
    assert len(examination["joints"]) == len(expected.get("joints", [""]))


def test_commanded_current_is_not_read_as_a_position_and_is_doubted(ema, tmp_path):
    pd.DataFrame(FORMS["commanded current"][0]).to_csv(tmp_path / "log.csv", index=False)
    [joint] = checked(ema, tmp_path / "log.csv")["joints"]
    [current] = [item for item in joint["columns"] if item["quantity"] == "current"]
    assert "set_point" in [doubt["kind"] for doubt in current["doubts"]]
    assert not any(item["quantity"] == "command" for item in joint["columns"])


def test_lags_quantisation_steps_and_lost_samples_are_measured(ema, tmp_path):
    columns = dict(ONE)
    columns["position"] = 0.001 * np.round(columns["position"] / 0.001)
    columns["speed"] = np.roll(columns["speed"], 8)
    columns["current"] = np.clip(columns["current"], -0.9, 0.9)
    frame = pd.DataFrame(columns).drop(index=[*range(500, 504), *range(900, 903)])
    frame["time"] += np.random.default_rng(1).normal(0.0, 2e-4, len(frame))
    frame.to_csv(tmp_path / "log.csv", index=False)
    [joint] = checked(ema, tmp_path / "log.csv")["joints"]
    timing, relations = joint["timing"], joint["relations"]
    assert timing["rate_hz"] == pytest.approx(200.0, rel=1e-3)
    assert timing["jitter_s"] == pytest.approx(2e-4, rel=0.3)
    assert (timing["lost"], timing["gaps"]) == (7, 2)
    # The motion lags the command by 30 ms, and the speed lags the motion by 8 samples.
    assert relations["command_lag_s"] == pytest.approx(0.03, abs=0.003)
    assert relations["speed_lag_s"] == pytest.approx(0.04, abs=0.003)
    assert relations["speed_factor"] == pytest.approx(1.0, abs=0.03)
    figures = {item["quantity"]: item for item in joint["columns"]}
    assert figures["position"]["step"] == pytest.approx(0.001, rel=0.01)
    clipped = np.mean(np.abs(frame["current"]) == 0.9)
    assert figures["current"]["saturated_share"] == pytest.approx(clipped, abs=0.02)
    text = ema("check", tmp_path / "log.csv").stdout
    assert "it may be saturated" in text
    assert "7 lost in 2 gaps" in text


def test_repeated_samples_are_counted(ema, tmp_path):
    columns = ONE | {"current": np.repeat(ONE["current"][::4], 4)[: len(ONE["time"])]}
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv", index=False)
    [joint] = checked(ema, tmp_path / "log.csv")["joints"]
    figures = {item["quantity"]: item for item in joint["columns"]}
    assert (figures["current"]["held_every"], figures["position"]["held_every"]) == (4, 1)
    assert figures["current"]["held_share"] == pytest.approx(0.75, abs=0.05)


def needs(joint: dict[str, Any]) -> dict[str, list[str]]:
    return {item["ability"]: item["needs"] for item in joint["abilities"]}


@pytest.mark.parametrize(
    ("names", "expected", "code"),
    [
        (("position", "current", "command"), {"friction": [], "tracking_lag": []}, 0),
        (("position", "current"), {"tracking_lag": ["command"], "play": ["both_sides"]}, 0),
        (("position", "command"), {"friction": ["effort"], "tracking_lag": []}, 3),
    ],
)
def test_what_can_be_judged_follows_from_the_columns(ema, tmp_path, names, expected, code):
    frame = pd.DataFrame({"time": ONE["time"]} | {name: ONE[name] for name in names})
    frame.to_csv(tmp_path / "log.csv", index=False)
    result = ema("check", tmp_path / "log.csv", "--json")
    assert result.exit_code == code
    [joint] = json.loads(result.stdout)[0]["joints"]
    assert expected.items() <= needs(joint).items()


def test_defect_has_its_figures_and_its_text_in_json(ema, tmp_path):
    frame = pd.DataFrame({name: ONE[name] for name in ("time", "position", "current")})
    frame.drop(index=[700, 701, 702]).to_csv(tmp_path / "log.csv", index=False)
    [joint] = json.loads(ema("check", tmp_path / "log.csv", "--json").stdout)[0]["joints"]
    [defect] = [item for item in joint["defects"] if item["kind"] == "lost_samples"]
    of = len(frame) - 3
    assert defect["evidence"] == {"count": 3, "of": of, "gaps": 1, "is_interpolated": True}
    assert defect["problem"] == f"3 samples of {len(frame)} missing in 1 gap"
    assert defect["remedy"].startswith("records are interpolated across gaps")


def test_joint_at_rest_cannot_be_judged(ema, tmp_path):
    columns = dict(FORMS["seven joints"][0])
    columns["q3"] = np.full(len(ONE["time"]), 0.7)
    columns["dq3"] = np.zeros(len(ONE["time"]))
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv", index=False)
    result = ema("check", tmp_path / "log.csv", "--json")
    assert result.exit_code == 3
    joints = json.loads(result.stdout)[0]["joints"]
    assert [needs(joint)["friction"] for joint in joints] == [
        ["motion"] if joint["joint"] == "3" else [] for joint in joints
    ]


def test_motor_speed_next_to_a_joint_position_can_show_play(ema, tmp_path):
    columns = {"t": ONE["time"], "joint_pos": ONE["position"], "current": ONE["current"]}
    columns["motor_speed"] = 81.0 * ONE["speed"]
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv", index=False)
    [joint] = checked(ema, tmp_path / "log.csv")["joints"]
    assert joint["relations"]["speed_factor"] == pytest.approx(81.0, rel=0.01)
    assert needs(joint)["play"] == []


def test_mapping_of_all_joints_is_written_and_imported(ema, tmp_path):
    columns, expected = FORMS["legs"]
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv", index=False)
    mapping = tmp_path / "mapping.yaml"
    result = ema("check", tmp_path / "log.csv", "-o", mapping)
    assert result.exit_code == 0, result.output
    assert ema("check", tmp_path / "log.csv", "--mapping-only").stdout == mapping.read_text()
    # Without a gear ratio, there are no columns of the motor shaft.
    assert "shaft: motor" not in mapping.read_text()
    again = ema("check", tmp_path / "log.csv", "--mapping", mapping)
    assert again.exit_code == 0, again.output
    output = tmp_path / "legs.mcap"
    imported = ema("import", tmp_path / "log.csv", "--mapping", mapping, "-o", output)
    assert imported.exit_code == 0, imported.output
    for number, joint in enumerate(expected["joints"]):
        telemetry = join(list(read_telemetry(output, actuator_id=joint)))
        np.testing.assert_allclose(telemetry.position, motion(number)["position"], atol=1e-9)
    assert "already exists" in ema("check", tmp_path / "log.csv", "-o", mapping).stderr


def test_one_joint_of_several_is_examined(ema, tmp_path):
    pd.DataFrame(FORMS["legs"][0]).to_csv(tmp_path / "log.csv", index=False)
    result = ema("check", tmp_path / "log.csv", "--joint", "RL_hip")
    assert "joint RL_hip" in result.stdout
    assert "joint FR_hip" not in result.stdout
    assert "joint: RL_hip" in result.stdout


def test_doubts_that_all_joints_share_are_printed_once(ema, tmp_path):
    columns = dict(FORMS["legs"][0])
    columns["FR_hip_tauEst"] = np.abs(columns["FR_hip_tauEst"])
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv", index=False)
    common, *joints = ema("check", tmp_path / "log.csv").stdout.split("\njoint ")
    assert "all joints\n- clock unit: time\n- unit guessed: position, speed, current\n" in common
    for joint in joints:
        assert not any(word in joint for word in ("clock unit", "unit guessed", "doubt"))
    assert ["the current is never negative" in joint for joint in joints] == [True, False, False]


def test_doubts_of_a_single_joint_are_in_its_table(ema, tmp_path):
    pd.DataFrame(FORMS["robotics"][0]).to_csv(tmp_path / "log.csv", index=False)
    text = ema("check", tmp_path / "log.csv").stdout
    assert "all joints" not in text
    [row] = [line for line in text.splitlines() if line.startswith("current ")]
    assert row.endswith("unit guessed, sampling unknown")


def test_doubt_with_a_sentence_is_not_in_the_table(ema, tmp_path):
    pd.DataFrame(FORMS["commanded current"][0]).to_csv(tmp_path / "log.csv", index=False)
    text = ema("check", tmp_path / "log.csv").stdout
    assert text.count("is a setpoint according to its name") == 1
    assert "set point" not in text


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_lerobot_data_set_is_read_as_joints_with_commands(ema, tmp_path, version):
    folder = tmp_path / "so100"
    positions = lerobot_data_set.write(folder, version)
    mapping = tmp_path / "mapping.yaml"
    result = ema("check", folder, "-o", mapping)
    assert result.exit_code == 3  # no effort
    assert "can be judged: tracking lag" in result.stdout
    content = yaml.safe_load(mapping.read_text())
    assert content["position"]["source"] == "observation.state.{joint}.pos"
    assert content["command"]["source"] == "action.{joint}.pos"
    assert content["joints"] == list(positions)
    assert content["table"]["segment"] == "episode_index"
    output = tmp_path / "so100.mcap"
    imported = ema("import", folder, "--mapping", mapping, "-o", output)
    assert imported.exit_code == 0, imported.output
    blocks = list(read_telemetry(output, actuator_id="gripper"))
    position = np.concatenate([block.position for block in blocks])
    np.testing.assert_allclose(position, positions["gripper"], atol=1e-5)


@pytest.mark.parametrize(
    ("remove", "words"),
    [("data", "without data: expected data/*/*.parquet"), ("info", "does not describe a data set")],
)
def test_damaged_data_set_is_refused(ema, tmp_path, remove, words):
    folder = tmp_path / "so100"
    lerobot_data_set.write(folder, "v3.0")
    if remove == "data":
        for path in folder.glob("data/*/*.parquet"):
            path.unlink()
    else:
        (folder / "meta" / "info.json").write_text("{}")
    result = ema("check", folder)
    assert result.exit_code == 1
    assert words in result.stderr


def test_arrays_of_a_numpy_archive_are_joints(ema, tmp_path):
    joints = [motion(number) for number in range(3)]
    np.savez(
        tmp_path / "arm.npz",
        t=ONE["time"],
        q=np.column_stack([joint["position"] for joint in joints]),
        dq=np.array([joint["speed"] for joint in joints]),
        tau=np.column_stack([joint["current"] for joint in joints]),
        rate=200.0,
        names=np.array(["a", "b", "c"]),
    )
    result = ema("check", tmp_path / "arm.npz", "--mapping-only")
    assert result.exit_code == 0, result.output
    mapping = yaml.safe_load(result.stdout)
    assert mapping["joints"] == ["0", "1", "2"]
    sources = [mapping[name]["source"] for name in ("position", "speed", "current")]
    assert sources == ["q_{joint}", "dq_{joint}", "tau_{joint}"]
    np.savez(tmp_path / "none.npz", q=np.zeros(4), t=np.zeros(5))
    assert "has no two arrays of the same length" in ema("check", tmp_path / "none.npz").stderr
    (tmp_path / "torn.npz").write_bytes(b"PK\3\4 torn")
    assert "is not a NumPy archive" in ema("check", tmp_path / "torn.npz").stderr
    np.savez(tmp_path / "good.npz", q=np.zeros(4), t=np.zeros(4))
    damaged = (tmp_path / "good.npz").read_bytes().replace(b"{'descr': '<f8'", b"{'descr': '<f8\"")
    (tmp_path / "damaged.npz").write_bytes(damaged)
    assert "is not a NumPy archive" in ema("check", tmp_path / "damaged.npz").stderr


def joint_state(bag: OtherBag, names: list[str], columns: dict[str, Any], row: int, at_ns: int):
    values = [
        np.array([columns[name][quantity][row] for name in names])
        for quantity in ("position", "speed", "current")
    ]
    return bag.make("sensor_msgs/msg/JointState", bag.header(at_ns), names, *values)


def test_all_joints_of_a_bag_are_listed_with_their_commands(ema, tmp_path):
    """The order of names changes; a controller commands two joints, and numbers the third."""
    columns = {name: motion(number) for number, name in enumerate(["hip", "knee", "ankle"])}
    path = tmp_path / "bag"
    with OtherBag(path) as bag:
        for row in range(len(ONE["time"])):
            at_ns = 1_700_000_000_000_000_000 + round(1e9 * ONE["time"][row])
            names = ["hip", "knee", "ankle"] if row % 3 else ["ankle", "hip", "knee"]
            bag.write("/joint_states", joint_state(bag, names, columns, row, at_ns), at_ns)
            led = ["knee", "hip"]
            wanted = np.array([columns[name]["command"][row] for name in led])
            duration = bag.make("builtin_interfaces/msg/Duration", 0, 0)
            point, empty = (
                bag.make(
                    "trajectory_msgs/msg/JointTrajectoryPoint",
                    *(positions, np.empty(0), np.empty(0), np.empty(0), duration),
                )
                for positions in (wanted, np.empty(0))
            )
            state = bag.make(
                "control_msgs/msg/JointTrajectoryControllerState",
                *(bag.header(at_ns), led, point, empty),
            )
            bag.write("/arm_controller/controller_state", state, at_ns)
            layout = bag.make("std_msgs/msg/MultiArrayLayout", [], 0)
            data = np.array([0.1 * np.sin(row / 50.0), columns["ankle"]["command"][row]])
            bag.write(
                "/forward/commands", bag.make("std_msgs/msg/Float64MultiArray", layout, data), at_ns
            )
    examination = checked(ema, path)
    sources = {
        joint["joint"]: {item["quantity"]: item["source"] for item in joint["columns"]}
        for joint in examination["joints"]
    }
    assert sources.keys() == {"hip", "knee", "ankle"}
    assert sources["hip"]["command"] == sources["knee"]["command"] == "reference.positions"
    assert sources["ankle"]["command"] == "data[1]"
    for joint in examination["joints"]:
        assert needs(joint)["friction"] == []
        assert joint["relations"]["command_lag_s"] == pytest.approx(0.03, abs=0.006)
        assert joint["motion"]["travel"] == pytest.approx(
            np.ptp(columns[joint["joint"]]["position"]), rel=1e-3
        )
    both, single = map(yaml.safe_load, examination["mappings"])
    assert sorted(both["joints"]) == ["hip", "knee"]
    assert single["joint"] == "ankle"


def test_states_of_a_dynamic_joint_state_are_listed(ema, tmp_path):
    columns = {"hip": motion(0), "knee": motion(1)}
    path = tmp_path / "bag"
    with OtherBag(path) as bag:
        for row in range(len(ONE["time"])):
            at_ns = 1_700_000_000_000_000_000 + round(1e9 * ONE["time"][row])
            values = [
                bag.make(
                    "control_msgs/msg/InterfaceValue",
                    ["position", "current", "temperature"],
                    np.array([item["position"][row], item["current"][row], 30.0]),
                )
                for item in columns.values()
            ]
            state = bag.make(
                "control_msgs/msg/DynamicJointState", bag.header(at_ns), list(columns), values
            )
            bag.write("/dynamic_joint_states", state, at_ns)
    mapping = tmp_path / "mapping.yaml"
    result = ema("check", path, "-o", mapping)
    assert result.exit_code == 0, result.output
    assert yaml.safe_load(mapping.read_text())["joints"] == ["knee", "hip"]
    output = tmp_path / "legs.mcap"
    imported = ema("import", path, "--mapping", mapping, "-o", output)
    assert imported.exit_code == 0, imported.output
    telemetry = join(list(read_telemetry(output, actuator_id="knee")))
    np.testing.assert_allclose(telemetry.current, columns["knee"]["current"], atol=1e-9)


def test_real_record_lacks_only_the_motor_side(ema):
    [joint] = checked(ema, REAL / "healthy_1.csv")["joints"]
    assert joint["motion"]["unit"] == "m"
    assert joint["motion"]["travel"] == pytest.approx(0.125, abs=0.002)
    assert needs(joint)["friction"] == []
    assert needs(joint)["play"] == ["both_sides"]
