"""Schemas, hashes and offered qualities of service are those that ROS 2 itself would note."""

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
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from visualization_msgs.msg import InteractiveMarkerUpdate

import ema_interfaces.msg
from ema_bags.message_type import definition, message_class, type_hash, type_name
from ema_bags.qos import offered_qos, offered_qos_profiles
from ema_bags.schema import decoder, schema_text, to_installed

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
def test_schema_says_what_is_hashed(kind: type):
    # rosbags computes the hash from the text, so text and hash belong together.
    name = type_name(kind)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema_text(name), name))
    assert store.hash_rihs01(name) == type_hash(name)


def test_schema_joins_the_definitions_as_they_are():
    assert schema_text("std_msgs/msg/Header") == (
        f"{definition('std_msgs/msg/Header')}\n{SEPARATOR}\nMSG: builtin_interfaces/Time\n"
        f"{definition('builtin_interfaces/msg/Time')}"
    )


def test_contained_types_come_once_and_depth_first():
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


def test_installed_schema_passes_by_hash_and_by_fields():
    text = schema_text(TELEMETRY)
    to_installed(TELEMETRY, text, type_hash(TELEMETRY))
    to_installed(TELEMETRY, "", type_hash(TELEMETRY))
    to_installed(TELEMETRY, text, "")
    bare = "\n".join(line.partition("#")[0].rstrip() for line in text.splitlines())
    to_installed(TELEMETRY, bare.replace("MSG: std_msgs/", "MSG: std_msgs/msg/"), "")


@pytest.mark.parametrize("recorded_hash", ["", "RIHS01_" + "0" * 64])
@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("float64 sample_period", "float32 sample_period", r"\[float32 sample_period\].*float64"),
        ("float64[] command ", "float64[<=100] command ", r"\[float64\[<=100\] command\]"),
        ("uint64 first_index", "# uint64 first_index", r"\[\] in .* \[uint64 first_index\]"),
        ("uint32 nanosec", "int32 nanosec", "builtin_interfaces/Time has .int32 nanosec."),
    ],
)
def test_other_fields_are_refused_by_name(old: str, new: str, told: str, recorded_hash: str):
    text = schema_text(TELEMETRY)
    assert old in text
    with pytest.raises(ValueError, match=f"recorded {TELEMETRY} is not the installed one.*{told}"):
        to_installed(TELEMETRY, text.replace(old, new), recorded_hash)


def test_other_order_is_refused():
    lines = schema_text("ema_interfaces/msg/FaultVector").splitlines(keepends=True)
    friction = next(line for line in lines if line.startswith("float64 friction"))
    lines.append(lines.pop(lines.index(friction)))
    with pytest.raises(ValueError, match="the same fields in another order"):
        to_installed("ema_interfaces/msg/FaultVector", "".join(lines), "")


def test_other_hash_alone_is_refused():
    with pytest.raises(ValueError, match=r"RIHS01_0+ there, RIHS01_[0-9a-f]+ here"):
        to_installed(TELEMETRY, schema_text(TELEMETRY), "RIHS01_" + "0" * 64)


@pytest.mark.parametrize("ask", [message_class, definition, type_hash, schema_text])
@pytest.mark.parametrize(
    "name",
    ["no_such_package/msg/Thing", "std_msgs/msg/NoSuchThing", "std_msgs/String", "", "a/b/c"],
)
def test_unknown_type_is_named(ask, name: str):
    with pytest.raises(ValueError, match=f"message type '?{name}"):
        ask(name)


def test_offered_qos_in_words():
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
