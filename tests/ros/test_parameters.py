# SPDX-License-Identifier: Apache-2.0
"""Every parameter is declared with description, unit and range, and listed in the document."""

import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from runpy import run_path
from typing import Any

import pytest
import yaml
from rclpy.parameter import Parameter

from ema_cli.processes.bringup import NODES, node_class
from ema_ros.messages import PARAMETER_FIELDS
from ema_ros.node_parameters import AT_CONFIGURE, LIVE

from .spinning import ros_context


@pytest.fixture(scope="module")
def nodes() -> Iterator[dict[str, Any]]:
    """All nodes with default parameters, by name."""
    with ros_context() as context, ExitStack() as opened:
        nodes_by_name = {name: node_class(name)(context=context) for name in NODES}
        for node in nodes_by_name.values():
            opened.callback(node.destroy_node)
        yield nodes_by_name


@pytest.fixture(scope="module")
def parameters(nodes: dict[str, Any]) -> list[tuple[str, str, Any, Any]]:
    """List of node, name, value and descriptor of each parameter."""
    return [
        (name, item, node.get_parameter(item).value, node.describe_parameter(item))
        for name, node in nodes.items()
        for item in node.list_parameters([], 0).names
        if item != "use_sim_time"
    ]


def test_document_of_parameters_is_up_to_date():
    root = Path(__file__).parents[2]
    page = (root / "docs" / "parameters.md").read_text(encoding="utf-8")
    made = run_path(str(root / "tools" / "parameter_page.py"))["parameter_page"]()
    assert page == made, "run `make parameters`"


def test_parameters_have_a_description_and_numbers_a_unit_and_a_range(parameters):
    for *key, value, descriptor in parameters:
        assert descriptor.description, key
        if isinstance(value, int | float) and not isinstance(value, bool):
            assert descriptor.description.endswith("]"), key
            assert descriptor.floating_point_range or descriptor.integer_range, key
        says = descriptor.additional_constraints
        assert descriptor.read_only or says.startswith((LIVE, AT_CONFIGURE)), key


def test_only_parameters_needed_at_the_start_are_read_only(parameters):
    fixed = {(node, name) for node, name, _, descriptor in parameters if descriptor.read_only}
    specific = {
        (node, name) for node, name in fixed if not name.startswith(("autostart", "start_type"))
    }
    assert specific == {("actuator", "actuator_file")}


def test_names_are_words_in_lower_case(parameters):
    for node, name, *_ in parameters:
        for part in name.split("."):
            assert re.fullmatch(r"[a-z]+(_[a-z0-9]+)*", part), (node, name)
    plant = {name.removeprefix("plant.") for _, name, *_ in parameters if name.startswith("plant.")}
    assert plant == set(PARAMETER_FIELDS.values())
    assert not (plant - {"lead"}) & PARAMETER_FIELDS.keys()


def test_printed_defaults_are_read_back_as_numbers(parameters):
    for *key, value, _ in parameters:
        # YAML 1.1 (`ros2 param load`) reads a number with an exponent but no point as a text.
        if isinstance(value, float):
            assert yaml.safe_load(repr(value)) == value, key


def test_refusal_of_a_value_names_its_parameter(nodes, parameters):
    for name, item, value, descriptor in parameters:
        limits = [*descriptor.floating_point_range, *descriptor.integer_range]
        if descriptor.read_only or not limits:
            continue
        beyond = limits[0].to_value + 1
        wrong = type(value)(beyond) if isinstance(value, int) else beyond * 2.0
        [answer] = nodes[name].set_parameters([Parameter(item, value=wrong)])
        assert not answer.successful, item
        assert item in answer.reason


@pytest.mark.parametrize("name", NODES)
def test_dumped_parameters_start_a_node_with_the_same_values(name: str, tmp_path: Path):
    """The file is written like `ros2 param dump`: dots in names become levels of the YAML."""

    def values_of(*arguments: str) -> dict[str, Any]:
        with ros_context(arguments=["--ros-args", "-r", "__ns:=/ema", *arguments]) as context:
            node = node_class(name)(context=context)
            try:
                names = node.list_parameters([], 0).names
                return {item: node.get_parameter(item).value for item in names}
            finally:
                node.destroy_node()

    # Small and large numbers: YAML 1.1 reads them as texts if they have no point.
    changed = {
        "monitor": {"threshold_urad": 1e-06, "longest_s": 1e5, "limits.gain": 0.31},
        "actuator": {"block_s": 0.001, "growth.friction.rate": 1e-05, "hours_per_cycle": 100.0},
    }.get(name, {})
    before = values_of(*(word for k, v in changed.items() for word in ("-p", f"{k}:={v!r}")))
    assert changed.items() <= before.items()
    tree: dict[str, Any] = {}
    for key, value in before.items():
        *levels, last = key.split(".")
        part = tree
        for level in levels:
            part = part.setdefault(level, {})
        part[last] = value
    file = tmp_path / "dumped.yaml"
    file.write_text(yaml.dump({f"/ema/{name}": {"ros__parameters": tree}}))
    assert values_of("--params-file", str(file)) == before
