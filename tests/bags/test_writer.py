# SPDX-License-Identifier: Apache-2.0
"""Recordings are readable by other readers of rosbag2 files, even if the writer is killed."""

import array
import inspect
import signal
import sys
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2
from std_msgs.msg import Header, String

import ema_interfaces.msg
from ema_bags.message_type import type_hash, type_name
from ema_bags.qos import offered_qos
from ema_bags.reader import Bag
from ema_bags.schema import schema_text, trimmer
from ema_bags.writer import BagWriter
from ema_interfaces.msg import ActuatorDescription as DescriptionMessage
from ema_interfaces.msg import FaultHealth, Health, TelemetryBlock, Usage

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
    """Record blocks and occasional health messages; return the written messages."""
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
def test_package_reader_reads_all_written_messages(path: Path, chunk_bytes: int):
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


def test_rosbags_reads_all_written_messages(path: Path):
    written = record(path)
    with AnyReader([path]) as reader:
        for connection in reader.connections:
            assert isinstance(connection.ext, ConnectionExtRosbag2)
            (qos,) = connection.ext.offered_qos_profiles
            assert qos.depth == (1 if connection.topic == "/ema/health" else 10)
        read: list[tuple[str, Any, int]] = [
            (connection.topic, reader.deserialize(data, connection.msgtype), log_time_ns)
            for connection, log_time_ns, data in reader.messages()
        ]
    assert [(topic, at_ns) for topic, _, at_ns in read] == [
        (topic, at_ns) for topic, _, at_ns, _ in written
    ]
    for (_, decoded, _), (_, message, *_) in zip(read, written, strict=True):
        if isinstance(message, TelemetryBlock):
            assert decoded.first_index == message.first_index > 2**53
            assert decoded.header.stamp.sec == message.header.stamp.sec
            np.testing.assert_array_equal(decoded.current, message.current)
            np.testing.assert_array_equal(decoded.speed, message.speed)
        else:
            assert [fault.name for fault in decoded.faults] == ["backlash", "gain"]
            assert decoded.faults[0].rul.hours_50 == message.faults[0].rul.hours_50


def test_records_are_those_of_rosbag2(path: Path):
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


def test_metadata_file_equals_that_of_rosbag2(tmp_path: Path):
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


def test_recording_without_messages_is_complete(path: Path):
    with BagWriter(path) as writer:
        writer.add_topic("/ema/telemetry", TelemetryBlock, QOS)
    bag = Bag(path)
    assert (bag.damage, bag.start_ns, bag.end_ns) == ("", None, None)
    assert bag.topics["/ema/telemetry"].count == 0
    assert list(bag.messages()) == []
    with AnyReader([path]) as reader:
        assert reader.message_count == 0


def test_recording_is_replaced_only_on_request(path: Path):
    written = record(path, blocks=3)
    with pytest.raises(FileExistsError, match="already exists"):
        BagWriter(path)
    assert as_read(Bag(path)) == written
    written = record(path, blocks=5, overwrite=True)
    assert as_read(Bag(path)) == written


def test_only_recordings_are_replaced(tmp_path: Path):
    folder = tmp_path / "flight"
    record(folder, blocks=3)
    (folder / "notes.txt").write_text("mine")
    (tmp_path / "folder.mcap").mkdir()
    (tmp_path / "file").write_text("mine")
    for target in (folder, tmp_path / "folder.mcap", tmp_path / "file"):
        with pytest.raises(FileExistsError, match="contains more than a recording"):
            BagWriter(target, overwrite=True)
    assert (folder / "notes.txt").read_text() == "mine"
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("flush_s", [0.0, float("nan")])
def test_impossible_settings_are_refused(tmp_path: Path, flush_s: float):
    with pytest.raises(ValueError, match=f"flush_s = {flush_s} s: expected a positive number"):
        BagWriter(tmp_path / "flight", flush_s=flush_s)
    assert list(tmp_path.iterdir()) == []


def test_wrong_use_is_refused_and_leaves_the_recording_intact(path: Path):
    with BagWriter(path) as writer:
        writer.add_topic("/t", String, QOS)
        with pytest.raises(ValueError, match="topic /t was added before"):
            writer.add_topic("/t", String, QOS)
        with pytest.raises(ValueError, match=r"topic '/u' was not added .*; added: /t"):
            writer.write("/u", String(), 0, 0)
        with pytest.raises(ValueError, match="topic /t has type std_msgs/msg/String, not Header"):
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


def test_several_threads_may_write(path: Path):
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


def test_last_message_is_written_to_disk_without_a_next_one(path: Path):
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


def test_killed_writer_keeps_what_it_wrote_to_disk(path: Path):
    def messages() -> int:
        try:
            return len(list(Bag(path).messages()))
        except (OSError, ValueError):  # no file so far
            return 0

    with started([sys.executable, "-c", KILLED, str(path)]) as process:
        # Writing is triggered by time: a few hundred messages do not fill a chunk.
        before = wait_for(messages, "messages on disk")
    assert process.returncode == -signal.SIGKILL
    bag = Bag(path)
    read = list(bag.messages())
    assert [item.message.data for item in read] == [str(number) for number in range(len(read))]
    assert len(read) >= before
    assert bag.topics["/t"].count == len(read)
    assert "not closed" in bag.damage or "damaged at byte" in bag.damage


N = 100
KINDS = [kind for _, kind in inspect.getmembers(ema_interfaces.msg, inspect.isclass)]


def record_numbered(path: Path, **settings) -> BagWriter:
    """Write numbered telemetry of one second, with descriptions and usage of two actuators."""
    with ExitStack() as stack:
        # Chunks end only by size, so that the result does not depend on timing.
        settings = {"chunk_bytes": 2000, "flush_s": 1000.0} | settings
        writer = stack.enter_context(BagWriter(path, **settings))
        fill(writer)
        stack.pop_all()
    return writer


def fill(writer: BagWriter) -> None:
    writer.add_topic("/ema/actuator_description", DescriptionMessage, LATCHED)
    writer.add_topic("/ema/usage", Usage, QOS)
    writer.add_topic("/ema/telemetry", TelemetryBlock, QOS)
    for name in ("left", "right"):
        writer.write("/ema/actuator_description", DescriptionMessage(actuator_id=name), 0, 0)
        writer.write("/ema/usage", Usage(actuator_id=name, flight_hours=1.0), 0, 0)
    for number in range(N):
        values = np.random.default_rng(number).normal(size=100)
        block = TelemetryBlock(actuator_id="left", first_index=100 * number)
        block.position.frombytes(values.tobytes())
        writer.write("/ema/telemetry", block, number * STEP_NS)
        if number == N // 2:
            writer.write(
                "/ema/usage", Usage(actuator_id="left", flight_hours=2.0), number * STEP_NS
            )


def information(folder: Path) -> dict:
    text = (folder / "metadata.yaml").read_text()
    return yaml.safe_load(text)["rosbag2_bagfile_information"]


@pytest.mark.parametrize("settings", [{"max_bytes": 30_000}, {"max_duration_s": 0.25}])
def test_each_file_begins_with_the_latest_latched_messages(tmp_path: Path, settings: dict):
    folder = tmp_path / "flight"
    record_numbered(folder, **settings).close()
    files = sorted(folder.glob("*.mcap"))
    assert [path.name for path in files] == [f"flight_{n}.mcap" for n in range(len(files))]
    assert len(files) == 4 if "max_duration_s" in settings else len(files) > 1
    seen = 0
    for number, path in enumerate(files):
        bag = Bag(path)
        assert bag.damage == ""
        items = list(bag.messages())
        head = items[:4]
        hours = 1.0 if seen <= N // 2 else 2.0
        assert {
            (item.topic, item.message.actuator_id, getattr(item.message, "flight_hours", 0.0))
            for item in head
        } == {
            ("/ema/actuator_description", "left", 0.0),
            ("/ema/actuator_description", "right", 0.0),
            ("/ema/usage", "left", hours),
            ("/ema/usage", "right", 1.0),
        }
        assert {item.publish_time_ns for item in head if item.message.actuator_id == "right"} == {0}
        blocks = [item for item in items if item.topic == "/ema/telemetry"]
        assert {item.log_time_ns for item in head} == {blocks[0].log_time_ns}
        assert [item.message.first_index // 100 for item in blocks] == list(
            range(seen, seen + len(blocks))
        )
        if number < len(files) - 1 and "max_bytes" in settings:
            # A chunk, the message definitions and the index come in addition.
            assert 30_000 <= path.stat().st_size < 46_000
        seen += len(blocks)
    assert seen == N


def test_files_of_a_split_recording_form_one_recording(tmp_path: Path):
    folder = tmp_path / "flight"
    record_numbered(folder, max_duration_s=0.25).close()
    bag = Bag(folder)
    assert bag.damage == ""
    assert bag.topics["/ema/telemetry"].count == N
    metadata = information(folder)
    names = [f"flight_{number}.mcap" for number in range(4)]
    assert metadata["relative_file_paths"] == names
    assert [item["path"] for item in metadata["files"]] == names
    assert [item["starting_time"]["nanoseconds_since_epoch"] for item in metadata["files"]] == [
        25 * number * STEP_NS for number in range(4)
    ]
    assert metadata["duration"]["nanoseconds"] == (N - 1) * STEP_NS
    total = sum(item["message_count"] for item in metadata["files"])
    assert total == metadata["message_count"] == sum(topic.count for topic in bag.topics.values())
    with AnyReader([folder]) as reader:
        assert reader.message_count == total
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)


def test_metadata_list_closed_files_and_the_reader_detects_the_rest(tmp_path: Path):
    folder = tmp_path / "flight"
    with record_numbered(folder, max_duration_s=0.25) as writer:
        writer.flush()
        assert len(information(folder)["files"]) == 3
        (folder / "other.mcap").write_bytes(b"not of this recording")
        bag = Bag(folder)
        assert bag.topics["/ema/telemetry"].count == N
        assert "flight_3.mcap is not in metadata.yaml: not closed" in bag.damage
        assert "other" not in bag.damage


def test_recording_in_a_single_file_cannot_be_split(tmp_path: Path):
    with pytest.raises(ValueError, match=r"flight.mcap is a single file: expected a folder"):
        BagWriter(tmp_path / "flight.mcap", max_bytes=1_000_000)
    assert not any(tmp_path.iterdir())


def test_messages_end_where_their_content_ends(tmp_path: Path):
    # Their sequences are empty, after which ROS leaves reserved bytes.
    path = tmp_path / "flight.mcap"
    with BagWriter(path) as writer:
        for kind in KINDS:
            writer.add_topic(f"/{kind.__name__}", kind, QOS)
            writer.write(f"/{kind.__name__}", kind(), 0)
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            again = reader.typestore.serialize_cdr(message, connection.msgtype)
            # Padding within messages is not initialised.
            assert len(again) == len(data), connection.msgtype
    with path.open("rb") as file:
        decoded = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        names = {type(item.decoded_message).__name__ for item in decoded}
    assert names == {kind.__name__ for kind in KINDS}


def test_bytes_that_ros_leaves_after_a_message_are_cut_off():
    data = serialize_message(TelemetryBlock(actuator_id="flap"))
    trim = trimmer(type_name(TelemetryBlock))
    assert len(data) > len(trim(data))
    assert trim(trim(data)) == trim(data) == data[: len(trim(data))]
    assert trim(b"no message") == b"no message"
