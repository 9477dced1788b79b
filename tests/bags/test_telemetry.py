"""Telemetry is found in a recording by its type, and by its actuator where there are several."""

import array
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from ema_bags.reader import Bag
from ema_bags.telemetry import Malformed, RecordedTelemetry, read_telemetry
from ema_bags.writer import BagWriter
from ema_core.description import ActuatorDescription
from ema_core.telemetry import COLUMNS, Telemetry
from ema_interfaces.msg import ActuatorDescription as DescriptionMessage
from ema_interfaces.msg import TelemetryBlock
from ema_ros.messages import description_to_message, telemetry_to_message
from ema_ros.stamps import stamp_from_message

QOS = QoSProfile(depth=10)


def blocks(first_index: int = 0) -> list[Telemetry]:
    columns = np.random.default_rng(first_index).normal(size=(len(COLUMNS), 500))
    whole = Telemetry(10**9, 1e-4, first_index, *columns)
    return [whole.part(start, start + 100) for start in range(0, 500, 100)]


def record(path: Path, *streams: tuple[str, str, list[Telemetry]], descriptions=()) -> Bag:
    """Record blocks of telemetry by topic and actuator, and descriptions."""
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
    for one, other in zip(read, written, strict=True):
        assert isinstance(one, Telemetry)
        assert (one.stamp_ns, one.sample_period, one.first_index) == (
            other.stamp_ns,
            other.sample_period,
            other.first_index,
        )
        for name in COLUMNS:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_telemetry_comes_back_with_its_description(tmp_path: Path):
    description = ActuatorDescription(actuator_id="flap")
    other = replace(description, actuator_id="rudder")
    written = blocks(first_index=2**53 + 1)
    bag = record(
        tmp_path / "flight",
        ("/left/telemetry", "flap", written),
        descriptions=[description, other, description],
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


def test_recording_without_telemetry_says_what_it_has(tmp_path: Path):
    bag = record(tmp_path / "flight")
    with pytest.raises(
        ValueError,
        match=r"flight has no topic of ema_interfaces/msg/TelemetryBlock; topics: "
        r"/remarks \(std_msgs/msg/String\), /description",
    ):
        read_telemetry(bag)


def test_telemetry_topic_without_a_block_is_refused(tmp_path: Path):
    bag = record(tmp_path / "flight", ("/telemetry", "flap", []))
    with pytest.raises(ValueError, match="has no message on /telemetry"):
        read_telemetry(bag)


@pytest.mark.parametrize("topic", ["/remarks", "/telemetri"])
def test_topic_that_is_no_telemetry_is_refused(topic: str, tmp_path: Path):
    bag = record(tmp_path / "flight", ("/telemetry", "flap", blocks()))
    with pytest.raises(ValueError, match=f"has no telemetry on '{topic}'; topics: .*/telemetry"):
        read_telemetry(bag, topic=topic)


def test_several_actuators_on_topics_of_their_own(tmp_path: Path):
    left, right = blocks(0), blocks(7000)
    bag = record(
        tmp_path / "flight", ("/left/telemetry", "left", left), ("/right/telemetry", "right", right)
    )
    with pytest.raises(
        ValueError,
        match=r"several topics: /left/telemetry \(actuator 'left'\), "
        r"/right/telemetry \(actuator 'right'\): choose one by topic or actuator_id",
    ):
        read_telemetry(bag)
    assert_same(blocks_of(read_telemetry(bag, actuator_id="right")), right)
    assert_same(blocks_of(read_telemetry(bag, topic="/left/telemetry")), left)
    with pytest.raises(ValueError, match=r"no telemetry of actuator 'middle'; it has /left/tele"):
        read_telemetry(bag, actuator_id="middle")


def test_several_actuators_on_one_topic(tmp_path: Path):
    left, right = blocks(0), blocks(7000)
    bag = record(tmp_path / "flight", ("/telemetry", "left", left), ("/telemetry", "right", right))
    with pytest.raises(ValueError, match=r"actuators: 'left', 'right': choose one .*--actuator-id"):
        blocks_of(read_telemetry(bag))
    assert_same(blocks_of(read_telemetry(bag, actuator_id="left")), left)
    assert_same(blocks_of(read_telemetry(bag, actuator_id="right")), right)


def test_one_actuator_on_two_topics_needs_a_topic(tmp_path: Path):
    raw, filtered = blocks(0), blocks(7000)
    bag = record(tmp_path / "flight", ("/raw", "flap", raw), ("/filtered", "flap", filtered))
    with pytest.raises(ValueError, match="choose one by topic"):
        read_telemetry(bag, actuator_id="flap")
    telemetry = read_telemetry(bag, topic="/filtered", actuator_id="flap")
    assert_same(blocks_of(telemetry), filtered)


def test_malformed_block_is_told_in_its_place(tmp_path: Path):
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


def test_impossible_description_is_skipped_and_named_with_its_place(tmp_path: Path):
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
    assert [one.parameters.tau for one in recorded.descriptions] == [0.002]
    assert "topic /description: 1 malformed message skipped" in recorded.bag.damage
    assert "log time 5 ns: the description is impossible: tau = 0 - is outside" in (
        recorded.bag.damage
    )
