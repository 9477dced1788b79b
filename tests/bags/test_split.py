"""A recording in several files: each can be used alone, and together they are one."""

import inspect
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader

import ema_interfaces.msg
from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_bags.message_type import type_name
from ema_bags.reader import Bag
from ema_bags.schema import trimmer
from ema_bags.windows import read_windows
from ema_bags.writer import BagWriter
from ema_core.commands import THESIS_CHIRP, build_cycle
from ema_core.description import ActuatorDescription
from ema_interfaces.msg import ActuatorDescription as DescriptionMessage
from ema_interfaces.msg import TelemetryBlock, Usage
from ema_sim.actuator import SimulatedActuator

QOS = QoSProfile(depth=10)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STEP_NS = 10_000_000
N = 100
KINDS = [kind for _, kind in inspect.getmembers(ema_interfaces.msg, inspect.isclass)]


def record(path: Path, **settings) -> BagWriter:
    """Write numbered telemetry of a second, with descriptions and usage of two actuators."""
    with ExitStack() as stack:
        # Chunks end by size alone, whatever the time that this takes.
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
def test_each_file_begins_with_how_things_stand(tmp_path: Path, settings: dict):
    folder = tmp_path / "flight"
    record(folder, **settings).close()
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
            # A chunk and the index are beyond it.
            assert 30_000 <= path.stat().st_size < 45_000
        seen += len(blocks)
    assert seen == N


def test_files_together_are_one_recording(tmp_path: Path):
    folder = tmp_path / "flight"
    record(folder, max_duration_s=0.25).close()
    bag = Bag(folder)
    assert bag.damage == ""
    assert bag.topics["/ema/telemetry"].count == N
    found = information(folder)
    names = [f"flight_{number}.mcap" for number in range(4)]
    assert found["relative_file_paths"] == names
    assert [item["path"] for item in found["files"]] == names
    assert [item["starting_time"]["nanoseconds_since_epoch"] for item in found["files"]] == [
        25 * number * STEP_NS for number in range(4)
    ]
    assert found["duration"]["nanoseconds"] == (N - 1) * STEP_NS
    total = sum(item["message_count"] for item in found["files"])
    assert total == found["message_count"] == sum(topic.count for topic in bag.topics.values())
    with AnyReader([folder]) as reader:
        assert reader.message_count == total
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)


def test_metadata_list_what_is_closed_and_the_rest_is_found(tmp_path: Path):
    folder = tmp_path / "flight"
    with record(folder, max_duration_s=0.25) as writer:
        writer.flush()
        assert len(information(folder)["files"]) == 3
        (folder / "other.mcap").write_bytes(b"not of this recording")
        bag = Bag(folder)
        assert bag.topics["/ema/telemetry"].count == N
        assert "flight_3.mcap is not in metadata.yaml: not closed" in bag.damage
        assert "other" not in bag.damage


def test_one_file_cannot_be_split(tmp_path: Path):
    with pytest.raises(ValueError, match=r"flight.mcap is one file: expected a folder"):
        BagWriter(tmp_path / "flight.mcap", max_bytes=1_000_000)
    assert not any(tmp_path.iterdir())


@pytest.mark.slow
def test_windows_are_the_same_in_one_file_in_several_and_in_each(tmp_path: Path):
    samples = build_cycle(THESIS_CHIRP, 1e-4).samples
    cycle_s = len(samples) * 1e-4

    def simulate(writer: BagWriter) -> None:
        actuator = SimulatedActuator()
        with SimulatedActuatorBag(writer, ActuatorDescription()) as bag:
            for cycle in range(2):
                bag.begin_cycle(cycle, actuator.faults, 10.0 * cycle)
                for part in np.split(samples, range(100, len(samples), 100)):
                    bag.write_block(actuator.advance(part), 0.0)

    simulate(BagWriter(tmp_path / "one.mcap"))
    simulate(BagWriter(tmp_path / "several", max_duration_s=cycle_s))
    whole = read_windows(Bag(tmp_path / "one.mcap").path)
    split = read_windows(tmp_path / "several")
    assert len(whole.usable) == 2
    for one, other in zip(whole.usable, split.usable, strict=True):
        assert (one.start_ns, one.end_ns) == (other.start_ns, other.end_ns)
        assert np.array_equal(one.telemetry.current, other.telemetry.current)
    files = sorted((tmp_path / "several").glob("*.mcap"))
    alone = [window for path in files for window in read_windows(path).usable]
    assert [window.start_ns for window in alone] == [window.start_ns for window in whole.usable]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_messages_end_where_their_content_ends(tmp_path: Path, kind: type):
    # Their sequences are empty, behind which ROS leaves reserved bytes.
    path = tmp_path / "flight.mcap"
    with BagWriter(path) as writer:
        writer.add_topic("/t", kind, QOS)
        writer.write("/t", kind(), 0)
    with AnyReader([path]) as reader:
        ((connection, _, data),) = reader.messages()
        message = reader.deserialize(data, connection.msgtype)
        again = reader.typestore.serialize_cdr(message, connection.msgtype)
        assert len(again) == len(data)  # paddings within are not initialised
    with path.open("rb") as file:
        (decoded,) = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
    assert type(decoded.decoded_message).__name__ == kind.__name__


def test_ros_leaves_bytes_behind_a_message_and_they_are_cut_off():
    data = serialize_message(TelemetryBlock(actuator_id="flap"))
    trim = trimmer(type_name(TelemetryBlock))
    assert len(data) > len(trim(data))
    assert trim(trim(data)) == trim(data) == data[: len(trim(data))]
    assert trim(b"no message") == b"no message"
