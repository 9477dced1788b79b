# SPDX-License-Identifier: Apache-2.0
"""Joint states are read once for all joints, and give the same result as for each joint alone."""

from types import SimpleNamespace

import numpy as np
import pytest

from ema_bags.inputs.joint_states import JointStates, reads_joint_states
from ema_bags.inputs.series import Collector

from .conftest import mapping_from

STATES = "/joint_states"
JOINTS = ("a", "b", "c")


def mapping(**changes):
    content = {
        "joints": list(JOINTS),
        "position": {"topic": STATES, "source": "position"},
        "speed": {"topic": STATES, "source": "velocity", "shaft": "user"},
        "current": {"topic": STATES, "source": "effort"},
    }
    return mapping_from({k: v for k, v in (content | changes).items() if v is not None})


def message(i, names, *, without=()):
    stamp = SimpleNamespace(sec=1_700_000_000, nanosec=1_000_000 * i)
    values = {
        field: [] if field in without else [100.0 * k + ord(name) + i for name in names]
        for k, field in enumerate(("position", "velocity", "effort"))
    }
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp), name=list(names), **values)


def read(messages, of=None):
    states = JointStates(of or mapping())
    for i, item in enumerate(messages):
        states.add(STATES, item, 0, i)
    states.share()
    return states


def test_each_joint_has_the_same_values_as_from_its_own_reader():
    messages = [message(i, "xabc" if i % 2 else "cbax") for i in range(7)]
    states = read(messages)
    for joint in JOINTS:
        alone = Collector(mapping().of_joint(joint))
        for i, item in enumerate(messages):
            alone.add(STATES, item, 0, i)
        expected, series = alone.take()[STATES], states.of_joint(joint).take()[STATES]
        assert np.array_equal(series.stamps_ns, expected.stamps_ns)
        assert np.array_equal(series.arrivals_ns, expected.arrivals_ns)
        assert series.values.keys() == expected.values.keys()
        for key, values in expected.values.items():
            assert np.array_equal(series.values[key], values)


def test_messages_without_a_joint_count_as_from_another_publisher():
    states = read([message(i, "ab" if i % 2 else "c") for i in range(6)])
    assert len(states.of_joint("a").take()[STATES]) == 3
    assert len(states.of_joint("c").take()[STATES]) == 3
    assert not states.of_joint("a").problem()
    gone = read([message(0, "ab"), message(1, "ab")]).of_joint("c")
    assert gone.problem() == "joint 'c' is missing in all 2 messages"


def test_missing_joint_is_named_with_the_time_of_its_last_message():
    states = JointStates(mapping())

    def send(names, begin_s, end_s):
        for ns in range(round(begin_s * 1e9), round(end_s * 1e9), 100_000_000):
            states.add(STATES, message(0, names), 0, 1_700_000_000_000_000_000 + ns)
        states.share()

    column = states.of_joint("b")
    send("abc", 0.0, 1.0)
    send("ac", 1.0, 1.9)
    assert not column.problem()  # Other publishers may send the other joints.
    send("ac", 1.9, 4.0)
    assert column.problem() == (
        "joint 'b' is missing in the messages since 2023-11-14 22:13:21 UTC"
    )
    assert column.rejected == 30
    assert not states.of_joint("a").problem()
    send("abc", 4.0, 4.1)
    assert not column.problem()


def test_empty_array_is_not_a_number():
    series = read([message(i, "abc", without=("effort",)) for i in range(3)])
    values = series.of_joint("b").take()[STATES].values
    assert np.all(np.isnan(values["current"]))
    assert np.array_equal(values["position"], [98.0, 99.0, 100.0])


def test_collected_rows_are_not_returned_again():
    states = read([message(0, "abc")])
    assert len(states.of_joint("a").take()[STATES]) == 1
    assert len(states.of_joint("a").take()[STATES]) == 0


@pytest.mark.parametrize(
    ("changes", "is_read_at_once"),
    [
        ({}, True),
        ({"current": None}, True),
        ({"command": {"topic": "/command", "source": "data[0]"}}, False),
        ({"position": {"topic": STATES, "source": "position[0]"}}, False),
        ({"clock": {"source": "header.stamp.sec"}}, False),
    ],
)
def test_only_plain_fields_of_one_topic_are_read_together(changes, is_read_at_once):
    assert reads_joint_states(mapping(**changes)) is is_read_at_once


def test_commands_of_another_topic_are_read_with_the_states():
    of = mapping(command={"topic": "/commands", "source": "position"})
    assert reads_joint_states(of)
    states = JointStates(of)
    for i in range(4):
        states.add(STATES, message(i, "abc"), 0, i)
    states.add("/commands", message(9, "ba"), 0, 9)
    states.share()
    taken = states.of_joint("b").take()
    assert list(taken[STATES].values["position"]) == [98.0, 99.0, 100.0, 101.0]
    assert list(taken["/commands"].values["command"]) == [107.0]
    assert len(states.of_joint("c").take()["/commands"]) == 0


def test_removed_joint_is_not_collected():
    states = JointStates(mapping())
    collector = states.of_joint("b")
    states.remove("b")
    states.add(STATES, message(0, "abc"), 0, 0)
    states.share()
    assert len(collector.take()[STATES]) == 0
    assert len(states.of_joint("a").take()[STATES]) == 1


def test_interface_values_are_read_once_for_all_joints():
    """The values equal those from a reader of each joint; a joint may lack an interface."""
    path = "interface_values[joint_names={joint}].values[interface_names=%s]"
    topic = "/dynamic_joint_states"
    of = mapping_from(
        {
            "joints": ["a", "b"],
            "position": {"topic": topic, "source": path % "position"},
            "current": {"topic": topic, "source": path % "effort"},
        }
    )
    assert reads_joint_states(of)
    states = JointStates(of)
    alone = Collector(of.of_joint("a"))
    for i in range(5):
        stamp = SimpleNamespace(sec=1_700_000_000, nanosec=1_000_000 * i)
        items = {
            "b": SimpleNamespace(interface_names=["position"], values=[10.0 + i]),
            "a": SimpleNamespace(interface_names=["effort", "position"], values=[2.0, 20.0 + i]),
        }
        order = list(items)[:: 1 if i % 2 else -1]
        sent = SimpleNamespace(
            header=SimpleNamespace(stamp=stamp),
            joint_names=order,
            interface_values=[items[name] for name in order],
        )
        states.add(topic, sent, 0, i)
        alone.add(topic, sent, 0, i)
    states.share()
    series, expected = states.of_joint("a").take()[topic], alone.take()[topic]
    for key, values in expected.values.items():
        np.testing.assert_array_equal(series.values[key], values)
    lacking = states.of_joint("b").take()[topic].values
    np.testing.assert_array_equal(lacking["position"], 10.0 + np.arange(5))
    assert np.all(np.isnan(lacking["current"]))
