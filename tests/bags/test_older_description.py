"""Recordings whose ActuatorDescription is from before acquisition and drive were in it."""

import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_bags.message_type import type_hash
from ema_bags.reader import Bag
from ema_bags.schema import schema_text, to_installed
from ema_bags.telemetry import DESCRIPTION_TYPE, read_telemetry
from ema_bags.writer import BagWriter
from ema_core.acquisition import Acquisition
from ema_core.description import ActuatorDescription
from ema_interfaces.msg import ActuatorDescription as DescriptionMessage
from ema_ros.messages import description_from_message
from ema_sim.bench import ActuatorBench

ADDED = ("current_sampling", "current_filter_time", "speed_measured", "drive")
DESCRIPTION = ActuatorDescription(actuator_id="old", serial_number="A-7", sample_period=1e-3)


def older_text() -> str:
    """The definition without the fields and constants that came with acquisition and drive."""
    text = schema_text(DESCRIPTION_TYPE)
    start, stop = text.index("# acquisition of"), text.index("# controller")
    return text[:start] + text[stop:]


@pytest.fixture
def old_bag(tmp_path: Path) -> Path:
    new, old = tmp_path / "new.mcap", tmp_path / "old.mcap"
    bench = ActuatorBench(DESCRIPTION)
    with SimulatedActuatorBag(BagWriter(new), DESCRIPTION) as bag:
        for number, (block, torque) in enumerate(bench.begin_cycle().blocks):
            bag.write_block(block, torque)
            if number == 3:
                break
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(older_text(), DESCRIPTION_TYPE))
    current = get_typestore(Stores.EMPTY)
    current.register(get_types_from_msg(schema_text(DESCRIPTION_TYPE), DESCRIPTION_TYPE))
    older_hash = store.hash_rihs01(DESCRIPTION_TYPE)
    assert older_hash != type_hash(DESCRIPTION_TYPE)
    with new.open("rb") as stream, old.open("wb") as sink:
        writer, channels = Writer(sink), {}
        writer.start("ros2")
        for kind, channel, message in make_reader(stream).iter_messages():
            assert kind is not None
            is_older = kind.name == DESCRIPTION_TYPE
            if channel.topic not in channels:
                text = older_text().encode() if is_older else kind.data
                number = writer.register_schema(kind.name, kind.encoding, text)
                metadata = dict(channel.metadata)
                if is_older:
                    metadata["topic_type_hash"] = older_hash
                channels[channel.topic] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, metadata
                )
            data = message.data
            if is_older:
                description = current.deserialize_cdr(data, DESCRIPTION_TYPE)
                kind_of_old: Any = store.types[DESCRIPTION_TYPE]
                # Constants are in capitals.
                names = [item.name for item in fields(kind_of_old) if not item.name.isupper()]
                assert not set(names) & set(ADDED)
                older = kind_of_old(**{name: getattr(description, name) for name in names})
                data = bytes(store.serialize_cdr(older, DESCRIPTION_TYPE))
            writer.add_message(
                channels[channel.topic], message.log_time, data, message.publish_time
            )
        writer.finish()
    return old


def test_older_description_is_read_with_the_defaults(old_bag: Path):
    recorded = read_telemetry(Bag(old_bag))
    assert recorded.descriptions == (DESCRIPTION,)
    assert recorded.descriptions[0].acquisition == Acquisition()


def test_older_message_becomes_one_of_the_installed_type(old_bag: Path):
    bag = Bag(old_bag)
    [topic] = bag.topics_of(DESCRIPTION_TYPE)
    upgrade = to_installed(*bag.topics[topic].identity)
    assert upgrade is not None
    [item] = bag.raw_messages([topic])
    message = deserialize_message(upgrade(item.message), DescriptionMessage)
    assert description_from_message(message) == DESCRIPTION
    assert message.speed_measured is True


def test_only_fields_with_a_default_may_be_missing():
    text = schema_text(DESCRIPTION_TYPE)
    other_hash = "RIHS01_" + "0" * 64
    without_default = re.sub(r"float64 gear_ratio.*\n", "", text)
    with pytest.raises(ValueError, match=r"is not the installed one.*float64 gear_ratio"):
        to_installed(DESCRIPTION_TYPE, without_default, other_hash)
    renamed = older_text().replace("float64 gear_ratio", "float64 ratio")
    with pytest.raises(ValueError, match=r"is not the installed one.*float64 ratio"):
        to_installed(DESCRIPTION_TYPE, renamed, other_hash)
