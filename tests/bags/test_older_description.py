"""Recordings whose ActuatorDescription is from before acquisition and drive were in it."""

import re
from pathlib import Path

import pytest
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message

from ema_bags import bag_file
from ema_bags.message_type import type_hash
from ema_bags.reader import Bag
from ema_bags.schema import decoder, schema_text, to_installed, typestore
from ema_bags.telemetry import DESCRIPTION_TYPE, read_telemetry
from ema_bags.writer import BagWriter
from ema_core.acquisition import Acquisition
from ema_core.description import ActuatorDescription
from ema_interfaces.msg import ActuatorDescription as DescriptionMessage
from ema_interfaces.msg import TelemetryBlock
from ema_ros.messages import description_from_message, description_to_message

QOS = QoSProfile(depth=10)
ADDED = {"current_sampling", "current_filter_time", "speed_measured", "drive"}
DESCRIPTION = ActuatorDescription(actuator_id="old", serial_number="A-7", sample_period=1e-3)


def older_text() -> str:
    """The definition without the fields and constants that came with acquisition and drive."""
    text = schema_text(DESCRIPTION_TYPE)
    start, stop = text.index("# acquisition of"), text.index("# controller")
    return text[:start] + text[stop:]


@pytest.fixture
def old_bag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A description of the older type, and a block of telemetry."""
    store = typestore(DESCRIPTION_TYPE, older_text())
    older_hash = store.hash_rihs01(DESCRIPTION_TYPE)
    assert older_hash != type_hash(DESCRIPTION_TYPE)
    data = serialize_message(description_to_message(DESCRIPTION))
    message = decoder(DESCRIPTION_TYPE, schema_text(DESCRIPTION_TYPE))(data)
    kind = store.types[DESCRIPTION_TYPE]
    # Constants are in capitals.
    names = {name for name in vars(kind)["__dataclass_fields__"] if not name.isupper()}
    assert not names & ADDED
    older = kind(**{name: getattr(message, name) for name in names})
    with BagWriter(tmp_path / "old.mcap") as bag:
        bag.add_topic("/telemetry", TelemetryBlock, QOS)
        monkeypatch.setattr(bag_file, "schema_text", lambda _: older_text())
        monkeypatch.setattr(bag_file, "type_hash", lambda _: older_hash)
        monkeypatch.setattr(bag_file, "trimmer", lambda _: bytes)
        bag.add_topic("/description", DescriptionMessage, QOS)
        bag.write_serialized("/description", bytes(store.serialize_cdr(older, DESCRIPTION_TYPE)), 0)
        bag.write("/telemetry", TelemetryBlock(actuator_id="old"), 0)
    return bag.path


def test_older_description_is_read_with_the_defaults(old_bag: Path):
    recorded = read_telemetry(Bag(old_bag))
    assert recorded.descriptions == (DESCRIPTION,)
    assert recorded.descriptions[0].acquisition == Acquisition()


def test_older_message_becomes_one_of_the_installed_type(old_bag: Path):
    bag = Bag(old_bag)
    upgrade = to_installed(*bag.topics["/description"].identity)
    assert upgrade is not None
    [item] = bag.raw_messages(["/description"])
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
