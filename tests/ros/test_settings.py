# SPDX-License-Identifier: Apache-2.0
"""Parameters are declared from dataclasses that validate them; descriptions are read from files."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from ema_core.description import ActuatorDescription
from ema_core.quantity import Checked, quantity, text
from ema_ros.actuator_file import load_description
from ema_ros.managed_node import ManagedNode
from ema_ros.messages import description_from_message, description_to_message
from ema_ros.node_parameters import LiveSettings, declare, read


@dataclass(frozen=True)
class Oven(Checked):
    temperature: float = quantity(180.0, "degC", 20.0, 300.0, "temperature inside")
    trays: int = quantity(2, "-", 0, 4, "trays in use")
    mode: str = text("fan", "where the heat comes from", ("fan", "grill"))
    label: str = text("", "what is in it")
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mode == "grill" and self.temperature < 100.0:
            raise ValueError(f"temperature = {self.temperature:g} degC is too low to grill")


@pytest.fixture
def make_oven(make_node: Callable[..., Node]) -> Callable[..., Node]:
    """Return a function that makes a node with parameter overrides."""

    def make(**parameters: Any) -> Node:
        overrides = [Parameter(key.replace("__", "."), value=v) for key, v in parameters.items()]
        return make_node("oven", parameter_overrides=overrides)

    return make


def test_defaults_are_read_back(make_oven):
    node = make_oven()
    declare(node, Oven)
    assert read(node, Oven) == Oven()
    assert not node.has_parameter("notes")


def test_given_values_are_used_and_whole_numbers_are_numbers(make_oven):
    node = make_oven(left__temperature=200, left__mode="grill")
    declare(node, Oven, "left.")
    oven = read(node, Oven, "left.")
    assert (oven.temperature, oven.mode) == (200.0, "grill")
    assert type(oven.temperature) is float


def test_descriptors_report_unit_range_and_choices(make_oven):
    node = make_oven()
    declare(node, Oven)
    temperature = node.describe_parameter("temperature")
    assert temperature.description == "temperature inside [degC]"
    [limits] = temperature.floating_point_range
    assert (limits.from_value, limits.to_value) == (20.0, 300.0)
    [limits] = node.describe_parameter("trays").integer_range
    assert (limits.from_value, limits.to_value) == (0, 4)
    assert node.describe_parameter("mode").additional_constraints.endswith("one of fan, grill")
    assert "next configure" in node.describe_parameter("label").additional_constraints
    declare(node, Oven, "fixed.", is_fixed=True)
    assert node.describe_parameter("fixed.label").read_only


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ({"temperature": 301.0}, ["temperature", "301", "300", "degC", "inside"]),
        ({"trays": 2.5}, ["trays", "2.5", "whole"]),
        ({"mode": "steam"}, ["mode", "steam", "fan, grill"]),
        ({"mode": "grill", "temperature": 50.0}, ["temperature", "50", "too low to grill"]),
    ],
)
def test_impossible_override_is_refused_in_one_line(make_oven, values, texts):
    node = make_oven(**{f"left__{name}": value for name, value in values.items()})
    with pytest.raises(ValueError, match=r"left\.") as refused:
        LiveSettings(node, Oven, "left.")
    assert all(item in str(refused.value) for item in texts), refused.value
    assert "\n" not in str(refused.value)


def set_one(node: Node, name: str, value: Any) -> Any:
    [result] = node.set_parameters([Parameter(name, value=value)])
    return result


def test_live_settings_follow_and_report(make_oven):
    node, changes = make_oven(), []
    left = LiveSettings(node, Oven, "left.", changes.append)
    right = LiveSettings(node, Oven, "right.")
    assert set_one(node, "left.temperature", 250).successful
    assert left.value == Oven(250.0)
    assert type(left.value.temperature) is float
    assert right.value == Oven()
    assert changes == [Oven(250.0)]
    together = [Parameter("left.mode", value="grill"), Parameter("right.trays", value=1)]
    assert node.set_parameters_atomically(together).successful
    assert (left.value, right.value) == (Oven(250.0, mode="grill"), Oven(trays=1))


@pytest.mark.parametrize(
    ("name", "value"), [("temperature", float("nan")), ("temperature", "hot"), ("label", 3)]
)
def test_impossible_change_is_refused_by_name(make_oven, name: str, value: Any):
    node, changes = make_oven(), []
    left = LiveSettings(node, Oven, "left.", changes.append)
    result = set_one(node, f"left.{name}", value)
    assert not result.successful
    assert f"left.{name}" in result.reason
    assert (left.value, changes) == (Oven(), [])
    assert node.get_parameter(f"left.{name}").value == getattr(Oven(), name)


@pytest.mark.parametrize(("first", "second"), [("1e2", "1.2e2"), (100, 120)])
def test_number_keeps_its_type_if_set_as_text_or_integer(make_oven, first, second):
    # YAML 1.1 reads 1e2 and 1e-06 as texts, and tools use it to load dumped parameters.
    node = make_oven(left__temperature=first, left__trays="3")
    left = LiveSettings(node, Oven, "left.")
    assert left.value == Oven(100.0, 3)
    assert repr(node.get_parameter("left.temperature").value) == "100.0"
    assert set_one(node, "left.temperature", second).successful
    assert repr(node.get_parameter("left.temperature").value) == "120.0"
    assert left.value.temperature == 120.0
    assert not set_one(node, "left.temperature", "warm").successful


def test_each_parameter_is_answered_once_for_any_number_of_settings(make_oven):
    node, reported = make_oven(), []
    for side in ("left.", "middle.", "right."):
        LiveSettings(node, Oven, side)
    node.add_on_set_parameters_callback(
        lambda parameters: reported.extend(parameters) or SetParametersResult(successful=True)
    )
    [answer] = node.set_parameters([Parameter("left.temperature", value=100)])
    assert answer.successful
    assert [repr(item.value) for item in reported] == ["100.0"]


@dataclass(frozen=True)
class Gap(Checked):
    width: float = quantity(2e-5, "m", 1e-9, 1.0, "width of the gap", shown=("width_um", "um", 1e6))


def test_parameter_has_a_unit_that_avoids_exponents(make_oven):
    node = make_oven()
    gap = LiveSettings(node, Gap)
    parameter = node.get_parameter("width_um")
    assert (repr(parameter.value), gap.value.width) == ("20.0", 2e-5)
    descriptor = node.describe_parameter("width_um")
    assert descriptor.description == "width of the gap [um]"
    assert next(iter(descriptor.floating_point_range)).to_value == 1e6
    assert set_one(node, "width_um", 30).successful
    assert gap.value.width == 3e-5
    assert not set_one(node, "width_um", 2e6).successful


class OvenNode(ManagedNode):
    def __init__(self, **kwargs: Any) -> None:
        super().__init__("oven", **kwargs)
        declare(self, Oven, "left.")

    def configure(self) -> None:
        self.oven = read(self, Oven, "left.")


def test_change_takes_effect_at_the_next_configure_and_is_refused_while_active(make_node):
    node = make_node(kind=OvenNode)
    assert set_one(node, "left.temperature", 200).successful
    assert node.bring_up()
    assert node.oven.temperature == 200.0
    refused = set_one(node, "left.temperature", 250.0)
    assert refused.reason == (
        "left.temperature cannot be changed while the node is active: deactivate it, set the "
        "parameter, then clean up, configure and activate"
    )
    assert set_one(node, "left.temperature", 200.0).successful  # this changes nothing
    node.trigger_deactivate()
    assert set_one(node, "left.temperature", 250.0).successful
    assert "too low to grill" in set_both(node, "grill", 50.0).reason
    node.trigger_activate()
    assert node.oven.temperature == 200.0
    node.trigger_deactivate()
    node.trigger_cleanup()
    node.trigger_configure()
    assert node.oven == Oven(250.0)


def set_both(node: Node, mode: str, temperature: float) -> SetParametersResult:
    values = {"left.mode": mode, "left.temperature": temperature}
    changes = [Parameter(name, value=value) for name, value in values.items()]
    return node.set_parameters_atomically(changes)


@dataclass(frozen=True)
class Wire(Checked):
    R: float = quantity(1.0, "ohm", 0.1, 9.0, "resistance of the wire", named="resistance")


def test_symbol_is_in_the_description_but_refused_as_a_name(make_oven):
    node = make_oven()
    declare(node, Wire, "left.")
    assert node.describe_parameter("left.resistance").description == (
        "resistance of the wire, symbol R [ohm]"
    )
    with pytest.raises(ParameterNotDeclaredException, match=r"left\.R is named left\.resistance"):
        set_one(node, "left.R", 2.0)
    with pytest.raises(ValueError, match=r"left\.R is named left\.resistance"):
        declare(make_oven(left__R=2.0), Wire, "left.")


def test_description_is_read_from_a_file(tmp_path: Path):
    file = tmp_path / "rudder.yaml"
    file.write_text("actuator_id: rudder\nsample_period: 2e-4\nparameters: {R_s: 2.5}\n")
    description = load_description(file)
    assert (description.actuator_id, description.sample_period) == ("rudder", 2e-4)
    assert description.serial_number == ActuatorDescription().serial_number
    assert description.parameters == ActuatorDescription().parameters.replace({"R_s": 2.5})


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("rudder", "it contains 'rudder', expected a mapping"),
        ("", "it is empty, expected a mapping"),
        ("sample_period: 1 ms", "sample_period = '1 ms': expected 1e-09 to 1 [s]"),
        ("colour: red", "unknown entry 'colour'"),
        ("parameters: [1]", "parameters = [1]: expected a mapping"),
        ("parameters: {R_s: thick}", "R_s"),
        ("drive: stepper", "unknown drive 'stepper'"),
        ("acquisition: {curent: mean}", "did you mean 'current'?"),
    ],
)
def test_invalid_description_file_is_refused_by_name(tmp_path: Path, content: str, text: str):
    file = tmp_path / "wrong.yaml"
    file.write_text(content)
    with pytest.raises(ValueError, match=r"wrong\.yaml") as refused:
        load_description(file)
    assert text in str(refused.value)


@pytest.mark.parametrize("parameters", ["", "parameters: {}\n", "parameters:\n"])
def test_unknown_drive_needs_names_only(tmp_path, parameters):
    """Without parameters, torques and angles refer to the joint."""
    file = tmp_path / "wheel.yaml"
    file.write_text(f"actuator_id: wheel\nserial_number: W-1\ndrive: unknown\n{parameters}")
    description = load_description(file)
    p = description.parameters
    assert (description.model, p.tau, p.k_t, p.k_e, p.BLK) == ("", 1.0, 1.0, 1.0, 0.0)
    assert description_from_message(description_to_message(description)) == description


def test_simulator_of_an_unknown_drive_has_the_plant_of_the_built_in_actuator(tmp_path):
    file = tmp_path / "wheel.yaml"
    file.write_text("actuator_id: wheel\nserial_number: W-1\ndrive: unknown\n")
    description = load_description(file, is_simulated=True)
    assert description.parameters == ActuatorDescription().parameters


def test_given_parameters_of_an_unknown_drive_are_kept(tmp_path):
    file = tmp_path / "wheel.yaml"
    file.write_text(
        "actuator_id: w\nserial_number: W-1\nmodel: m\ndrive: unknown\nparameters: {tau: 0.01}\n"
    )
    description = load_description(file)
    assert (description.model, description.parameters.tau, description.parameters.k_t) == (
        *("m", 0.01, 1.0),
    )


def test_modelled_drive_keeps_the_values_of_the_built_in_actuator(tmp_path):
    file = tmp_path / "flap.yaml"
    file.write_text("actuator_id: flap\nserial_number: W-1\n")
    assert load_description(file).parameters == ActuatorDescription().parameters
