"""What is recorded is what other readers of rosbag2's recordings read, whatever ends the writer."""

import array
import signal
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2
from std_msgs.msg import Header, String

from ema_bags.message_type import type_hash
from ema_bags.qos import offered_qos
from ema_bags.reader import Bag
from ema_bags.schema import schema_text
from ema_bags.writer import BagWriter
from ema_interfaces.msg import FaultHealth, Health, TelemetryBlock

from ..waiting import started, wait_for
from .recorded_messages import ros_messages

QOS = QoSProfile(depth=10)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
START_NS = 1_700_000_000_000_000_000
STEP_NS = 10_000_000
Written = list[tuple[str, Any, int, int]]


def block(number: int) -> TelemetryBlock:
    rng = np.random.default_rng(number)
    message = TelemetryBlock(actuator_id="flap", sample_period=1e-4)
    message.header.stamp.sec = number
    message.first_index = 2**53 + 1 + 100 * number
    for name in ("command", "current", "position", "speed"):
        setattr(message, name, array.array("d", rng.normal(size=100).tobytes()))
    return message


def health(number: int) -> Health:
    backlash = FaultHealth(name="backlash", value=0.01 * number)
    backlash.rul.hours_50 = 300.0 - number
    return Health(actuator_id="flap", cycles=number, faults=[backlash, FaultHealth(name="gain")])


def record(path: Path, blocks: int = 60, **settings) -> Written:
    """Record blocks and now and then a health message; what was written."""
    written = []
    with BagWriter(path, **settings) as writer:
        writer.add_topic("/ema/telemetry", TelemetryBlock, QOS)
        writer.add_topic("/ema/health", Health, LATCHED)
        for number in range(blocks):
            log_time_ns = START_NS + number * STEP_NS
            written.append(("/ema/telemetry", block(number), log_time_ns, log_time_ns - 1000))
            if number % 20 == 10:
                written.append(("/ema/health", health(number), log_time_ns + 1, log_time_ns))
        for item in written:
            writer.write(*item)
    return written


def as_read(bag: Bag) -> Written:
    return [
        (item.topic, item.message, item.log_time_ns, item.publish_time_ns)
        for item in ros_messages(bag)
    ]


@pytest.fixture(params=["flight", "flight.mcap"])
def path(request, tmp_path: Path) -> Path:
    return tmp_path / "new folder" / request.param


def file_of(path: Path) -> Path:
    return path if path.suffix == ".mcap" else path / f"{path.name}_0.mcap"


@pytest.mark.parametrize("chunk_bytes", [1, 10_000_000])
def test_own_reader_reads_what_was_written(path: Path, chunk_bytes: int):
    written = record(path, chunk_bytes=chunk_bytes)
    bag = Bag(path)
    assert as_read(bag) == written
    assert bag.damage == ""
    assert {name: topic.count for name, topic in bag.topics.items()} == {
        "/ema/telemetry": 60,
        "/ema/health": 3,
    }
    assert (bag.start_ns, bag.end_ns) == (START_NS, START_NS + 59 * STEP_NS)
    assert bag.topics["/ema/health"].type_name == "ema_interfaces/msg/Health"
    assert bag.topics["/ema/health"].type_hash == type_hash("ema_interfaces/msg/Health")


def test_rosbags_reads_what_was_written(path: Path):
    written = record(path)
    with AnyReader([path]) as reader:
        assert {connection.topic for connection in reader.connections} == {
            "/ema/telemetry",
            "/ema/health",
        }
        read: list[tuple[str, Any, int]] = [
            (connection.topic, reader.deserialize(data, connection.msgtype), log_time_ns)
            for connection, log_time_ns, data in reader.messages()
        ]
        for connection in reader.connections:
            assert isinstance(connection.ext, ConnectionExtRosbag2)
            (qos,) = connection.ext.offered_qos_profiles
            assert qos.depth == (1 if connection.topic == "/ema/health" else 10)
    assert len(read) == len(written)
    for (topic, message, log_time_ns, _), (read_topic, other, read_ns) in zip(
        written, read, strict=True
    ):
        assert (read_topic, read_ns) == (topic, log_time_ns)
        if isinstance(message, TelemetryBlock):
            assert other.first_index == message.first_index > 2**53
            assert other.header.stamp.sec == message.header.stamp.sec
            np.testing.assert_array_equal(other.current, message.current)
            np.testing.assert_array_equal(other.speed, message.speed)
        else:
            assert [fault.name for fault in other.faults] == ["backlash", "gain"]
            assert other.faults[0].rul.hours_50 == message.faults[0].rul.hours_50


def test_records_are_rosbag2s(path: Path):
    record(path)
    with file_of(path).open("rb") as file:
        reader = make_reader(file)
        header, summary = reader.get_header(), reader.get_summary()
        (metadata,) = reader.iter_metadata()
    assert header.profile == "ros2"
    assert summary is not None
    channel = next(item for item in summary.channels.values() if item.topic == "/ema/health")
    schema = summary.schemas[channel.schema_id]
    assert (schema.name, schema.encoding) == ("ema_interfaces/msg/Health", "ros2msg")
    assert schema.data.decode() == schema_text("ema_interfaces/msg/Health")
    assert channel.message_encoding == "cdr"
    assert channel.metadata["topic_type_hash"] == type_hash("ema_interfaces/msg/Health")
    assert yaml.safe_load(channel.metadata["offered_qos_profiles"]) == [offered_qos(LATCHED)]
    assert metadata.name == "rosbag2"
    information = yaml.safe_load(metadata.metadata["serialized_metadata"])
    assert information["relative_file_paths"] == [file_of(path).name]
    assert information["message_count"] == 63


def test_metadata_file_is_rosbag2s(tmp_path: Path):
    record(tmp_path / "flight")
    text = (tmp_path / "flight" / "metadata.yaml").read_text()
    assert "&" not in text, "no YAML references"
    extent = {
        "duration": {"nanoseconds": 59 * STEP_NS},
        "starting_time": {"nanoseconds_since_epoch": START_NS},
        "message_count": 63,
    }
    information = yaml.safe_load(text)["rosbag2_bagfile_information"]
    topics = information.pop("topics_with_message_count")
    assert information == extent | {
        "version": 9,
        "storage_identifier": "mcap",
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": ["flight_0.mcap"],
        "files": [extent | {"path": "flight_0.mcap"}],
        "custom_data": None,
        "ros_distro": "jazzy",
    }
    assert topics[1] == {
        "topic_metadata": {
            "name": "/ema/health",
            "type": "ema_interfaces/msg/Health",
            "serialization_format": "cdr",
            "offered_qos_profiles": [offered_qos(LATCHED)],
            "type_description_hash": type_hash("ema_interfaces/msg/Health"),
        },
        "message_count": 3,
    }
    assert sorted(item.name for item in (tmp_path / "flight").iterdir()) == [
        "flight_0.mcap",
        "metadata.yaml",
    ]


def test_recording_without_a_message_is_whole(path: Path):
    with BagWriter(path) as writer:
        writer.add_topic("/ema/telemetry", TelemetryBlock, QOS)
    bag = Bag(path)
    assert (bag.damage, bag.start_ns, bag.end_ns) == ("", None, None)
    assert bag.topics["/ema/telemetry"].count == 0
    assert list(bag.messages()) == []
    with AnyReader([path]) as reader:
        assert reader.message_count == 0


def test_recording_is_not_replaced_unasked(path: Path):
    written = record(path, blocks=3)
    with pytest.raises(FileExistsError, match="is there already"):
        BagWriter(path)
    assert as_read(Bag(path)) == written
    written = record(path, blocks=5, overwrite=True)
    assert as_read(Bag(path)) == written


def test_nothing_but_a_recording_is_replaced(tmp_path: Path):
    folder = tmp_path / "flight"
    record(folder, blocks=3)
    (folder / "notes.txt").write_text("mine")
    (tmp_path / "folder.mcap").mkdir()
    (tmp_path / "file").write_text("mine")
    for target in (folder, tmp_path / "folder.mcap", tmp_path / "file"):
        with pytest.raises(FileExistsError, match="not a recording alone"):
            BagWriter(target, overwrite=True)
    assert (folder / "notes.txt").read_text() == "mine"
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"flush_s": 0.0}, "flush_s = 0.0 s: expected a positive number"),
        ({"flush_s": float("nan")}, "flush_s = nan s: expected a positive number"),
    ],
)
def test_impossible_settings_are_refused(tmp_path: Path, settings: dict, told: str):
    with pytest.raises(ValueError, match=told):
        BagWriter(tmp_path / "flight", **settings)
    assert list(tmp_path.iterdir()) == []


def test_wrong_use_is_refused_and_leaves_the_recording_whole(path: Path):
    with BagWriter(path) as writer:
        writer.add_topic("/t", String, QOS)
        with pytest.raises(ValueError, match="topic /t was added before"):
            writer.add_topic("/t", String, QOS)
        with pytest.raises(ValueError, match=r"topic '/u' was not added .*; added: /t"):
            writer.write("/u", String(), 0, 0)
        with pytest.raises(ValueError, match="topic /t holds std_msgs/msg/String, not Header"):
            writer.write("/t", Header(), 0, 0)
        with pytest.raises(ValueError, match="log_time_ns = -1 ns on topic /t is outside"):
            writer.write("/t", String(), -1, 0)
        with pytest.raises(ValueError, match="publish_time_ns = 9223372036854775808 ns"):
            writer.write("/t", String(), 0, 2**63)
        writer.write("/t", String(data="right"), 5, 4)
    with pytest.raises(ValueError, match="is closed"):
        writer.write("/t", String(), 0, 0)
    writer.close()
    bag = Bag(path)
    assert as_read(bag) == [("/t", String(data="right"), 5, 4)]
    assert bag.damage == ""


def test_many_threads_may_write(path: Path):
    def write(thread: int) -> None:
        for number in range(200):
            writer.write(f"/t{thread}", String(data=str(number)), number, thread)

    with BagWriter(path, chunk_bytes=1000, flush_s=0.001) as writer:
        for thread in range(4):
            writer.add_topic(f"/t{thread}", String, QOS)
        threads = [threading.Thread(target=write, args=(thread,)) for thread in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    bag = Bag(path)
    for thread in range(4):
        read = [item.message.data for item in bag.messages([f"/t{thread}"])]
        assert read == [str(number) for number in range(200)]
    assert bag.damage == ""


def test_a_last_message_is_written_out_without_a_next_one(path: Path):
    with BagWriter(path, flush_s=0.1) as writer:
        writer.add_topic("/t", String, QOS)
        writer.write("/t", String(data="lonely"), 5, 4)
        wait_for(lambda: Bag(path).topics, "the message on disk")
        bag = Bag(path)
        assert as_read(bag) == [("/t", String(data="lonely"), 5, 4)]
        assert "not closed" in bag.damage
    assert Bag(path).damage == ""


KILLED = """
import sys, time
from rclpy.qos import QoSProfile
from std_msgs.msg import String
from ema_bags.writer import BagWriter

writer = BagWriter(sys.argv[1])
writer.add_topic("/t", String, QoSProfile(depth=10))
number = 0
while True:
    writer.write("/t", String(data=str(number)), time.monotonic_ns())
    number += 1
    time.sleep(0.001)
"""


def test_killed_writer_leaves_what_it_wrote_out(path: Path):
    def messages() -> int:
        try:
            return len(list(Bag(path).messages()))
        except (OSError, ValueError):  # nothing is there yet
            return 0

    with started([sys.executable, "-c", KILLED, str(path)]) as process:
        # They are written out by time: a few hundred messages do not fill a chunk.
        before = wait_for(messages, "messages on disk")
    assert process.returncode == -signal.SIGKILL
    bag = Bag(path)
    read = list(bag.messages())
    assert [item.message.data for item in read] == [str(number) for number in range(len(read))]
    assert len(read) >= before
    assert bag.topics["/t"].count == len(read)
    assert "not closed" in bag.damage or "breaks off" in bag.damage
