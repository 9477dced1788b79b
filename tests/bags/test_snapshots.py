"""A recording of the seconds before something happened."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from ema_bags.bag_recorder import BagRecorder, RecorderSettings
from ema_bags.metadata import METADATA_FILE
from ema_bags.reader import Bag
from ema_core.levels import ERROR, OK, WARN
from ema_interfaces.msg import (
    ActuatorDescription,
    FaultEstimate,
    Health,
    HealthSummary,
    TelemetryBlock,
)
from ema_ros.topics import LATCHED, STREAM

S = 10**9
LATCHING = (ActuatorDescription, Health)


@pytest.fixture
def record(tmp_path: Path) -> Iterator[Callable[..., BagRecorder]]:
    """Begin a recording of a topic of each type, with these settings."""
    with ExitStack() as opened:

        def begin(*kinds: type, **given: Any) -> BagRecorder:
            settings = RecorderSettings(output="flight", **{"snapshot_duration": 1.0, **given})
            path = str(tmp_path / "flight")
            recording = BagRecorder(path, settings, "/ema/recorder", lambda *_: None)
            opened.callback(recording.bag.close)
            for kind in kinds:
                qos = LATCHED if kind in LATCHING else STREAM
                recording.bag.add_topic(f"/{kind.__name__}", kind, qos)
            return recording

        yield begin


def received(recording: BagRecorder, message: Any, time_ns: int = 0) -> str:
    """Receive a message, and return why there should be a snapshot."""
    data = serialize_message(message)
    return recording.receive(f"/{type(message).__name__}", data, time_ns, None)


def health(level: int, actuator: str = "flap") -> Health:
    return Health(actuator_id=actuator, level=level)


def test_first_level_is_no_change_and_own_statuses_do_not_count(record):
    recording = record(Health, HealthSummary, String, DiagnosticArray)
    for message, said in (
        (health(OK), ""),
        (health(OK), ""),
        (health(WARN, "left"), ""),
        (health(WARN), "health of flap from OK to WARN"),
        (HealthSummary(actuator_id="flap", level=WARN), ""),
        (HealthSummary(actuator_id="flap", level=ERROR), "health of flap from WARN to ERROR"),
        (String(data="no level"), ""),
    ):
        assert received(recording, message) == said
    names = ("/ema/monitor: flap health", "/ema/recorder: recording", "/ema/recorder_2: peers")
    for level, said in (
        (b"\0", ""),
        (b"\1", f"{names[0]} from OK to WARN, {names[2]} from OK to WARN"),
    ):
        status = [DiagnosticStatus(name=name, level=level) for name in names]
        assert received(recording, DiagnosticArray(status=status)) == said


def test_snapshot_begins_with_what_held_before_it(record, tmp_path: Path):
    recording = record(ActuatorDescription, TelemetryBlock, Health, FaultEstimate)

    def receive_block(number: int, time_ns: int) -> None:
        block = TelemetryBlock(actuator_id="flap", first_index=number)
        assert received(recording, block, time_ns) == ""

    received(recording, ActuatorDescription(actuator_id="flap"))
    received(recording, FaultEstimate(actuator_id="flap", calibration_id="made_in_may"))
    received(recording, health(OK))
    for number in range(50):
        receive_block(number, number * S // 10)
    assert received(recording, health(WARN), 5 * S) == "health of flap from OK to WARN"
    recording.write_snapshot()
    with pytest.raises(ValueError, match="no messages received after the last snapshot"):
        recording.write_snapshot()
    receive_block(50, 6 * S)
    recording.write_snapshot()
    receive_block(51, 7 * S)
    recording.bag.close()

    folder = tmp_path / "flight"
    assert {path.name for path in folder.iterdir()} == {
        *("flight_0.mcap", "flight_1.mcap", METADATA_FILE)
    }

    def written(number: int) -> list[tuple[Any, ...]]:
        items = Bag(folder / f"flight_{number}.mcap").messages()
        figures = ("first_index", "level")
        return [
            (one.topic, *(getattr(one.message, k) for k in figures if hasattr(one.message, k)))
            for one in items
        ]

    description, warning = ("/ActuatorDescription",), ("/Health", WARN)
    blocks = [("/TelemetryBlock", number) for number in range(40, 50)]
    assert written(0) == [description, ("/Health", OK), *blocks, warning]
    assert written(1) == [description, warning, ("/TelemetryBlock", 50)]
    assert "calibration_id of flap: made_in_may" in (folder / METADATA_FILE).read_text()
