"""The recorder writes files of bounded size, or the seconds before something happened."""

import errno
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import serialize_message
from std_msgs.msg import String
from std_srvs.srv import Trigger

from ema_bags.bag_file import BagFile
from ema_bags.metadata import METADATA_FILE
from ema_bags.reader import Bag
from ema_bags.recording import RecorderSettings, Recording
from ema_interfaces.msg import (
    ActuatorDescription,
    FaultEstimate,
    Health,
    HealthSummary,
    TelemetryBlock,
)
from ema_ros.status import ERROR, WARN

from ..waiting import wait_for
from .spinning import Spinning, wait_for_match
from .test_recorder_node import LATCHED, STREAM, recorded, recorder_of, task

S = 10**9


def status(name: str, level: int) -> DiagnosticStatus:
    return DiagnosticStatus(name=name, level=bytes([level]))


def health(level: int, actuator: str = "flap") -> Health:
    return Health(actuator_id=actuator, level=level)


def test_first_level_is_no_change_and_own_statuses_do_not_count(tmp_path: Path):
    settings = RecorderSettings(output="flight", snapshot_duration=1.0)
    recording = Recording(str(tmp_path / "flight"), settings, "/ema/recorder", lambda *_: None)
    for kind in (Health, HealthSummary, String, DiagnosticArray):
        recording.add_topic(f"/{kind.__name__}", kind, STREAM)

    def find(message: Any) -> str:
        data = serialize_message(message)
        return recording.receive(f"/{type(message).__name__}", data, 0, None)

    assert find(health(Health.OK)) == ""
    assert find(health(Health.OK)) == ""
    assert find(health(Health.WARN, "left")) == ""
    assert find(health(Health.WARN)) == "health of flap from OK to WARN"
    assert find(HealthSummary(actuator_id="flap", level=Health.WARN)) == ""
    assert find(HealthSummary(actuator_id="flap", level=Health.ERROR)) == (
        "health of flap from WARN to ERROR"
    )
    assert find(String(data="no level")) == ""
    names = ("/ema/monitor: flap health", "/ema/recorder: recording", "/ema/recorder_2: peers")
    for level, told in ((0, ""), (1, [names[0], names[2]])):
        array = DiagnosticArray(status=[status(name, level) for name in names])
        found = find(array)
        assert found == (", ".join(f"{name} from OK to WARN" for name in told) if told else "")
    recording.bag.close()


def test_snapshot_begins_with_what_held_before_it(tmp_path: Path):
    settings = RecorderSettings(output="flight", snapshot_duration=1.0)
    recording = Recording(str(tmp_path / "flight"), settings, "/ema/recorder", lambda *_: None)
    recording.add_topic("/ema/actuator_description", ActuatorDescription, LATCHED)
    recording.add_topic("/ema/telemetry", TelemetryBlock, STREAM)
    recording.add_topic("/ema/health", Health, LATCHED)
    recording.add_topic("/ema/fault_estimate", FaultEstimate, STREAM)

    def receive(name: str, message: Any, time_ns: int) -> str:
        return recording.receive(f"/ema/{name}", serialize_message(message), time_ns, None)

    receive("actuator_description", ActuatorDescription(actuator_id="flap"), 0)
    estimate = FaultEstimate(actuator_id="flap", calibration_id="made_in_may")
    receive("fault_estimate", estimate, 0)
    receive("health", health(Health.OK), 0)
    for number in range(50):
        block = TelemetryBlock(actuator_id="flap", first_index=number)
        assert receive("telemetry", block, number * S // 10) == ""
    assert receive("health", health(Health.WARN), 5 * S) == "health of flap from OK to WARN"
    recording.write_snapshot()
    with pytest.raises(ValueError, match="nothing was received since the last snapshot"):
        recording.write_snapshot()
    receive("telemetry", TelemetryBlock(actuator_id="flap", first_index=50), 6 * S)
    recording.write_snapshot()
    receive("telemetry", TelemetryBlock(actuator_id="flap", first_index=51), 7 * S)
    recording.bag.close()

    assert sorted(path.name for path in (tmp_path / "flight").iterdir()) == [
        "flight_0.mcap",
        "flight_1.mcap",
        METADATA_FILE,
    ]
    first, second = (
        [
            (item.topic.removeprefix("/ema/"), getattr(item.message, "first_index", None))
            for item in Bag(tmp_path / "flight" / f"flight_{number}.mcap").messages()
        ]
        for number in range(2)
    )
    held = [("actuator_description", None), ("health", None)]
    assert first == [*held, *(("telemetry", n) for n in range(40, 50)), ("health", None)]
    assert second == [*held, ("telemetry", 50)]
    levels = [
        item.message.level
        for number in range(2)
        for item in Bag(tmp_path / "flight" / f"flight_{number}.mcap").messages(["/ema/health"])
    ]
    assert levels == [Health.OK, Health.WARN, Health.WARN]
    text = (tmp_path / "flight" / METADATA_FILE).read_text()
    assert "calibration_id of flap: made_in_may" in text


def test_recorder_writes_when_a_level_changes_and_on_demand(graph: Spinning, tmp_path: Path):
    source = graph.node()
    text = source.create_publisher(String, "text", STREAM)
    output = source.create_publisher(Health, "health", LATCHED)
    recorder = recorder_of(
        graph, tmp_path / "flight", topics=["text", "health"], snapshot_duration=1000.0
    )
    assert recorder.bring_up()
    wait_for_match(recorder, text, output)
    output.publish(health(Health.OK))
    for number in range(20):
        text.publish(String(data=str(number)))
    wait_for(lambda: recorder._recorded and len(recorder._recorded._kept) == 21, "all of it")
    assert task(recorder).values["messages"] == 0
    output.publish(health(Health.WARN))
    recorded(recorder, 22)
    assert task(recorder).values["snapshots"] == 1
    client = source.create_client(Trigger, "recorder/snapshot")
    assert client.wait_for_service(10.0)

    def snapshot() -> Trigger.Response:
        future = client.call_async(Trigger.Request())
        wait_for(future.done, "the answer")
        answer = future.result()
        assert answer is not None
        return answer

    assert snapshot().message == "nothing was received since the last snapshot"
    text.publish(String(data="20"))
    wait_for(lambda: task(recorder).values["kept [B]"], "the message")
    answer = snapshot()
    assert answer.success
    assert answer.message == f"1 messages of 0.000 s to {tmp_path / 'flight' / 'flight_1.mcap'}"
    text.publish(String(data="never written"))
    wait_for(lambda: task(recorder).values["kept [B]"], "the message")
    recorder.trigger_shutdown()
    bag = Bag(tmp_path / "flight")
    assert [item.message.data for item in bag.messages(["/ema/text"])] == [
        str(number) for number in range(21)
    ]
    assert bag.damage == ""


def test_snapshot_that_cannot_be_written_is_refused_and_written_later(
    graph: Spinning, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    source = graph.node()
    text = source.create_publisher(String, "text", STREAM)
    recorder = recorder_of(graph, tmp_path / "flight", topics=["text"], snapshot_duration=1000.0)
    assert recorder.bring_up()
    wait_for_match(recorder, text)
    text.publish(String(data="kept"))
    wait_for(lambda: task(recorder).values["kept [B]"], "the message")
    client = source.create_client(Trigger, "recorder/snapshot")
    assert client.wait_for_service(10.0)

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr(BagFile, "flush", refuse)
        future = client.call_async(Trigger.Request())
        wait_for(future.done, "the answer")
        answer: Any = future.result()
        assert task(recorder).level == ERROR
    assert not answer.success
    assert answer.message == (
        "1 messages of 0.000 s: waits in memory, not written: [Errno 28] No space left on device"
    )
    recording = recorder._recorded
    assert recording is not None
    wait_for(lambda: recording.bag.failure is None, "the recorder to go on")
    recorder.trigger_shutdown()
    assert [item.message.data for item in Bag(tmp_path / "flight").messages()] == ["kept"]


def test_cache_that_is_too_small_is_told(graph: Spinning, tmp_path: Path):
    text = graph.node().create_publisher(String, "text", STREAM)
    recorder = recorder_of(
        graph,
        tmp_path / "flight",
        topics=["text"],
        snapshot_duration=1000.0,
        max_cache_size=100_000,
    )
    assert recorder.bring_up()
    wait_for_match(recorder, text)
    for number in range(12):
        text.publish(String(data=str(number) * 10_000))
    wait_for(lambda: "max_cache_size = 100000 B holds" in task(recorder).message, "the remark")
    assert task(recorder).level == WARN
    assert int(task(recorder).values["kept [B]"]) <= 100_000
