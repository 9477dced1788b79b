# SPDX-License-Identifier: Apache-2.0
"""Schemas, hashes and qualities of service are the same as in ROS 2; older schemas are read."""

import re
from pathlib import Path

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from visualization_msgs.msg import InteractiveMarkerUpdate

import ema_interfaces.msg
from ema_bags import bag_file
from ema_bags.message_type import definition, message_class, type_hash, type_name
from ema_bags.qos import offered_qos, offered_qos_profiles
from ema_bags.reader import Bag
from ema_bags.schema import decoder, schema_text, to_installed, typestore
from ema_bags.telemetry import DESCRIPTION_TYPE, read_telemetry
from ema_bags.writer import BagWriter
from ema_core.acquisition import Acquisition
from ema_core.description import ActuatorDescription
from ema_interfaces.msg import ActuatorDescription as DescriptionMessage
from ema_interfaces.msg import TelemetryBlock
from ema_ros.messages import description_from_message, description_to_message

OWN_TYPES = [
    item
    for item in vars(ema_interfaces.msg).values()
    if hasattr(item, "get_fields_and_field_types")
]
TYPES = [
    *OWN_TYPES,
    DiagnosticArray,
    Header,
    InteractiveMarkerUpdate,
    JointState,
    PoseWithCovarianceStamped,
    String,
]
TELEMETRY = "ema_interfaces/msg/TelemetryBlock"
SEPARATOR = "=" * 80


@pytest.mark.parametrize("kind", TYPES, ids=type_name)
def test_schema_is_the_text_that_is_hashed(kind: type):
    # rosbags computes the hash from the text, so that text and hash belong together.
    name = type_name(kind)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema_text(name), name))
    assert store.hash_rihs01(name) == type_hash(name)


def test_schema_joins_the_unchanged_definitions():
    assert schema_text("std_msgs/msg/Header") == (
        f"{definition('std_msgs/msg/Header')}\n{SEPARATOR}\nMSG: builtin_interfaces/Time\n"
        f"{definition('builtin_interfaces/msg/Time')}"
    )


def test_nested_types_occur_once_and_depth_first():
    titles = [
        line for line in schema_text("ema_interfaces/msg/Health").splitlines() if "MSG: " in line
    ]
    assert titles == [
        "MSG: builtin_interfaces/Time",
        "MSG: ema_interfaces/FaultHealth",
        "MSG: ema_interfaces/RemainingUsefulLife",
        "MSG: ema_interfaces/UnitEvent",
        "MSG: std_msgs/Header",
    ]


def test_installed_schema_matches_by_hash_and_by_fields():
    text = schema_text(TELEMETRY)
    to_installed(TELEMETRY, text, type_hash(TELEMETRY))
    to_installed(TELEMETRY, "", type_hash(TELEMETRY))
    to_installed(TELEMETRY, text, "")
    bare = "\n".join(line.partition("#")[0].rstrip() for line in text.splitlines())
    to_installed(TELEMETRY, bare.replace("MSG: std_msgs/", "MSG: std_msgs/msg/"), "")


@pytest.mark.parametrize("recorded_hash", ["", "RIHS01_" + "0" * 64])
@pytest.mark.parametrize(
    ("old", "new", "reported"),
    [
        ("float64 sample_period", "float32 sample_period", r"\[float32 sample_period\].*float64"),
        ("float64[] command", "float64[<=100] command", r"\[float64\[<=100\] command\]"),
        ("uint64 first_index", "# uint64 first_index", r"\[\] in .* \[uint64 first_index\]"),
        ("uint32 nanosec", "int32 nanosec", "builtin_interfaces/Time has .int32 nanosec."),
    ],
)
def test_different_fields_are_refused_by_name(
    old: str, new: str, reported: str, recorded_hash: str
):
    text = schema_text(TELEMETRY)
    assert old in text
    with pytest.raises(
        ValueError, match=f"recorded {TELEMETRY} differs from the installed version.*{reported}"
    ):
        to_installed(TELEMETRY, text.replace(old, new), recorded_hash)


def test_different_order_is_refused():
    lines = schema_text("ema_interfaces/msg/FaultVector").splitlines(keepends=True)
    friction = next(line for line in lines if line.startswith("float64 friction"))
    lines.append(lines.pop(lines.index(friction)))
    with pytest.raises(ValueError, match="the same fields in another order"):
        to_installed("ema_interfaces/msg/FaultVector", "".join(lines), "")


def test_different_hash_alone_is_refused():
    with pytest.raises(ValueError, match=r"recorded RIHS01_0+, installed RIHS01_[0-9a-f]+"):
        to_installed(TELEMETRY, schema_text(TELEMETRY), "RIHS01_" + "0" * 64)


@pytest.mark.parametrize("ask", [message_class, definition, type_hash, schema_text])
@pytest.mark.parametrize(
    "name",
    ["no_such_package/msg/Thing", "std_msgs/msg/NoSuchThing", "std_msgs/String", "", "a/b/c"],
)
def test_unknown_type_is_named(ask, name: str):
    with pytest.raises(ValueError, match=f"message type '?{name}"):
        ask(name)


def test_offered_qos_is_written_like_that_of_ros():
    qos = QoSProfile(
        depth=5,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
        deadline=Duration(nanoseconds=1_500_000_000),
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
    )
    infinite = {"sec": 9223372036, "nsec": 854775807}
    assert offered_qos(qos) == {
        "history": "keep_last",
        "depth": 5,
        "reliability": "best_effort",
        "durability": "transient_local",
        "deadline": {"sec": 1, "nsec": 500_000_000},
        "lifespan": infinite,
        "liveliness": "manual_by_topic",
        "liveliness_lease_duration": infinite,
        "avoid_ros_namespace_conventions": False,
    }
    assert yaml.safe_load(offered_qos_profiles(qos)) == [offered_qos(qos)]


def test_definition_that_contains_itself_is_refused():
    text = f"b/C x\n{'=' * 80}\nMSG: b/C\nb/C y\n"
    with pytest.raises(ValueError, match=r"definition of a/msg/B cannot be read: .*contains itse"):
        decoder("a/msg/B", text)


ADDED = {"current_sampling", "current_filter_time", "speed_measured", "has_command"}
ADDED |= {"effort_kind"}
ADDED |= {"drive", "current_bandwidth", "lead"}
DESCRIPTION = ActuatorDescription(actuator_id="old", serial_number="A-7", sample_period=1e-3)


def older_text() -> str:
    """Return the definition of version 0.1, without acquisition, drive and linear actuators."""
    definition_text, separator, contained = schema_text(DESCRIPTION_TYPE).partition("\n====")
    # Without comments, constants and added fields.
    fields = [line for line in definition_text.splitlines() if line and not line.startswith("#")]
    kept = [line for line in fields if line.split()[1] not in ADDED and "=" not in line]
    return "\n".join([*kept, ""]) + separator + contained


@pytest.fixture
def old_bag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a bag with a description of the older type and a block of telemetry."""
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
        bag.add_topic("/telemetry", TelemetryBlock, QoSProfile(depth=10))
        monkeypatch.setattr(bag_file, "schema_text", lambda _: older_text())
        monkeypatch.setattr(bag_file, "type_hash", lambda _: older_hash)
        monkeypatch.setattr(bag_file, "trimmer", lambda _: bytes)
        bag.add_topic("/description", DescriptionMessage, QoSProfile(depth=10))
        bag.write_serialized("/description", bytes(store.serialize_cdr(older, DESCRIPTION_TYPE)), 0)
        bag.write("/telemetry", TelemetryBlock(actuator_id="old"), 0)
    return bag.path


def test_older_description_is_read_with_defaults(old_bag: Path):
    recorded = read_telemetry(Bag(old_bag))
    assert recorded.descriptions == (DESCRIPTION,)
    assert recorded.descriptions[0].acquisition == Acquisition()


def test_older_message_is_converted_to_the_installed_type(old_bag: Path):
    bag = Bag(old_bag)
    upgrade = bag.topics["/description"].upgrade()
    assert upgrade is not None
    [item] = bag.raw_messages(["/description"])
    message = deserialize_message(upgrade(item.message), DescriptionMessage)
    assert description_from_message(message) == DESCRIPTION
    assert message.speed_measured is True
    assert message.has_command is True


def test_older_telemetry_has_no_payload():
    """Before the payload was added, the definition ended with the speed."""
    text = schema_text(TELEMETRY)
    definition_text, separator, contained = text.partition("\n====")
    older = definition_text.replace("float64[] payload\n", "") + separator + contained
    upgrade = to_installed(TELEMETRY, older, "RIHS01_" + "0" * 64)
    assert upgrade is not None
    store = typestore(TELEMETRY, older)
    block = TelemetryBlock(actuator_id="old", first_index=7, position=[1.0, 2.0])
    message = decoder(TELEMETRY, text)(serialize_message(block))
    names = [name for name in vars(type(message))["__dataclass_fields__"] if name != "payload"]
    recorded = store.types[TELEMETRY](**{name: getattr(message, name) for name in names})
    data = upgrade(bytes(store.serialize_cdr(recorded, TELEMETRY)))
    read = deserialize_message(data, TelemetryBlock)
    assert (read.actuator_id, read.first_index) == ("old", 7)
    assert (list(read.position), list(read.payload)) == ([1.0, 2.0], [])


def test_only_fields_with_a_default_may_be_missing():
    text = schema_text(DESCRIPTION_TYPE)
    other_hash = "RIHS01_" + "0" * 64
    without_default = re.sub(r"float64 gear_ratio.*\n", "", text)
    with pytest.raises(ValueError, match=r"differs from the installed version.*float64 gear_ratio"):
        to_installed(DESCRIPTION_TYPE, without_default, other_hash)
    renamed = older_text().replace("float64 gear_ratio", "float64 ratio")
    with pytest.raises(ValueError, match=r"differs from the installed version.*float64 ratio"):
        to_installed(DESCRIPTION_TYPE, renamed, other_hash)


def test_definition_with_windows_line_ends_is_read(tmp_path: Path):
    text = schema_text("sensor_msgs/msg/JointState").replace("\n", "\r\n")
    message = JointState(name=["a"], position=[0.5], velocity=[0.25])
    decoded = decoder("sensor_msgs/msg/JointState", text)(serialize_message(message))
    assert (decoded.name, decoded.position.tolist()) == (["a"], [0.5])
    same = schema_text(DESCRIPTION_TYPE).replace("\n", "\r\n")
    assert to_installed(DESCRIPTION_TYPE, same, type_hash(DESCRIPTION_TYPE)) is None
