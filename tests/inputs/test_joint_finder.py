# SPDX-License-Identifier: Apache-2.0
"""Joints are discovered with the columns of their messages."""

from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from ema_bags.inputs import joint_finder
from ema_bags.inputs.joint_finder import JointFinder
from ema_bags.inputs.joint_messages import (
    CONTROLLER_STATE,
    DYNAMIC_JOINT_STATE,
    JOINT_STATE,
    PID_STATE,
)
from ema_bags.inputs.joint_sources import is_command
from ema_bags.inputs.joint_states import reads_joint_states
from ema_bags.inputs.mapping import mapping_text

URDF = (
    '<robot name="r"><joint name="lift" type="prismatic"/><joint name="a" type="revolute"/></robot>'
)
STEP_NS = 50_000_000


def state(names, *, speed: float | None = 1.0, effort: float | None = 2.0):
    """Return a message; a column that is None becomes an empty array."""
    columns = {"position": 0.5, "velocity": speed, "effort": effort}
    arrays = {
        name: [] if value is None else [value] * len(names) for name, value in columns.items()
    }
    return SimpleNamespace(name=list(names), **arrays)


class Graph:
    """Passes messages of several topics to a finder at 20 Hz."""

    def __init__(self, **settings):
        self.finder = JointFinder(**settings)
        self.now_ns = 0

    def run(self, messages, steps=30):
        joints = []
        for _ in range(steps):
            self.now_ns += STEP_NS
            for topic, message in messages.items():
                kind = getattr(message, "kind", JOINT_STATE)
                self.finder.add(topic, kind, message, self.now_ns)
            joints += self.finder.found(self.now_ns)
        return joints


def dynamic(names, **interfaces):
    """Return a message of interface values without the definitions of control_msgs."""
    item = SimpleNamespace(interface_names=list(interfaces), values=list(interfaces.values()))
    return SimpleNamespace(
        kind=DYNAMIC_JOINT_STATE, joint_names=list(names), interface_values=[item] * len(names)
    )


def pid(name):
    state = SimpleNamespace(name=name, reference=0.4, feedback=0.5, feedback_dot=0.1, output=2.0)
    return SimpleNamespace(kind=PID_STATE, dof_state=state)


def names_of(joints):
    return sorted(name for group in joints for name in group.names.values())


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
def test_empty_or_zero_effort_is_not_published(effort):
    graph = Graph()
    [group] = graph.run({"/joint_states": state("a", effort=effort, speed=None)})
    assert group.mapping.current is None
    assert group.mapping.speed is None
    # An effort that appears later replaces the mapping without effort, exactly once.
    [later] = graph.run({"/joint_states": state("a", effort=0.3, speed=None)}, 60)
    assert later.names == group.names
    assert later.mapping.current is not None
    assert graph.run({"/joint_states": state("a", effort=0.3, speed=None)}) == []


def test_joint_is_accepted_after_a_second_and_ten_messages():
    graph = Graph()
    assert graph.run({"/joint_states": state("a")}, 15) == []
    assert names_of(graph.run({"/joint_states": state("a")}, 10)) == ["a"]


def test_joint_that_appears_later_does_not_disturb_the_others():
    graph = Graph()
    assert names_of(graph.run({"/joint_states": state("ab")})) == ["a", "b"]
    assert names_of(graph.run({"/joint_states": state("bca")})) == ["c"]


def test_robots_in_namespaces_may_have_joints_of_the_same_name():
    joints = Graph().run({"/left/joint_states": state("a"), "/right/joint_states": state("a")})
    assert names_of(joints) == ["left/a", "right/a"]


def test_commands_belong_to_the_robot_of_their_namespace():
    messages = {
        "/joint_states": state("a"),
        "/left/joint_states": state("a"),
        "/left/joint_commands": state("a"),
    }
    mappings = {names_of([group])[0]: group.mapping for group in Graph().run(messages)}
    assert mappings["a"].command is None
    command = mappings["left/a"].command
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
    assert group.mapping.command.source == "reference.positions"
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
def test_joint_with_an_invalid_name_is_refused_and_the_others_are_accepted(name):
    graph = Graph()
    assert names_of(graph.run({"/joint_states": state(["a", name])})) == ["a"]
    [(key, reason)] = graph.finder.refused.items()
    assert key == ("/joint_states", name)
    assert reason.startswith("/joint_states: joint = ")


def test_interface_values_provide_what_joint_states_lack():
    """The finder reads the topic that has position and effort, and also the temperature."""
    graph = Graph()
    values = dynamic("ab", position=0.5, velocity=1.0, torque=2.0, temperature=30.0)
    states = state("ab", effort=None)
    first, *_ = graph.run({"/joint_states": states, "/dynamic_joint_states": values})
    mapping = first.mapping
    assert mapping.position.topic == "/dynamic_joint_states"
    assert mapping.current is not None
    assert (mapping.current.topic, mapping.current.unit) == ("/dynamic_joint_states", "N.m")
    assert mapping.current.source.endswith("[interface_names=torque]")
    assert mapping.temperature is not None
    assert reads_joint_states(mapping)
    [joint] = Graph().run({"/dynamic_joint_states": dynamic("a", position=0.5, current=1.0)})
    assert joint.mapping.current is not None
    assert joint.mapping.current.unit == "A"


def test_controllers_provide_joints_that_no_joint_state_has():
    joints = Graph().run({"/left/elbow_pid/controller_state": pid("elbow")})
    assert names_of(joints) == ["left/elbow"]
    [group] = joints
    assert group.mapping.command is not None
    assert group.mapping.command.source == "dof_state.reference"
    assert group.mapping.current is None


def test_command_of_a_pid_controller_belongs_to_the_joint_of_its_robot():
    messages = {
        "/left/joint_states": state("a"),
        "/right/joint_states": state("a"),
        "/left/a_pid/controller_state": pid("a"),
    }
    joints = Graph().run(messages)
    by_name = {name: group.mapping for group in joints for name in group.names.values()}
    assert sorted(by_name) == ["left/a", "right/a"]
    assert by_name["right/a"].command is None
    assert by_name["left/a"].command is not None
    assert by_name["left/a"].position.topic == "/left/joint_states"


def test_joint_moves_to_another_topic_when_its_own_is_silent_and_stays_there():
    graph = Graph()
    both = {"/joint_states": state("a"), "/raw_joint_states": state("a")}
    [first] = graph.run(both)
    assert first.mapping.position.topic == "/joint_states"
    [moved] = graph.run({"/raw_joint_states": state("a")}, 90)
    assert moved.mapping.position.topic == "/raw_joint_states"
    assert moved.names == {"a": "a"}
    assert graph.run(both, 90) == []
    # If all topics are silent, the joint stays on its topic.
    graph.now_ns += 10_000_000_000
    assert graph.finder.found(graph.now_ns) == []


def test_two_joints_never_become_one_actuator():
    graph = Graph()
    messages = {"/joint_states": state(["left/elbow"]), "/left/joint_states": state(["elbow"])}
    [group] = graph.run(messages)
    assert group.names == {"left/elbow": "left/elbow"}
    [(key, reason)] = graph.finder.refused.items()
    assert key == ("/left/joint_states", "elbow")
    assert "'left/elbow' on /joint_states would both be the actuator left/elbow" in reason


def test_number_of_joints_is_limited_and_the_surplus_is_named():
    graph = Graph(most=2)
    assert names_of(graph.run({"/joint_states": state("abcd")})) == ["a", "b"]
    assert graph.finder.surplus == {"c", "d"}


def test_new_names_in_every_message_are_limited():
    graph = Graph()
    for number in range(50):
        graph.run({"/joint_states": state([f"{number}_{k}" for k in range(30)])}, 1)
    assert len(graph.finder._topics["/joint_states"].joints) == 1000
    assert "more than 1000 joint names" in graph.finder.refused["/joint_states", ""]


def test_only_selected_topics_have_joints():
    messages = {
        "/joint_states": state("a"),
        "/other/joint_states": state("b"),
        "/pid/controller_state": pid("c"),
    }
    assert names_of(Graph(topics=["/joint_states"]).run(messages)) == ["a"]


def test_nothing_is_decided_again_without_a_change(monkeypatch):
    graph = Graph()
    states = {"/joint_states": state("ab"), "/left/joint_states": state("a", effort=None)}
    graph.run(states)
    decide = Mock(wraps=joint_finder.joint_sources)
    monkeypatch.setattr(joint_finder, "joint_sources", decide)
    graph.run(states, 100)
    assert decide.call_count == 0
    graph.run({"/joint_states": state("ab"), "/left/joint_states": state("a")}, 30)
    assert decide.call_count == 1
