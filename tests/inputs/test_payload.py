# SPDX-License-Identifier: Apache-2.0
"""The payload of a robot in tables, bags and topics: one payload for all joints."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import yaml

from ema_bags.inputs.bridging import Bridge, BridgeSettings
from ema_bags.inputs.conversion import convert
from ema_bags.inputs.doubts import DoubtKind
from ema_bags.inputs.examine import examine
from ema_bags.inputs.importing import import_series
from ema_bags.inputs.joint_finder import JointFinder
from ema_bags.inputs.joint_messages import JOINT_STATE
from ema_bags.inputs.joint_states import JointStates, reads_joint_states
from ema_bags.inputs.joint_topics import JointTopics
from ema_bags.inputs.mapping import mapping_text
from ema_bags.inputs.series import Series

from .conftest import mapping_from
from .joint_motion import START_NS, joint, moves

RATE_HZ = 200.0
JOINTS = ("a", "b")
S = 1_000_000_000


def table(seconds=12.0, **more):
    """Return the columns of two joints, and further columns."""
    columns = {"t": np.arange(round(seconds * RATE_HZ)) / RATE_HZ}
    for number, name in enumerate(JOINTS):
        motion, _ = moves(seconds, RATE_HZ, 0.5 - 0.1 * number, number)
        columns |= {
            f"{name}_position": motion["position"],
            f"{name}_velocity": motion["speed"],
            f"{name}_effort": motion["current"],
        }
    return columns | more


def grips(n, mass=1.0):
    """Return a payload [kg] that is held in the second and fourth quarter of the samples."""
    return mass * (np.arange(n) * 4 // n % 2)


def examined(tmp_path, **more):
    columns = table()
    n = len(columns["t"])
    pd.DataFrame(columns | {name: make(n) for name, make in more.items()}).to_csv(
        tmp_path / "log.csv", index=False
    )
    return examine(tmp_path / "log.csv").joints


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("payload", grips),
        ("payload", np.zeros),
        ("payload_kg", lambda n: grips(n, 2.35)),
        ("load_kg", lambda n: grips(n, 0.4)),
        ("gripper", grips),
        ("isHolding", grips),
    ],
)
def test_payload_of_a_table_is_recognised_by_its_name_for_all_joints(tmp_path, name, make):
    joints = examined(tmp_path, **{name: make})
    assert [item.joint for item in joints] == ["a", "b"]
    for item in joints:
        assert item.mapping.payload is not None
        assert item.mapping.payload.source == name
        assert mapping_from(yaml.safe_load(mapping_text(item.mapping))) == item.mapping
        [column] = [column for column in item.columns if column.quantity == "payload"]
        # The motion does not confirm the payload.
        assert [doubt.kind for doubt in column.doubts] == [DoubtKind.NAME_ALONE]


@pytest.mark.parametrize(
    ("name", "make"),
    [
        # A flag with another name, the position of a gripper, and a measured weight that drifts.
        ("alarm", grips),
        ("gripper", lambda n: 0.01 + 0.03 * grips(n)),
        ("gripper", lambda n: 0.04 * np.abs(np.sin(np.arange(n) / 50.0))),
        ("payload", lambda n: 1.0 + np.random.default_rng(0).normal(0.0, 0.01, n)),
    ],
)
def test_other_columns_are_not_a_payload(tmp_path, name, make):
    assert all(item.mapping.payload is None for item in examined(tmp_path, **{name: make}))


def test_two_possible_payload_columns_leave_the_choice_open(tmp_path):
    joints = examined(tmp_path, payload_left=grips, payload_right=grips)
    assert all(item.mapping.payload is None for item in joints)


@pytest.mark.parametrize(
    ("section", "raw", "expected"),
    [
        ({}, [0.0, 2.5, np.nan], [0.0, 2.5, 1.0]),
        ({"scale": 0.001}, [0.0, 500.0], [0.0, 0.5]),
        ({"above": 0.3}, [0.0, 0.3, 0.8], [0.0, 0.0, 0.5]),
        # A gripper whose position decreases when it closes.
        ({"sign": -1, "above": -0.03}, [0.04, 0.03, 0.01], [0.0, 0.0, 0.02]),
    ],
)
def test_payload_is_positive_while_a_load_is_held_or_unknown(mapped, section, raw, expected):
    mapping = mapped(payload={"source": "g", **section}, command=None, speed=None, current=None)
    zeros = np.zeros(len(raw))
    columns = convert({"position": zeros, "payload": np.array(raw)}, mapping, joint())
    assert columns["payload"] == pytest.approx(expected)


@pytest.mark.parametrize("jitter_ns", [0, 1_000_000])
def test_payload_is_imported_without_interpolated_values(mapped, jitter_ns):
    columns, stamps = moves(12.0, RATE_HZ)
    payload = grips(len(stamps), 2.0)
    stamps = stamps + np.random.default_rng(0).integers(-jitter_ns, jitter_ns + 1, len(stamps))
    series = Series(stamps, stamps, {**columns, "payload": payload.astype(np.float64)})
    recording = import_series({"": series}, mapped(payload="g"), joint(RATE_HZ))
    blocks = list(recording.blocks())
    held = np.concatenate([block.payload for block in blocks])
    assert set(held) == {0.0, 2.0}
    assert np.mean(held) == pytest.approx(1.0, abs=0.01)
    plain = import_series({"": series}, mapped(), joint(RATE_HZ))
    assert not any(block.has_payload for block in plain.blocks())


def state(i, names="ab", topic_value=None):
    stamp = SimpleNamespace(sec=START_NS // S, nanosec=5_000_000 * i)
    if topic_value is not None:
        return SimpleNamespace(data=topic_value)
    values = {field: [1.0 + i] * len(names) for field in ("position", "velocity", "effort")}
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp), name=list(names), **values)


def test_joints_of_a_namespace_have_its_payload():
    finder = JointFinder()
    for i in range(30):
        for side in ("left", "right"):
            finder.add(f"/{side}/joint_states", JOINT_STATE, state(i), 50_000_000 * i)
    finder.add("/left/payload", "std_msgs/msg/Bool", state(0, topic_value=True), 0)
    groups = {group.mapping.position.topic: group.mapping for group in finder.found(2 * S)}
    left, right = groups["/left/joint_states"], groups["/right/joint_states"]
    assert right.payload is None
    assert left.payload is not None
    assert (left.payload.topic, left.payload.source) == ("/left/payload", "data")
    assert reads_joint_states(left)
    # A topic that appears later completes the joints.
    finder.add("/right/payload", "std_msgs/msg/Float64", state(0, topic_value=0.0), 3 * S)
    [group] = finder.found(4 * S)
    assert group.mapping.payload is not None
    assert sorted(group.names.values()) == ["right/a", "right/b"]


@pytest.mark.parametrize(
    ("payload", "message"),
    [
        ({"topic": "/payload", "source": "data"}, lambda held: SimpleNamespace(data=held)),
        (
            {"topic": "/gripper", "source": "position", "joint": "finger", "above": 0.5},
            lambda held: SimpleNamespace(name=["other", "finger"], position=[0.0, float(held)]),
        ),
    ],
)
def test_all_joints_read_the_payload_live(payload, message):
    mapping = mapping_from(
        {
            "joints": list(JOINTS),
            "position": {"topic": "/joint_states", "source": "position"},
            "payload": payload,
        }
    )
    assert reads_joint_states(mapping)
    states = JointStates(mapping)
    bridges = [
        Bridge(mapping.of_joint(name), joint(RATE_HZ), BridgeSettings(), states.of_joint(name))
        for name in JOINTS
    ]
    columns, stamps = moves(12.0, RATE_HZ)
    blocks = [[], []]
    held = grips(len(stamps)).astype(bool)
    for i, stamp_ns in enumerate(stamps.tolist()):
        if i and held[i] != held[i - 1]:
            states.add(payload["topic"], message(held[i]), 0, stamp_ns - 1)
        stamp = SimpleNamespace(sec=stamp_ns // S, nanosec=stamp_ns % S)
        angle = float(columns["position"][i])
        states.add(
            "/joint_states",
            SimpleNamespace(
                header=SimpleNamespace(stamp=stamp), name=["b", "a"], position=[angle, angle]
            ),
            0,
            stamp_ns,
        )
        if i % 20 == 19:
            states.share()
            for number, bridge in enumerate(bridges):
                blocks[number] += bridge.advance()
    for joint_blocks in blocks:
        values = np.concatenate([block.payload for block in joint_blocks]) > 0.0
        assert len(values) > 0.9 * len(held)
        # Before the first message, the payload is unknown.
        first = int(np.argmax(held))
        assert np.all(values[:first])
        assert np.array_equal(values[first:], held[first : len(values)])


def test_joints_on_topics_have_the_payload_of_their_robot():
    topics = JointTopics()
    columns, stamps = moves(12.0, RATE_HZ)
    held = grips(len(stamps)).astype(bool)
    for i, stamp_ns in enumerate(stamps.tolist()):
        stamp = SimpleNamespace(sec=stamp_ns // S, nanosec=stamp_ns % S)
        arrays = {
            "position": [float(columns["position"][i])],
            "velocity": [float(columns["speed"][i])],
            "effort": [float(columns["current"][i])],
        }
        message = SimpleNamespace(header=SimpleNamespace(stamp=stamp), name=["a"], **arrays)
        topics.add("/r/joint_states", JOINT_STATE, message, 0, stamp_ns)
        if i % 100 == 0:
            flag = SimpleNamespace(data=bool(held[i]))
            topics.add("/r/payload", "std_msgs/msg/Bool", flag, 0, stamp_ns)
            topics.add("/r/alarm", "std_msgs/msg/Bool", flag, 0, stamp_ns)
            topics.add("/s/payload", "std_msgs/msg/Bool", flag, 0, stamp_ns)
    assert set(topics.topics) == {"/r/joint_states", "/r/payload", "/s/payload"}
    [joint_found] = topics.joints()
    mapping = joint_found.guess.mapping
    assert mapping.payload is not None
    assert mapping.payload.topic == "/r/payload"
    assert mapping.command is None
    imported = import_series(joint_found.by_topic, mapping, joint(RATE_HZ))
    values = np.concatenate([block.payload for block in imported.blocks()]) > 0.0
    assert np.mean(values == held) > 0.9
