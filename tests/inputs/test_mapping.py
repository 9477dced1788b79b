"""Mapping files say what is wrong with them, by name, value and what is expected."""

from pathlib import Path

import pytest
import yaml

from ema_bags.inputs.field_path import FieldPath
from ema_bags.inputs.mapping import load_mapping, mapping_from, mapping_text
from ema_core.acquisition import Acquisition

SHIPPED = Path(__file__).parents[2] / "ros2_ws" / "src" / "ema_bags" / "mappings"
EXAMPLES = sorted(SHIPPED.glob("*.yaml"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_is_a_mapping_and_its_text_is_the_same_mapping(path, tmp_path):
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
        ({"command": None}, "neither of command and error given"),
        ({"error": "e"}, "both of command and error given"),
        ({"speed": {"source": "s", "sign": 2}}, "speed: sign = 2 - is outside"),
        ({"speed": {"source": "s", "sign": 0}}, "speed: sign = 0: expected 1 or -1"),
        ({"speed": {"source": "s", "scale": 0}}, "speed: scale = 0"),
        ({"speed": {"topic": "/a", "source": "s"}}, "without topic: expected a topic for every"),
        ({"speed": {"source": "s", "type": "a/msg/B"}}, "without topic: expected both"),
        ({"current": {"source": "i", "unit": "N.m"}}, "kind = equivalent: expected A, mA"),
        ({"current": {"source": "i", "kind": "motor_torque"}}, "unit = 'A' with kind"),
        ({"current": {"source": "i", "amplitude": "rms"}}, "only i_q has one"),
        ({"current": {"source": "i", "kind": "phase_currents"}}, "phase_currents needs both"),
        ({"current": {"source": "i", "sampling": "filtered"}}, "current_filter = 0 s"),
        ({"position": "q_{joint}"}, "source = 'q_{joint}' without joint: expected both"),
        ({"clock": {}}, "clock without source and rate_hz"),
        ({"clock": {"source": "t", "unit": "min"}}, "clock: unit = 'min' is unknown"),
        ({"accept": "current_zero"}, "accept = 'current_zero': expected a list of texts"),
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


def test_what_is_left_out_is_not_measured(mapped):
    assert mapped().acquisition == Acquisition("mean", 0.0, True)
    assert mapped(current=None, speed=None).acquisition == Acquisition("none", 0.0, False)
    not_sampled = mapped(current={"source": "i", "sampling": "none"})
    assert not_sampled.acquisition.current == "none"
    assert [key for key, _, _ in not_sampled.wanted()] == ["position", "command", "speed"]


def test_number_that_yaml_reads_as_text_is_a_number():
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
def test_field_is_found_by_number_name_and_joint(path, joint, value):
    assert FieldPath(path, joint).value(STATE) == value


def test_names_may_come_in_a_message_of_their_own():
    path = FieldPath("data[keys=flap/position]")
    assert path.value(STATE, Part(keys=["flap/velocity", "flap/position"])) == 7.0


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("data[2]", "data has 2 elements, expected more than 2"),
        ("data", "gives list, expected a number"),
        ("dato[0]", "has no field 'dato'"),
        (
            "reference.positions[joint_names=wing]",
            "'wing' is not in joint_names, which has a,",
        ),
        ("data[keys=a]", "there is no array keys of names for 'a'"),
    ],
)
def test_field_that_is_not_there_is_named(path, words):
    with pytest.raises(ValueError, match=r".*") as refusal:
        FieldPath(path).value(STATE)
    assert words in str(refusal.value)


@pytest.mark.parametrize("path", ["", "a..b", "a[", "a[x]", "a b", "a."])
def test_text_that_is_no_path_is_refused(path):
    with pytest.raises(ValueError, match="expected names of fields separated by dots"):
        FieldPath(path)
