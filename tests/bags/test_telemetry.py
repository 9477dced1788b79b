# SPDX-License-Identifier: Apache-2.0
"""Telemetry in a recording, by type and actuator, with the data that the simulator adds."""

import array
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_bags.reader import Bag
from ema_bags.telemetry import Malformed, RecordedTelemetry, read_telemetry
from ema_bags.writer import BagWriter
from ema_core.cause_profiles import cause_profiles
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_core.telemetry import COLUMNS, Telemetry
from ema_interfaces.msg import ActuatorDescription as DescriptionMessage
from ema_interfaces.msg import TelemetryBlock
from ema_ros import topics
from ema_ros.messages import (
    description_from_message,
    description_to_message,
    stamped_faults_from_message,
    telemetry_to_message,
)
from ema_ros.stamps import stamp_from_message
from ema_sim.actuator import SimulatedActuator

from .recorded_messages import ros_messages

QOS = QoSProfile(depth=10)


def blocks(first_index: int = 0) -> list[Telemetry]:
    columns = np.random.default_rng(first_index).normal(size=(len(COLUMNS), 500))
    whole = Telemetry(10**9, 1e-4, first_index, *columns)
    return [whole.part(start, start + 100) for start in range(0, 500, 100)]


def record(path: Path, *streams: tuple[str, str, list[Telemetry]], descriptions=()) -> Bag:
    """Record descriptions, and blocks of telemetry by topic and actuator."""
    with BagWriter(path) as writer:
        writer.add_topic("/remarks", String, QOS)
        writer.add_topic("/description", DescriptionMessage, QOS)
        for topic in {topic: None for topic, _, _ in streams}:
            writer.add_topic(topic, TelemetryBlock, QOS)
        for description in descriptions:
            writer.write("/description", description_to_message(description), 0)
        for topic, actuator_id, stream in streams:
            for block in stream:
                message = telemetry_to_message(block, actuator_id)
                writer.write(topic, message, int(block.stamps_ns[-1]), block.stamp_ns)
    return Bag(path)


def blocks_of(recorded: RecordedTelemetry) -> list[Telemetry | Malformed]:
    return [item for _, item in recorded.items() if not isinstance(item, ActuatorDescription)]


def assert_same(read: Sequence[Telemetry | Malformed], written: list[Telemetry]):
    for actual, expected in zip(read, written, strict=True):
        assert isinstance(actual, Telemetry)
        assert (actual.stamp_ns, actual.sample_period, actual.first_index) == (
            expected.stamp_ns,
            expected.sample_period,
            expected.first_index,
        )
        for name in COLUMNS:
            np.testing.assert_array_equal(getattr(actual, name), getattr(expected, name))


def test_telemetry_is_read_with_its_description(tmp_path: Path):
    description = ActuatorDescription(actuator_id="flap")
    rudder = replace(description, actuator_id="rudder")
    written = blocks(first_index=2**53 + 1)
    bag = record(
        tmp_path / "flight",
        ("/left/telemetry", "flap", written),
        descriptions=[description, rudder, description],
    )
    telemetry = read_telemetry(bag)
    assert (telemetry.topic, telemetry.actuator_id) == ("/left/telemetry", "flap")
    assert telemetry.descriptions == (description,)
    assert written[0].first_index == 2**53 + 1, "where a float64 would not do"
    assert_same(blocks_of(telemetry), written)
    assert_same(blocks_of(telemetry), written)


def test_unit_that_was_replaced_has_two_descriptions(tmp_path: Path):
    first = ActuatorDescription(serial_number="SN-1")
    second = replace(first, serial_number="SN-2")
    bag = record(
        tmp_path / "flight",
        ("/telemetry", first.actuator_id, blocks()),
        descriptions=[first, second],
    )
    assert read_telemetry(bag).descriptions == (first, second)


FLAP = ("/telemetry", "flap", blocks())
OWN_TOPICS = [("/left/telemetry", "left", blocks(0)), ("/right/telemetry", "right", blocks(7000))]
ONE_TOPIC = [("/telemetry", "left", blocks(0)), ("/telemetry", "right", blocks(7000))]
ONE_ACTUATOR = [("/raw", "flap", blocks(0)), ("/filtered", "flap", blocks(7000))]


@pytest.mark.parametrize(
    ("streams", "choice", "reported"),
    [
        (
            [],
            {},
            r"flight has no topic of ema_interfaces/msg/TelemetryBlock; topics: "
            r"/remarks \(std_msgs/msg/String\), /description",
        ),
        ([("/telemetry", "flap", [])], {}, "has no messages on /telemetry"),
        ([FLAP], {"topic": "/remarks"}, "has no telemetry on '/remarks'; topics: .*/telemetry"),
        ([FLAP], {"topic": "/telemetri"}, "has no telemetry on '/telemetri'; topics: .*/tele"),
        (
            OWN_TOPICS,
            {},
            r"several topics: /left/telemetry \(actuator 'left'\), "
            r"/right/telemetry \(actuator 'right'\): choose one by topic or actuator_id",
        ),
        (OWN_TOPICS, {"actuator_id": "mid"}, r"no telemetry of actuator 'mid'; it has /left/tele"),
        (ONE_TOPIC, {}, r"actuators: 'left', 'right': choose one .*--actuator-id"),
        (ONE_ACTUATOR, {"actuator_id": "flap"}, "choose one by topic"),
    ],
)
def test_missing_or_ambiguous_telemetry_is_refused(tmp_path: Path, streams, choice, reported: str):
    bag = record(tmp_path / "flight", *streams)
    with pytest.raises(ValueError, match=reported):
        blocks_of(read_telemetry(bag, **choice))


@pytest.mark.parametrize(
    ("streams", "choice", "number"),
    [
        (OWN_TOPICS, {"actuator_id": "right"}, 1),
        (OWN_TOPICS, {"topic": "/left/telemetry"}, 0),
        (ONE_TOPIC, {"actuator_id": "left"}, 0),
        (ONE_TOPIC, {"actuator_id": "right"}, 1),
        (ONE_ACTUATOR, {"topic": "/filtered", "actuator_id": "flap"}, 1),
    ],
)
def test_telemetry_is_chosen_by_topic_and_actuator(tmp_path: Path, streams, choice, number: int):
    bag = record(tmp_path / "flight", *streams)
    assert_same(blocks_of(read_telemetry(bag, **choice)), streams[number][2])


def test_malformed_block_is_reported_at_its_position(tmp_path: Path):
    good = blocks()[0]
    message = telemetry_to_message(good, "flap")
    message.speed = array.array("d", [0.0])
    with BagWriter(tmp_path / "flight") as writer:
        writer.add_topic("/telemetry", TelemetryBlock, QOS)
        writer.write("/telemetry", message, 7, 6)
        writer.write("/telemetry", telemetry_to_message(good, "flap"), 9, 8)
    first, second = blocks_of(read_telemetry(Bag(tmp_path / "flight")))
    assert isinstance(first, Malformed)
    assert first.stamp_ns == stamp_from_message(message.header.stamp)
    assert "position 100, speed 1" in first.reason
    assert_same([second], [good])


def test_impossible_description_is_skipped_and_named_with_its_position(tmp_path: Path):
    message = description_to_message(ActuatorDescription(actuator_id="flap"))
    message.gear_ratio = 0.0
    with BagWriter(tmp_path / "flight") as writer:
        writer.add_topic("/telemetry", TelemetryBlock, QOS)
        writer.add_topic("/description", DescriptionMessage, QOS)
        writer.write("/description", message, 5, 5)
        message.gear_ratio = 0.002
        writer.write("/description", message, 6, 6)
        writer.write("/telemetry", telemetry_to_message(blocks()[0], "flap"), 7, 6)
    recorded = read_telemetry(Bag(tmp_path / "flight"))
    assert [description.parameters.tau for description in recorded.descriptions] == [0.002]
    assert "topic /description: 1 malformed message skipped" in recorded.bag.damage
    assert "log time 5 ns: invalid description: tau = 0 is outside" in (recorded.bag.damage)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Record two cycles of 30 ms. Return the description, blocks with torques, and messages."""
    description = replace(ActuatorDescription(), serial_number="SN-3")
    actuator = SimulatedActuator(description.parameters)
    path = tmp_path_factory.mktemp("bag") / "two.mcap"
    written = []
    with SimulatedActuatorBag(BagWriter(path), description) as bag:
        for cycle, friction in enumerate((0.1, 0.2)):
            bag.begin_cycle(cycle, fault_vector({"friction": friction}), 10.0 * cycle)
            for _ in range(3):
                block = actuator.advance(np.full(100, 1e-3))
                bag.write_block(block, actuator.state.torque)
                written.append((block, actuator.state.torque))
    return description, written, ros_messages(Bag(path))


def on(recorded, name):
    return [item for item in recorded[2] if item.topic == f"{topics.NAMESPACE}/{name}"]


def test_description_comes_first(recorded):
    assert recorded[2][0].topic.endswith(topics.DESCRIPTION)
    [item] = on(recorded, topics.DESCRIPTION)
    assert description_from_message(item.message) == recorded[0]


def test_truth_is_stamped_with_the_start_of_its_cycle(recorded):
    truths = [stamped_faults_from_message(i.message) for i in on(recorded, topics.SIMULATED_FAULTS)]
    assert [(t.cycle, t.faults[0], t.stamp_ns) for t in truths] == [
        (0, 0.1, 0),
        (1, 0.2, 30_000_000),
    ]


def test_service_life_is_counted_at_the_start_of_each_cycle(recorded):
    counts = [item.message for item in on(recorded, topics.USAGE)]
    assert {(m.actuator_id, m.serial_number) for m in counts} == {("flap", "SN-3")}
    assert [(m.flight_hours, m.cycles) for m in counts] == [(0.0, 1), (10.0, 2)]
    truths = [item.message for item in on(recorded, topics.SIMULATED_FAULTS)]
    assert [m.header.stamp for m in counts] == [m.header.stamp for m in truths]


def test_joint_state_has_the_angle_of_the_user_shaft(recorded):
    tau = recorded[0].parameters.tau
    joints = [item.message for item in on(recorded, topics.JOINT_STATES)]
    assert len(joints) == len(recorded[1])
    for joint, (block, torque) in zip(joints, recorded[1], strict=True):
        assert list(joint.name) == ["flap"]
        assert list(joint.position) == [block.position[-1]]
        assert list(joint.velocity) == [tau * block.speed[-1]]
        assert list(joint.effort) == [torque / tau]


def test_telemetry_is_received_at_its_last_sample(recorded):
    for item, (block, _) in zip(on(recorded, topics.TELEMETRY), recorded[1], strict=True):
        assert item.publish_time_ns == block.stamp_ns
        assert item.log_time_ns == block.stamps_ns[-1]
        assert item.message.first_index == block.first_index
        np.testing.assert_array_equal(item.message.current, block.current)


@pytest.mark.parametrize("name", ["case.mcap", "case"])
def test_hidden_causes_are_in_the_metadata(tmp_path, name):
    with SimulatedActuatorBag(BagWriter(tmp_path / name), ActuatorDescription()) as bag:
        bag.note_causes(cause_profiles(["load_torque=0.01", "winding_temperature=80@0..10"]))
        bag.write_block(SimulatedActuator().advance(np.zeros(2)))
    noted = {"hidden_causes": "load_torque=0.01 winding_temperature=80@0..10"}
    file = tmp_path / name if name.endswith("mcap") else tmp_path / name / f"{name}_0.mcap"
    with file.open("rb") as stream:
        [record] = [item for item in make_reader(stream).iter_metadata() if item.name == "rosbag2"]
    assert yaml.safe_load(record.metadata["serialized_metadata"])["custom_data"] == noted
    assert cause_profiles(noted["hidden_causes"].split())["load_torque"].value == 0.01
