"""Valid inputs of each kind, with which fuzzing begins."""

import json
import zlib
from collections.abc import Mapping
from functools import cache
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import yaml
from made_tests import FIRST_NS, UNIT, entry_at
from mcap_form import FEATURES, Channel, Content, Message, Schema, mcap_file
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from ema_core.description import ActuatorDescription
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import UnusedCycle
from ema_recording.message_type import type_hash
from ema_recording.schema import schema_text, typestore
from ema_ros.messages import PARAMETER_FIELDS

ROOT: Final = Path(__file__).parents[1]
TYPES: Final = (
    "ema_interfaces/msg/TelemetryBlock",
    "ema_interfaces/msg/ActuatorDescription",
    "ema_interfaces/msg/FaultVectorStamped",
    "ema_interfaces/msg/MeasuredCauses",
    "ema_interfaces/msg/Usage",
    "ema_interfaces/msg/FaultEstimate",
    "ema_interfaces/msg/Health",
    "ema_interfaces/msg/UnitHistory",
    "sensor_msgs/msg/JointState",
)
"""Types of messages that others send."""

_BASIC: Final = {"string": "flap", "bool": True, "float32": 0.5, "float64": 0.5}


@cache
def store_of(name: str) -> Typestore:
    """Return a store of an installed type."""
    return typestore(name, schema_text(name))


def message_of(store: Typestore, name: str, given: Mapping[str, Any] | None = None) -> Any:
    """Return a message of a type, its sequences with an element each, some fields as given."""
    values = {field: _value(store, *kind) for field, kind in store.get_msgdef(name).fields}
    return store.types[name](**{**values, **(given or {})})


def _value(store: Typestore, kind: Any, what: Any) -> Any:
    if kind == Nodetype.BASE:
        return _BASIC.get(what[0], 1)
    if kind == Nodetype.NAME:
        return message_of(store, what)
    inner, length = what
    one = _value(store, *inner)
    count = length if kind == Nodetype.ARRAY else 1
    is_number = inner[0] == Nodetype.BASE and inner[1][0] != "string"
    return np.full(count, one, dtype=inner[1][0]) if is_number else [one] * count


def cdr_of(name: str, given: Mapping[str, Any] | None = None) -> bytes:
    """Return a message of an installed type in CDR."""
    store = store_of(name)
    return bytes(store.serialize_cdr(message_of(store, name, given), name))


def messages() -> list[bytes]:
    """Return a message of each type, its number in front."""
    described = {
        field: getattr(ActuatorDescription().parameters, name)
        for name, field in PARAMETER_FIELDS.items()
    }
    columns = {name: np.arange(5.0) for name in ("command", "current", "position", "speed")}
    given = {
        TYPES[0]: {"sample_period": 1e-4, **columns},
        TYPES[1]: {"serial_number": UNIT[1], "sample_period": 1e-4, "drive": 0, **described},
    }
    seeds = [bytes([n]) + cdr_of(name, given.get(name)) for n, name in enumerate(TYPES)]
    return seeds


def bags() -> list[bytes]:
    """Return recordings: of an actuator, and small ones with each feature."""
    told = messages()
    schemas = [
        Schema(n + 1, name, "ros2msg", schema_text(name).encode()) for n, name in enumerate(TYPES)
    ]
    channels = [
        Channel(n, n + 1, f"/topic_{n}", "cdr", {"topic_type_hash": type_hash(name)})
        for n, name in enumerate(TYPES)
    ]
    items = [
        Message(n, k, FIRST_NS + k, FIRST_NS + k, told[n][1:])
        for k in range(2)
        for n in range(len(TYPES))
    ]
    whole = frozenset(FEATURES) - {"pad"}
    few = Content(schemas[:2], channels[:2], [item for item in items if item.channel_id < 2])
    small = Content(
        [Schema(1, "a/msg/B", "ros2msg", b"uint8[] x\nstring name\n")],
        [Channel(1, 1, "/b", "cdr", {}), Channel(2, 0, "/c", "json", {})],
        [Message(1 + n % 2, n, 5 - n, n, bytes([0, 1, 0, 0, n, 0, 0, 0])) for n in range(4)],
    )
    return [
        mcap_file(few, whole, "zstd", 2),
        mcap_file(few, frozenset({"ch"}), "lz4"),
        mcap_file(Content(schemas, channels, items), whole, "zstd"),
        *(mcap_file(small, features) for features in (whole, frozenset(FEATURES), frozenset())),
        *(mcap_file(small, whole, packing, 1) for packing in ("zstd", "lz4")),
    ]


def descriptions() -> list[bytes]:
    """Return files of descriptions."""
    unit = ActuatorDescription()
    whole = {
        **{name: getattr(unit, name) for name in ("actuator_id", "serial_number", "model")},
        "sample_period": 1e-4,
        "drive": "six_step",
        "acquisition": {"current": "mean", "current_filter": 0.0, "speed": True},
        "parameters": unit.parameters.as_mapping(),
    }
    return [yaml.safe_dump(whole).encode(), b"actuator_id: flap\nparameters: {R_s: 1e0, P: 3}\n"]


def calibrations() -> list[bytes]:
    """Return files of calibrations, without the samples of their commands."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "calibration.yaml"
        Calibration.builtin().of_any_motion().save(path)
        return [path.read_bytes()]


def mappings() -> list[bytes]:
    """Return the files of mappings that are shipped, without their comments, and one of a table."""
    shipped = [yaml.safe_load(p.read_text()) for p in (ROOT / "ema_inputs/mappings").glob("*.yaml")]
    return [yaml.safe_dump(item).encode() for item in shipped]


def settings() -> list[bytes]:
    """Return parameters as files give them."""
    return [
        b"friction: 0.5\nbacklash: 1e-1\nsafe_duration_h: 10\nduty: 2\nhours_per_cycle: 10\n",
        b"friction: exponential 0.003 0.05\nsamples: 100\nalgorithm: least_squares\nseed: 3\n",
    ]


def histories() -> list[bytes]:
    """Return files of histories: of few tests, and without any."""
    found = []
    with TemporaryDirectory() as folder:
        for tests in (0, 3):
            path = Path(folder) / f"{tests}.sqlite"
            history = History(*UNIT, path)
            history.append(UnusedCycle(FIRST_NS - 1))
            for number in range(tests):
                history.append(entry_at(number))
            history.close()
            found.append(path.read_bytes())
    return found


def lines() -> list[bytes]:
    """Return a history of an earlier version."""
    shown = ROOT / "tests/prognosis/histories_0_1"
    own = {"format": "ema_history 2", "actuator_id": UNIT[0], "serial_number": UNIT[1]}
    made = b"".join(with_checksum(one) for one in (own, {"without_estimate_ns": 5}))
    return [made, *(path.read_bytes() for path in sorted(shown.glob("*.jsonl")))]


def with_checksum(record: Mapping[str, Any]) -> bytes:
    """Return a line of such a history."""
    body = json.dumps(record)[:-1].encode()
    return body + b', "crc32": "' + f"{zlib.crc32(body):08x}".encode() + b'"}\n'


def tables() -> list[bytes]:
    """Return tables in text."""
    rows = [(0.01 * n, 0.1 * n, 0.1 * n - 0.01, n % 3) for n in range(12)]
    names = ("time [s]", "command", "position", "current [A]")
    found = []
    for separator, decimal in ((",", "."), (";", ","), ("\t", "."), (" ", ".")):
        text = separator.join(name.replace(" ", "_") for name in names) + "\n"
        for row in rows:
            text += separator.join(f"{x:.3f}".replace(".", decimal) for x in row) + "\n"
        found.append(text.encode())
    dated = "".join(f"2024-01-01T00:00:{n:02d}.5Z,{n},{n}\n" for n in range(9))
    return [*found, b"time,command,position\n" + dated.encode(), found[0].decode().encode("utf-16")]


def metadata() -> list[bytes]:
    """Return what a folder says of its recording."""
    return [
        b"rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n"
        b"  duration: {nanoseconds: 5}\n  starting_time: {nanoseconds_since_epoch: 0}\n"
        b"  message_count: 4\n  compression_format: ''\n  compression_mode: ''\n"
        b"  relative_file_paths: [input_0.mcap]\n  files: []\n"
    ]


def schemas() -> list[bytes]:
    """Return definitions of messages."""
    texts = [schema_text(name).encode() for name in (TYPES[0], TYPES[4])]
    return [*texts, b"uint8[<=3] x\nstring<=5 name 'a'\nfloat64[2] y\nint32 A=3\nb/C c\n"]


def growth() -> list[bytes]:
    """Return archives such as are kept of a tracker, but small."""
    stream = BytesIO()
    np.savez(stream, bank=np.zeros((3, 2)), used_ns=np.zeros(1), used_hours=np.zeros(1))
    return [stream.getvalue()]
