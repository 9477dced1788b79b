# SPDX-License-Identifier: Apache-2.0
"""Joints are found with the columns that their messages have."""

from types import SimpleNamespace

import pytest

from ema_bags.inputs.joint_finder import (
    CONTROLLER_STATE,
    JOINT_STATE,
    JointFinder,
    actuator_name,
    is_command,
)
from ema_bags.inputs.joint_states import REFERENCE, reads_joint_states
from ema_bags.inputs.mapping import mapping_text

URDF = (
    '<robot name="r"><joint name="lift" type="prismatic"/><joint name="a" type="revolute"/></robot>'
)
STEP_NS = 50_000_000


def state(names, *, speed: float | None = 1.0, effort: float | None = 2.0):
    """Return a message; a column that is None is an empty array."""
    columns = {"position": 0.5, "velocity": speed, "effort": effort}
    arrays = {
        name: [] if value is None else [value] * len(names) for name, value in columns.items()
    }
    return SimpleNamespace(name=list(names), **arrays)


class Graph:
    """Feeds messages of several topics to a finder, at 20 Hz."""

    def __init__(self, **settings):
        self.finder = JointFinder(**settings)
        self.now_ns = 0

    def run(self, messages, steps=30):
        for _ in range(steps):
            self.now_ns += STEP_NS
            for topic, message in messages.items():
                self.finder.add(topic, JOINT_STATE, message, self.now_ns)
        return self.finder.found(self.now_ns)


def names_of(found):
    return sorted(name for group in found for name in group.names.values())


def test_joints_have_the_columns_of_their_messages():
    [group] = Graph().run({"/joint_states": state("ab")})
    mapping = group.mapping
    assert mapping.speed is not None
    assert mapping.current is not None
    assert group.names == {"a": "a", "b": "b"}
    assert mapping.joints == ("a", "b")
    assert mapping.position.topic == mapping.speed.topic == mapping.current.topic
    assert (mapping.current.unit, mapping.current.sampling) == ("N.m", "instantaneous")
    assert mapping.command is None
    assert reads_joint_states(mapping)


@pytest.mark.parametrize("effort", [None, 0.0, float("nan")])
def test_effort_that_is_empty_or_always_zero_is_not_published(effort):
    graph = Graph()
    [group] = graph.run({"/joint_states": state("a", effort=effort, speed=None)})
    assert group.mapping.current is None
    assert group.mapping.speed is None
    # An effort that appears later replaces the mapping without effort, once.
    [later] = graph.run({"/joint_states": state("a", effort=0.3, speed=None)}, 60)
    assert later.names == group.names
    assert later.mapping.current is not None
    assert graph.run({"/joint_states": state("a", effort=0.3, speed=None)}) == []


def test_a_joint_is_decided_after_a_second_and_ten_messages():
    graph = Graph()
    assert graph.run({"/joint_states": state("a")}, 15) == []
    assert names_of(graph.run({"/joint_states": state("a")}, 10)) == ["a"]


def test_joint_that_appears_later_does_not_disturb_the_others():
    graph = Graph()
    assert names_of(graph.run({"/joint_states": state("ab")})) == ["a", "b"]
    assert names_of(graph.run({"/joint_states": state("bca")})) == ["c"]


def test_robots_in_namespaces_have_joints_of_the_same_name():
    found = Graph().run({"/left/joint_states": state("a"), "/right/joint_states": state("a")})
    assert names_of(found) == ["left/a", "right/a"]
    assert actuator_name("/joint_states", "a") == "a"


def test_commands_belong_to_the_robot_of_their_namespace():
    messages = {
        "/joint_states": state("a"),
        "/left/joint_states": state("a"),
        "/left/joint_commands": state("a"),
    }
    found = {names_of([group])[0]: group.mapping for group in Graph().run(messages)}
    assert found["a"].command is None
    command = found["left/a"].command
    assert command is not None
    assert command.topic == "/left/joint_commands"
    assert is_command("/left/joint_commands")
    assert not is_command("/command_unit/joint_states")


def test_reference_of_a_trajectory_controller_is_the_command():
    graph = Graph()
    reference = SimpleNamespace(joint_names=["a"], reference=SimpleNamespace(positions=[0.5]))
    graph.finder.add("/arm_controller/controller_state", CONTROLLER_STATE, reference, 1)
    [group] = graph.run({"/joint_states": state("a")})
    assert group.mapping.command is not None
    assert group.mapping.command.source == REFERENCE
    assert reads_joint_states(group.mapping)


def test_second_topic_with_a_joint_counts_only_if_it_alone_has_effort():
    graph = Graph()
    messages = {"/joint_states": state("a"), "/raw_joint_states": state("a")}
    assert names_of(graph.run(messages)) == ["a"]
    graph = Graph()
    graph.run({"/joint_states": state("a", effort=None)})
    [group] = graph.run({"/joint_states": state("a", effort=None), "/raw_states": state("a")})
    assert group.mapping.position.topic == "/raw_states"


def test_patterns_select_actuators():
    messages = {"/left/joint_states": state("ab"), "/right/joint_states": state("ab")}
    assert names_of(Graph(joints=["left/*", "*/b"]).run(messages)) == [
        "left/a",
        "left/b",
        "right/b",
    ]


def test_prismatic_joint_of_the_robot_description_has_metres_and_newtons():
    graph = Graph()
    assert graph.finder.describe("/robot_description", URDF) == ""
    groups = {
        names_of([group])[0]: group.mapping
        for group in graph.run({"/joint_states": state(["a", "lift"])})
    }
    assert groups["lift"].position.unit == "m"
    assert mapping_text(groups["lift"]).count("unit: m/s") == 1
    assert mapping_text(groups["lift"]).count("unit: N\n") == 1
    assert groups["a"].position.unit == "rad"


def test_robot_description_that_is_not_xml_is_reported():
    reason = JointFinder().describe("/robot_description", "<robot")
    assert reason.startswith("/robot_description is not a robot description: ")


@pytest.mark.parametrize("name", ["", "a\nb", "x" * 300])
def test_joint_with_an_invalid_name_is_refused_and_the_others_are_found(name):
    graph = Graph()
    assert names_of(graph.run({"/joint_states": state(["a", name])})) == ["a"]
    [(key, reason)] = graph.finder.refused.items()
    assert key == ("/joint_states", name)
    assert reason.startswith("/joint_states: joint = ")
