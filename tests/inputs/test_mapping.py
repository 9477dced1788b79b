# SPDX-License-Identifier: Apache-2.0
"""Mapping files: mistakes are named; units, shafts and kinds of current agree with closed forms."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from ema_bags.inputs.conversion import convert
from ema_bags.inputs.field_path import FieldPath
from ema_bags.inputs.mapping import load_mapping, mapping_text
from ema_core.acquisition import Acquisition
from ema_core.description import ActuatorDescription

from .conftest import mapping_from

SHIPPED = Path(__file__).parents[2] / "ros2_ws" / "src" / "ema_bags" / "mappings"
EXAMPLES = sorted(SHIPPED.glob("*.yaml"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_is_a_mapping_and_equals_the_mapping_of_its_text(path, tmp_path):
    mapping = load_mapping(path)
    written = tmp_path / "again.yaml"
    written.write_text(mapping_text(mapping))
    assert load_mapping(written) == mapping
    assert mapping.is_table == (path.stem in ("csv", "ur_real_time", "dynamixel", "cia402"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"postion": "p"}, "unknown entry 'postion'; did you mean 'position'?"),
        ({"position": {"source": "p", "unit": "degree"}}, "position: unit = 'degree' is unknown"),
        ({"position": {"source": "p", "shafts": 1}}, "position: unknown entry 'shafts'"),
        ({"position": {"source": ""}}, "position: source = ''"),
        ({"position": 3}, "position = 3: expected a mapping"),
        ({"error": "e"}, "command and error are both set"),
        ({"speed": {"source": "s", "sign": 2}}, "speed: sign = 2 is outside"),
        ({"speed": {"source": "s", "sign": 0}}, "speed: sign = 0: expected 1 or -1"),
        ({"speed": {"source": "s", "scale": 0}}, "speed: scale = 0"),
        ({"speed": {"topic": "/a", "source": "s"}}, "without topic: expected topics for all"),
        ({"speed": {"source": "s", "type": "a/msg/B"}}, "without topic: expected both"),
        ({"current": {"source": "i", "unit": "N.m", "kind": "i_q"}}, "i_q: expected A, mA"),
        ({"current": {"source": "i", "kind": "motor_torque"}}, "unit = 'A' with kind"),
        ({"current": {"source": "i", "amplitude": "rms"}}, "only i_q has an amplitude"),
        ({"current": {"source": "i", "kind": "phase_currents"}}, "phase_currents requires both"),
        ({"current": {"source": "i", "sampling": "filtered"}}, "current_filter = 0 s"),
        ({"position": "q_{joint}"}, "source = 'q_{joint}' without joint: expected both"),
        ({"joints": ["a", "a"]}, "joints = ['a', 'a']: expected one joint, or distinct joints"),
        ({"clock": {}}, "clock without source and rate_hz"),
        ({"clock": {"source": "t", "unit": "week"}}, "clock: unit = 'week' is unknown"),
        ({"accept": "current_zero"}, "accept = 'current_zero': expected a list of strings"),
        ({"accept": ["curent_zero"]}, "unknown defect 'curent_zero'; did you mean 'current_zero'?"),
    ],
)
def test_wrong_entry_is_refused_by_name_and_value(mapped, change, words):
    with pytest.raises(ValueError, match=r".*") as refusal:
        mapped(**change)
    assert words in str(refusal.value)


def test_joint_of_a_table_is_chosen_by_its_number():
    content = yaml.safe_load((SHIPPED / "ur_real_time.yaml").read_text()) | {"joint": "3"}
    names = [source for _, source, _ in mapping_from(content).wanted()]
    assert names == ["actual_q_3", "target_q_3", "actual_qd_3", "actual_current_3"]


def test_error_in_a_file_names_the_file(tmp_path):
    path = tmp_path / "map.yaml"
    path.write_text("position: [\n")
    with pytest.raises(ValueError, match=r"map\.yaml is not a YAML file"):
        load_mapping(path)
    path.write_text("command: c\n")
    with pytest.raises(ValueError, match=r"map\.yaml: position is missing"):
        load_mapping(path)
    with pytest.raises(ValueError, match=r"none\.yaml cannot be read"):
        load_mapping(tmp_path / "none.yaml")


def test_omitted_columns_are_not_measured(mapped):
    assert mapped().acquisition == Acquisition("mean", 0.0, True)
    assert mapped(current=None, speed=None).acquisition == Acquisition("none", 0.0, False)
    not_sampled = mapped(current={"source": "i", "sampling": "none"})
    assert not_sampled.acquisition.current == "none"
    assert [key for key, _, _ in not_sampled.wanted()] == ["position", "command", "speed"]


def test_number_that_yaml_reads_as_text_is_accepted():
    content = yaml.safe_load(
        "{position: {source: p, scale: 1e-3}, command: c, clock: {rate_hz: 100}}"
    )
    assert mapping_from(content).position.scale == 1e-3


class Part:
    def __init__(self, **fields):
        self.__dict__ |= fields


STATE = Part(
    joint_names=["a", "flap"],
    interface_values=[
        Part(interface_names=["x"], values=[0.0]),
        Part(interface_names=["velocity", "position"], values=[2.0, 3.0]),
    ],
    reference=Part(positions=[4.0, 5.0]),
    data=[6.0, 7.0],
)


@pytest.mark.parametrize(
    ("path", "joint", "value"),
    [
        ("data[1]", "", 7.0),
        ("reference.positions[joint_names=flap]", "", 5.0),
        ("reference.positions", "flap", 5.0),
        ("interface_values[joint_names=flap].values[interface_names=position]", "", 3.0),
    ],
)
def test_field_is_selected_by_number_name_and_joint(path, joint, value):
    assert FieldPath(path, joint).value(STATE) == value


def test_names_may_come_in_a_separate_message():
    path = FieldPath("data[keys=flap/position]")
    assert path.value(STATE, Part(keys=["flap/velocity", "flap/position"])) == 7.0


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("data[2]", "data has 2 elements, expected more than 2"),
        ("data", "gives list, expected a number"),
        ("dato[0]", "has no field 'dato'"),
        ("reference.positions[joint_names=wing]", "'wing' is not in joint_names, which has a,"),
        ("data[keys=a]", "there is no name array keys to find 'a' in"),
    ],
)
def test_missing_field_is_named(path, words):
    with pytest.raises(ValueError, match=r".*") as refusal:
        FieldPath(path).value(STATE)
    assert words in str(refusal.value)


@pytest.mark.parametrize("path", ["", "a..b", "a[", "a[x]", "a b", "a."])
def test_text_that_is_not_a_path_is_refused(path):
    with pytest.raises(ValueError, match="expected field names separated by dots"):
        FieldPath(path)


FLAP = ActuatorDescription()
P = FLAP.parameters
BASE = {"position": "p", "command": "c", "clock": "t"}


def converted(raw, description=FLAP, **sections):
    content = {name: item for name, item in (BASE | sections).items() if item is not None}
    values = {"position": 0.0, "command": 0.0} | raw
    columns = {name: np.array([value]) for name, value in values.items()}
    return convert(columns, mapping_from(content), description)


@pytest.mark.parametrize(
    ("section", "raw", "expected"),
    [
        ({"unit": "deg"}, 180.0, math.pi),
        ({"unit": "turn", "shaft": "motor"}, 500.0, 2.0 * math.pi),
        ({"unit": "mrad", "sign": -1, "offset": 0.5}, 100.0, 0.4),
        ({"scale": 2.0}, 0.25, 0.5),
        ({"unit": "mm", "lead": 0.005}, 2.5, math.pi),
        ({"unit": "in", "lead": 0.0254, "shaft": "motor"}, 500.0, 2.0 * math.pi),
        ({"encoding": "sign_bit_16", "scale": 0.01}, 32968.0, -2.0),
        ({"encoding": "twos_complement_16"}, 65535.0, -1.0),
        ({"encoding": "twos_complement_32"}, 5.0, 5.0),
    ],
)
def test_angles_are_those_of_the_user_shaft(section, raw, expected):
    angle = converted({"position": raw}, position={"source": "p", **section})["position"]
    assert angle[0] == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("section", "expected"),
    [
        ({"unit": "rpm"}, math.pi),
        ({"unit": "turn/s", "shaft": "user"}, 30.0 * 2.0 * math.pi * 500.0),
        ({"unit": "deg/s", "sign": -1}, -math.pi / 6.0),
        ({"unit": "mm/s", "lead": 0.005}, 12.0 * math.pi),
    ],
)
def test_speeds_are_those_of_the_motor_shaft(section, expected):
    speed = converted({"speed": 30.0}, speed={"source": "s", **section})["speed"]
    assert speed[0] == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        # Angle [rad], speed of the motor [rad/s] and current [A] per count.
        ("dynamixel", (2 * math.pi / 4096, 0.229 * math.pi / 30 * 500, 2.69e-3)),
        ("cia402", (2 * math.pi / 524288 / 500, 2 * math.pi / 524288, 1.27e-3 / P.k_t)),
    ],
)
def test_registers_of_drives_are_read_within_half_a_count(telemetry, name, counts):
    angle, speed, current = counts
    middle = 2048 if name == "dynamixel" else 0
    values = {
        "position": telemetry.position / angle + middle,
        "command": telemetry.command / angle + middle,
        "speed": telemetry.speed / speed,
    }
    raw = {key: np.round(value) % 2.0**32 for key, value in values.items()}
    raw["current"] = np.round(telemetry.current / current) % 2.0**16
    columns = convert(raw, load_mapping(SHIPPED / f"{name}.yaml"), FLAP)
    for key, count in zip((*values, "current"), (angle, *counts), strict=True):
        expected = getattr(telemetry, key)
        np.testing.assert_allclose(
            columns[key], expected, rtol=1e-9, atol=0.501 * count, err_msg=key
        )


def test_lead_comes_from_the_length_unit_or_the_description():
    with pytest.raises(ValueError, match="position: lead = "):
        converted({}, position={"source": "p", "unit": "rad", "lead": 0.005})
    raw = {"position": np.array([0.0, 2.5]), "command": np.zeros(2)}
    mapping = mapping_from(BASE | {"position": {"source": "p", "unit": "mm"}})
    screw = replace(FLAP, parameters=FLAP.parameters.replace({"lead": 0.005}))
    np.testing.assert_allclose(convert(raw, mapping, screw)["position"], [0.0, math.pi])
    with pytest.raises(ValueError, match=r"p: unit = mm with lead = 0: expected the travel"):
        convert(raw, mapping, FLAP)
    twice = replace(mapping, position=replace(mapping.position, lead=0.01))
    with pytest.raises(ValueError, match=r"lead = 0.01: .* file \(lead = 0.005\)"):
        convert(raw, twice, screw)


def test_magnitude_of_a_current_has_the_sign_of_the_motion():
    position = np.concatenate([np.zeros(5), np.arange(10.0), np.full(5, 9.0), 9.0 - np.arange(10)])
    raw = {"position": position, "command": position, "current": np.full(len(position), 0.5)}
    mapping = mapping_from(BASE | {"current": {"source": "i", "kind": "magnitude"}})
    current = convert(raw, mapping, FLAP)["current"]
    assert np.all(current[6:14] == 0.5)
    assert np.all(current[21:] == -0.5)
    assert set(np.abs(current)) == {0.5}


def test_command_follows_from_the_position_error():
    columns = converted({"position": 0.3, "error": 0.2}, command=None, error="e")
    assert columns["command"][0] == 0.5


def test_unmapped_columns_are_empty():
    columns = converted({})
    assert (len(columns["speed"]), len(columns["current"])) == (0, 0)


@pytest.mark.parametrize(
    ("section", "raw", "expected"),
    [
        ({"unit": "mA"}, 1500.0, 1.5),
        ({"kind": "motor_torque", "unit": "N.m"}, P.k_t * 3.0, 3.0),
        ({"kind": "joint_torque", "unit": "N.m"}, P.k_t * 3.0 / P.tau, 3.0),
        ({"kind": "i_q"}, 2.0, math.sqrt(3.0)),  # torque constant phase to phase, 3/2 k_t / sqrt(3)
    ],
)
def test_equivalent_current_gives_the_torque_of_the_source(section, raw, expected):
    current = converted({"current": raw}, current={"source": "i", **section})["current"]
    assert current[0] == pytest.approx(expected, rel=1e-14)


def test_conventions_of_i_q_give_the_same_torque():
    """A peak value of 1 A is a different number in each convention.

    All are converted to the peak value, to which the torque constant refers (M33).
    """
    drive = replace(FLAP, drive="field_oriented")
    counted = {"peak": 1.0, "rms": math.sqrt(0.5), "power": math.sqrt(1.5)}
    currents = [
        converted(
            {"current": raw}, drive, current={"source": "i", "kind": "i_q", "amplitude": name}
        )
        for name, raw in counted.items()
    ]
    assert [item["current"][0] for item in currents] == pytest.approx([1.0] * 3)


def phases(angle):
    raw = {f"phase_{c}": math.cos(angle - k * 2.0 * math.pi / 3.0) for k, c in enumerate("abc")}
    return raw | {"torque_sign": -0.3}


@pytest.mark.parametrize("count", [2, 3])
def test_phase_currents_of_a_sinusoidal_motor_give_i_q_at_any_angle(count):
    section = {"kind": "phase_currents", "phases": list("abc")[:count], "torque_sign": "q"}
    drive = replace(FLAP, drive="field_oriented")
    for angle in np.linspace(0.0, 6.0, 7):
        raw = phases(angle)
        if count == 2:
            del raw["phase_c"]
        current = converted(raw, drive, current=section)["current"]
        assert current[0] == pytest.approx(-1.0, rel=1e-12)


def test_phase_currents_of_a_six_step_motor_give_half_the_sum_of_magnitudes():
    section = {"kind": "phase_currents", "phases": ["a", "b", "c"], "torque_sign": "q"}
    raw = {"phase_a": 4.0, "phase_b": -3.9, "phase_c": -0.1, "torque_sign": 1.0}
    assert converted(raw, current=section)["current"][0] == pytest.approx(4.0)
