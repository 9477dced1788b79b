"""What is latched at a time of a bag is found without reading the bag again and again."""

from pathlib import Path

import pytest
from rclpy.serialization import deserialize_message

from ema_interfaces.msg import Health, TelemetryBlock
from ema_recording import reader
from ema_recording.latched import LatchedIndex
from ema_recording.reader import Bag
from ema_recording.writer import BagWriter
from ema_ros import topics

SECOND_NS = 1_000_000_000
LAST_S = 100
TOPIC = "/ema/health"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Telemetry ten times a second, health of two actuators every ten, each at a second apart."""
    path = tmp_path / "long.mcap"
    with BagWriter(path, chunk_bytes=4096) as writer:
        writer.add_topic("/ema/telemetry", TelemetryBlock, topics.STREAM)
        writer.add_topic(TOPIC, Health, topics.LATCHED)
        for number in range(10 * LAST_S):
            at_ns = SECOND_NS + number * SECOND_NS // 10
            # Not to be compressed away: a block fills a chunk.
            block = TelemetryBlock(first_index=number, position=[0.1 * n for n in range(600)])
            writer.write("/ema/telemetry", block, at_ns)
            if number % 100 in (0, 10):
                name = "right" if number % 100 else "left"
                writer.write(TOPIC, Health(actuator_id=name, cycles=number), at_ns)
    return path


def found(index: LatchedIndex, seconds: float) -> list[tuple[str, int]]:
    """Return actuator and number of what is latched so long after the beginning."""
    items = index.before(SECOND_NS + round(seconds * SECOND_NS))
    messages = [deserialize_message(item.message, Health) for item in items]
    return [(message.actuator_id, message.cycles) for message in messages]


def test_the_latest_of_each_actuator_is_latched_wherever_it_is_looked_for(path):
    index = LatchedIndex(Bag(path), [TOPIC])
    for seconds, expected in (
        (50.05, [("right", 410), ("left", 500)]),
        (0.0, []),
        (0.5, [("left", 0)]),
        (95.0, [("left", 900), ("right", 910)]),
        (40.0, [("left", 300), ("right", 310)]),
        (40.05, [("right", 310), ("left", 400)]),
    ):
        assert found(index, seconds) == expected


def test_a_bag_is_read_once_and_only_where_something_latched_is(path, monkeypatch):
    reads = []
    read = reader.read_messages

    def counted(*arguments):
        reads.append(arguments)
        return read(*arguments)

    monkeypatch.setattr(reader, "read_messages", counted)
    bag = Bag(path)
    chunks = sum(len(contents.stretches) for contents in bag._files.values())
    index = LatchedIndex(bag, [TOPIC])
    found(index, 99.0)
    # The 20 chunks with a health, and the two with the latest of each actuator once more.
    assert len(reads) <= 22 < chunks / 10
    reads.clear()
    for seconds in (20.0, 80.0, 99.0):
        found(index, seconds)
    assert len(reads) == 6


def test_without_latched_topics_nothing_is_read(path):
    assert LatchedIndex(Bag(path), []).before(10 * SECOND_NS) == []
