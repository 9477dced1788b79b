# SPDX-License-Identifier: Apache-2.0
"""Recordings of the seconds before and after an event."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from ema_bags.bag_recorder import BagRecorder, RecorderSettings
from ema_bags.metadata import METADATA_FILE, folder_contents
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
    """Return a function that begins a recording with given settings, with a topic per type."""
    with ExitStack() as opened:

        def begin(*kinds: type, **options: Any) -> BagRecorder:
            settings = RecorderSettings(output="flight", **{"snapshot_duration": 1.0, **options})
            path = str(tmp_path / "flight")
            recording = BagRecorder(path, settings, "/ema/recorder", lambda *_: None)
            opened.callback(recording.bag.close)
            for kind in kinds:
                qos = LATCHED if kind in LATCHING else STREAM
                recording.bag.add_topic(f"/{kind.__name__}", kind, qos)
            return recording

        yield begin


def received(recording: BagRecorder, message: Any, time_ns: int = 0) -> str:
    """Receive a message, and return the reason for a snapshot, or ""."""
    data = serialize_message(message)
    return recording.receive(f"/{type(message).__name__}", data, time_ns, None)


def health(level: int, actuator: str = "flap") -> Health:
    return Health(actuator_id=actuator, level=level)


def test_first_level_is_no_change_and_the_recorders_own_statuses_do_not_count(record):
    recording = record(Health, HealthSummary, String, DiagnosticArray)
    for message, printed in (
        (health(OK), ""),
        (health(OK), ""),
        (health(WARN, "left"), ""),
        (health(WARN), "health of flap from OK to WARN"),
        (HealthSummary(actuator_id="flap", level=WARN), ""),
        (HealthSummary(actuator_id="flap", level=ERROR), "health of flap from WARN to ERROR"),
        (String(data="no level"), ""),
    ):
        assert received(recording, message) == printed
    names = ("/ema/monitor: flap health", "/ema/recorder: recording", "/ema/recorder_2: peers")
    for level, printed in (
        (b"\0", ""),
        (b"\1", f"{names[0]} from OK to WARN, {names[2]} from OK to WARN"),
    ):
        status = [DiagnosticStatus(name=name, level=level) for name in names]
        assert received(recording, DiagnosticArray(status=status)) == printed


def test_snapshot_begins_with_the_latched_messages_before_it(record, tmp_path: Path):
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
            (item.topic, *(getattr(item.message, k) for k in figures if hasattr(item.message, k)))
            for item in items
        ]

    description, warning = ("/ActuatorDescription",), ("/Health", WARN)
    blocks = [("/TelemetryBlock", number) for number in range(40, 50)]
    assert written(0) == [description, ("/Health", OK), *blocks, warning]
    assert written(1) == [description, warning, ("/TelemetryBlock", 50)]
    assert "calibration_id of flap: made_in_may" in (folder / METADATA_FILE).read_text()


def test_snapshot_includes_the_time_after_the_change(record):
    recording = record(Health, TelemetryBlock, snapshot_duration=2.0, snapshot_after=3.0)
    received(recording, health(OK))
    assert received(recording, health(WARN), 4 * S) == ""
    assert received(recording, TelemetryBlock(first_index=1), 5 * S) == ""
    # A further change postpones the snapshot, which then contains both.
    assert received(recording, health(ERROR), 6 * S) == ""
    assert received(recording, TelemetryBlock(first_index=2), 8 * S) == ""
    reason = received(recording, TelemetryBlock(first_index=3), 9 * S)
    assert reason == "health of flap from OK to WARN, health of flap from WARN to ERROR"
    assert recording.write_snapshot().startswith("5 messages (5.000 s) written to ")


def test_flickering_level_does_not_prevent_a_snapshot(record):
    recording = record(Health, snapshot_duration=5.0, snapshot_after=3.0)
    written = [
        (time_s, recording.write_snapshot())
        for time_s in range(20)
        if received(recording, health((OK, WARN)[time_s // 2 % 2]), time_s * S)
    ]
    # The first change is at 2 s; the snapshot includes the time before it.
    assert written[0] == (10, written[0][1])
    assert written[0][1].startswith("11 messages (10.000 s) written to ")


def test_clock_that_is_set_back_does_not_postpone_a_snapshot(record):
    recording = record(Health, TelemetryBlock, snapshot_after=3.0)
    received(recording, health(OK), 100 * S)
    assert received(recording, health(WARN), 101 * S) == ""
    assert received(recording, TelemetryBlock(), 50 * S) == "health of flap from OK to WARN"


def test_pending_snapshot_is_written_at_the_end(record, tmp_path: Path):
    recording = record(Health, snapshot_after=30.0)
    received(recording, health(OK), S)
    received(recording, health(WARN), 2 * S)
    assert recording.close().startswith("health of flap from OK to WARN: 2 messages (1.000 s)")
    assert len(list(Bag(tmp_path / "flight").messages())) == 2


def test_statuses_trigger_no_snapshot_without_a_change_of_health(record):
    recording = record(Health, DiagnosticArray, snapshot_levels="health")
    for level in (b"\0", b"\1"):
        status = [DiagnosticStatus(name="/ema/monitor: flap health", level=level)]
        assert received(recording, DiagnosticArray(status=status), S) == ""
    received(recording, health(OK), S)
    assert received(recording, health(WARN), S) == "health of flap from OK to WARN"


def test_oldest_snapshots_are_deleted_beyond_the_size_limit(record, tmp_path: Path):
    recording = record(Health, TelemetryBlock, max_snapshots_size=150_000)
    folder = tmp_path / "flight"
    position = np.random.default_rng(1).random(1000)
    for number in range(12):
        level = (OK, WARN)[number % 2]
        received(recording, TelemetryBlock(position=position), (10 * number + 1) * S)
        if received(recording, health(level), (10 * number + 1) * S):
            recording.write_snapshot()
        # The current file counts towards the limit only when the next one begins.
        assert sum(path.stat().st_size for path in folder.glob("*.mcap")) < 200_000
    recording.bag.close()
    names = sorted(path.name for path in folder.glob("*.mcap"))
    assert "flight_0.mcap" not in names
    assert len(names) > 2
    bag = Bag(folder)
    assert not bag.damage
    metadata = folder_contents(folder)
    assert sorted(path.name for path in metadata.files) == names
    assert metadata.message_count == len(list(bag.messages()))


@pytest.mark.parametrize(("name", "value"), [("snapshot_after", 3), ("max_snapshots_size", 5000)])
def test_snapshot_settings_require_snapshots(name, value):
    with pytest.raises(ValueError, match=f"{name} = {value}: expected snapshot_duration as well"):
        RecorderSettings(**{name: value})
