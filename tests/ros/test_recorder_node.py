"""The recorder writes down what is published, says what it cannot, and survives its own end."""

import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.highlevel import AnyReader
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header, String

from ema_bags import recorded_topic
from ema_bags.qos import offered_qos, recorded_qos
from ema_bags.reader import Bag
from ema_bags.recorder_node import RecorderNode
from ema_interfaces.msg import TelemetryBlock
from ema_ros.status import OK, WARN, Task

from ..bags.recorded_messages import ros_messages
from ..waiting import DEADLINE_S, wait_for
from .spinning import Spinning, ros_context, wait_for_match

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STREAM = QoSProfile(depth=500)
BEST_EFFORT = QoSProfile(depth=500, reliability=ReliabilityPolicy.BEST_EFFORT)


def recorder_of(graph: Spinning, path: Path, **parameters: Any) -> RecorderNode:
    return graph.managed(RecorderNode, **{"output": str(path), **parameters})


def task(recorder: RecorderNode) -> Task:
    (only,) = recorder.tasks()
    return only


def recorded(recorder: RecorderNode, count: int) -> None:
    wait_for(lambda: int(task(recorder).values["messages"]) >= count, f"{count} messages recorded")


def block(number: int) -> TelemetryBlock:
    message = TelemetryBlock(actuator_id="flap", first_index=100 * number, sample_period=1e-4)
    for name in ("command", "current", "position", "speed"):
        getattr(message, name).extend(number + 0.25 * index for index in range(100))
    return message


def contents(path: Path, topic: str) -> list[Any]:
    return [item.message for item in ros_messages(Bag(path), [topic])]


@pytest.mark.parametrize("name", ["flight", "flight.mcap"])
def test_everything_published_is_recorded_in_order(graph: Spinning, tmp_path: Path, name: str):
    source = graph.node()
    latched = source.create_publisher(String, "latched", LATCHED)
    latched.publish(String(data="published before there was a recorder"))
    published_ns = time.time_ns()
    telemetry = source.create_publisher(TelemetryBlock, "telemetry", STREAM)
    text = source.create_publisher(String, "text", STREAM)
    recorder = recorder_of(graph, tmp_path / name, topics=["telemetry", "/ema/text", "latched"])
    assert recorder.bring_up()
    wait_for_match(recorder, telemetry, text, latched)
    begin_ns = time.time_ns()
    for number in range(200):
        telemetry.publish(block(number))
        text.publish(String(data=str(number)))
    recorded(recorder, 401)
    end_ns = time.time_ns()
    assert task(recorder).level == OK
    assert task(recorder).values["lost messages"] == 0
    recorder.trigger_shutdown()
    assert recorder.exit_code == 0

    bag = Bag(tmp_path / name)
    assert bag.damage == ""
    assert {topic: item.count for topic, item in bag.topics.items()} == {
        "/ema/telemetry": 200,
        "/ema/text": 200,
        "/ema/latched": 1,
    }
    assert contents(bag.path, "/ema/telemetry") == [block(number) for number in range(200)]
    assert [item.data for item in contents(bag.path, "/ema/text")] == [str(n) for n in range(200)]
    (first,) = bag.messages(["/ema/latched"])
    assert first.message.data == "published before there was a recorder"
    assert first.publish_time_ns <= published_ns < first.log_time_ns
    for item in bag.messages(["/ema/telemetry", "/ema/text"]):
        assert begin_ns <= item.publish_time_ns <= item.log_time_ns <= end_ns
    for topic, qos in (("/ema/telemetry", STREAM), ("/ema/latched", LATCHED)):
        (offered,) = recorded_qos(bag.topics[topic].qos)
        told = {"history": "unknown", "depth": 0}  # what discovery does not tell
        assert offered_qos(offered) == offered_qos(qos) | told


def test_default_is_the_namespace_and_the_diagnostics(graph: Spinning, tmp_path: Path):
    source = graph.node(namespace="/flap_1")
    wanted = source.create_publisher(String, "deep/text", STREAM)
    others = [
        source.create_publisher(String, name, STREAM)
        for name in ("/elsewhere", "/flap_12/text", "_hidden", "deep/_hidden/text")
    ]
    parameters = [Parameter("output", value=str(tmp_path / "flight"))]
    recorder = graph.add(
        RecorderNode(namespace="/flap_1", context=graph.context, parameter_overrides=parameters)
    )
    assert recorder.bring_up()
    wait_for_match(recorder, wanted)
    for publisher in (*others, wanted):
        publisher.publish(String())
    wait_for(lambda: "/diagnostics" in str(task(recorder).values["topics"]), "diagnostics")
    recorder.report()
    recorded(recorder, 2)
    recorder.trigger_shutdown()
    assert set(Bag(tmp_path / "flight").topics) == {
        "/diagnostics",
        "/flap_1/deep/text",
        "/flap_1/recorder/transition_event",
    }


def test_log_times_are_simulated_where_time_is(graph: Spinning, tmp_path: Path):
    source = graph.node()
    clock = source.create_publisher(Clock, "/clock", QoSProfile(depth=1))
    text = source.create_publisher(String, "text", LATCHED)
    text.publish(String(data="before time begins"))
    recorder = recorder_of(graph, tmp_path / "flight", topics=["text"], use_sim_time=True)
    assert recorder.bring_up()
    wait_for(lambda: recorder.get_publishers_info_by_topic("text"), "the publisher")
    recorder._discover()
    assert task(recorder).values["topics"] == ""
    stamp = Clock()
    stamp.clock.sec = 42

    def is_heard() -> bool:
        clock.publish(stamp)
        return int(task(recorder).values["messages"]) == 1

    wait_for(is_heard, "the message")
    recorder.trigger_shutdown()
    (item,) = Bag(tmp_path / "flight").messages()
    assert item.log_time_ns == 42 * 10**9


def test_pausing_goes_on_in_the_same_bag(graph: Spinning, tmp_path: Path):
    publisher = graph.node().create_publisher(String, "text", STREAM)
    recorder = recorder_of(graph, tmp_path / "flight", topics=["text"])
    assert recorder.bring_up()
    wait_for_match(recorder, publisher)
    publisher.publish(String(data="before"))
    recorded(recorder, 1)
    recorder.trigger_deactivate()
    assert "paused" in task(recorder).message
    wait_for(lambda: not publisher.get_subscription_count(), "the end of the subscription")
    publisher.publish(String(data="meanwhile"))
    recorder.trigger_activate()
    wait_for_match(recorder, publisher)
    publisher.publish(String(data="after"))
    recorded(recorder, 2)
    recorder.trigger_shutdown()
    assert [item.data for item in contents(tmp_path / "flight", "/ema/text")] == ["before", "after"]


def test_bag_that_is_there_is_not_replaced_unasked(graph: Spinning, tmp_path: Path):
    path, other = tmp_path / "flight", tmp_path / "other"
    recorder = recorder_of(graph, path)
    assert recorder.bring_up()
    for name, value in (("output", str(other)), ("topics", ["text"])):
        [answer] = recorder.set_parameters([Parameter(name, value=value)])
        assert not answer.successful
        assert answer.reason == f"{name}: {path} is open; clean the node up first"
    recorder.trigger_deactivate()
    recorder.trigger_cleanup()
    before = (path / "flight_0.mcap").read_bytes()
    assert recorder.trigger_configure() == TransitionCallbackReturn.FAILURE
    refusal = recorder._refused
    assert str(path) in refusal
    assert "parameter output" in refusal
    assert "overwrite" in refusal
    assert (path / "flight_0.mcap").read_bytes() == before
    recorder.set_parameters([Parameter("output", value=str(other))])
    assert recorder.trigger_configure() == TransitionCallbackReturn.SUCCESS
    recorder.trigger_cleanup()
    assert (other / "metadata.yaml").exists()
    recorder.set_parameters([Parameter("overwrite", value=True)])
    assert recorder.trigger_configure() == TransitionCallbackReturn.SUCCESS


def test_default_output_is_named_by_the_time(graph: Spinning, tmp_path: Path, monkeypatch: Any):
    monkeypatch.chdir(tmp_path)
    recorder = recorder_of(graph, Path(), output="")
    assert recorder.bring_up()
    recorder.trigger_shutdown()
    (path,) = tmp_path.iterdir()
    at = time.mktime(time.strptime(path.name, "ema_%Y%m%dT%H%M%SZ")) - time.timezone
    assert abs(time.time() - at) < 60.0


def test_every_publisher_is_heard_whatever_it_offers(graph: Spinning, tmp_path: Path):
    source = graph.node()
    reliable = source.create_publisher(String, "text", LATCHED)
    best_effort = source.create_publisher(String, "text", BEST_EFFORT)
    recorder = recorder_of(graph, tmp_path / "flight", topics=["text"])
    wait_for(lambda: len(recorder.get_publishers_info_by_topic("text")) == 2, "both publishers")
    assert recorder.bring_up()
    wait_for_match(recorder, reliable, best_effort)
    reliable.publish(String(data="reliable"))
    best_effort.publish(String(data="best effort"))
    recorded(recorder, 2)
    late = graph.node("late").create_publisher(String, "text", BEST_EFFORT)
    wait_for_match(recorder, late)


def test_gone_publisher_is_told(graph: Spinning, tmp_path: Path):
    source = graph.node()
    publisher = source.create_publisher(String, "text", STREAM)
    recorder = recorder_of(graph, tmp_path / "flight", topics=["text", "never"])
    assert recorder.bring_up()
    wait_for_match(recorder, publisher)
    assert "/ema/never: no publisher yet" in task(recorder).message
    source.destroy_publisher(publisher)
    wait_for(lambda: task(recorder).values["publisher gone"] == "/ema/text", "the remark")
    assert "/ema/text: the publisher is gone" in task(recorder).message


@pytest.fixture
def other_graph() -> Iterator[Spinning]:
    """One of another participant."""
    with ros_context() as context:
        graph = Spinning(context)
        yield graph
        graph.close()


def test_topic_of_several_types_is_not_recorded(
    graph: Spinning, other_graph: Spinning, tmp_path: Path
):
    graph.node().create_publisher(Header, "text", STREAM)
    other_graph.node().create_publisher(String, "text", STREAM)
    recorder = recorder_of(graph, tmp_path / "flight", topics=["text"])
    wait_for(lambda: len(recorder.get_publishers_info_by_topic("text")) == 2, "both publishers")
    assert recorder.bring_up()
    wait_for(lambda: task(recorder).values["not recorded"] == "/ema/text", "the remark")
    assert "several types: std_msgs/msg/Header, std_msgs/msg/String" in task(recorder).message


@pytest.mark.parametrize("missing", [True, False])
def test_type_that_is_not_the_installed_one_is_not_recorded(
    graph: Spinning, tmp_path: Path, monkeypatch: Any, missing: bool
):
    def not_installed(name: str) -> str:
        if missing:
            raise ValueError(f"message type {name} is not installed here")
        return "RIHS01_of_another_version"

    monkeypatch.setattr(recorded_topic, "type_hash", not_installed)
    graph.node().create_publisher(String, "text", STREAM)
    recorder = recorder_of(graph, tmp_path / "flight", topics=["text"])
    assert recorder.bring_up()
    wait_for(lambda: task(recorder).values["not recorded"] == "/ema/text", "the remark")
    told = "not installed" if missing else "RIHS01_of_another_version"
    assert told in task(recorder).message


def test_messages_that_the_middleware_drops_are_counted(
    graph: Spinning, tmp_path: Path, monkeypatch: Any
):
    monkeypatch.setattr(recorded_topic, "RELIABLE_DEPTH", 5)
    publisher = graph.node().create_publisher(String, "text", QoSProfile(depth=5))
    recorder = recorder_of(graph, tmp_path / "flight", topics=["text"])
    assert recorder.bring_up()
    wait_for_match(recorder, publisher)
    publisher.publish(String(data="first"))
    recorded(recorder, 1)
    with recorder._writing:  # a disk that does not answer
        for number in range(50):
            publisher.publish(String(data=str(number)))
    wait_for(lambda: task(recorder).values["lost messages"], "the loss")
    recorder.trigger_deactivate()
    values = task(recorder).values
    assert values["lost messages"] == 51 - int(values["messages"])
    assert f"{values['lost messages']} messages lost" in task(recorder).message
    assert task(recorder).values["lost by topic"] == f"/ema/text {values['lost messages']}"


def test_lost_telemetry_of_several_publishers_is_counted(
    graph: Spinning, tmp_path: Path, monkeypatch: Any
):
    monkeypatch.setattr(recorded_topic, "RELIABLE_DEPTH", 5)
    publishers = [
        graph.node(name).create_publisher(TelemetryBlock, "telemetry", QoSProfile(depth=5))
        for name in ("left", "right")
    ]

    def publish(number: int) -> None:
        for name, publisher in zip(("left", "right"), publishers, strict=True):
            message = block(number)
            message.actuator_id = name
            publisher.publish(message)

    recorder = recorder_of(graph, tmp_path / "flight", topics=["telemetry"])
    assert recorder.bring_up()
    for publisher in publishers:
        wait_for_match(recorder, publisher)
    publish(0)
    recorded(recorder, 2)
    with recorder._writing:  # a disk that does not answer
        for number in range(1, 50):
            publish(number)
            time.sleep(0.002)
    wait_for(lambda: task(recorder).values["lost messages"], "the loss")
    publish(50)
    wait_for(
        lambda: task(recorder).values["lost messages"] == 102 - task(recorder).values["messages"],
        "all that is missing to be counted",
    )


def recorder_process(path: Path) -> subprocess.Popen[str]:
    parameters = ["--ros-args", "-p", f"output:={path}", "-p", "topics:=['text']"]
    command = [sys.executable, "-m", "ema_bags.recorder_node", *parameters]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


def send(publisher: Any, numbers: range) -> None:
    for number in numbers:
        publisher.publish(String(data=str(number)))


def in_step(numbers: list[int]) -> list[int]:
    """Return the numbers as they were sent, from the first that is there.

    A publisher knows of a new subscription of another process before that knows of the publisher.
    """
    return list(range(numbers[0], numbers[-1] + 1))


def on_disk(bag: Path) -> list[int]:
    return [int(item.message.data) for item in Bag(bag).messages()]


def test_interrupted_recorder_leaves_a_whole_bag(graph: Spinning, tmp_path: Path):
    publisher = graph.node().create_publisher(String, "text", STREAM)
    with recorder_process(tmp_path / "flight") as process:
        try:
            wait_for(publisher.get_subscription_count, "the recorder")
            send(publisher, range(50))
            wait_for(lambda: 49 in on_disk(tmp_path / "flight"), "the last message on disk")
            process.send_signal(signal.SIGTERM)
            assert process.wait(timeout=DEADLINE_S) == 0
        finally:
            process.kill()
    assert Bag(tmp_path / "flight").damage == ""
    with AnyReader([tmp_path / "flight"]) as reader:
        read = [
            int(getattr(reader.deserialize(data, connection.msgtype), "data", "-1"))
            for connection, _, data in reader.messages()
        ]
    assert read == in_step(read)
    assert read[-1] == 49


def test_recorder_that_stood_still_says_so_in_status_and_bag(graph: Spinning, tmp_path: Path):
    publisher = graph.node().create_publisher(String, "text", STREAM)
    told: dict[str, DiagnosticStatus] = {}

    def note(message: DiagnosticArray) -> None:
        told.update({item.name: item for item in message.status})

    graph.node().create_subscription(DiagnosticArray, "/diagnostics", note, 100)

    def standstills() -> int:
        publisher.publish(String(data="text"))
        status = told.get("/ema/recorder: recording")
        values = {item.key: item.value for item in status.values} if status else {}
        return int(values.get("standstills", "0"))

    with recorder_process(tmp_path / "flight") as process:
        try:
            wait_for(publisher.get_subscription_count, "the recorder")
            before = standstills()
            process.send_signal(signal.SIGSTOP)
            time.sleep(3.0)
            process.send_signal(signal.SIGCONT)
            wait_for(lambda: standstills() > before, "the recorder to say that it stood still")
            status = told["/ema/recorder: recording"]
            assert status.level[0] == WARN
            assert "may be missing: the recorder stood still for " in status.message
            values = {item.key: item.value for item in status.values}
            process.send_signal(signal.SIGINT)
            assert process.wait(timeout=DEADLINE_S) == 0
        finally:
            process.kill()
    # A busy machine may have starved it before and after as well.
    remarks = Bag(tmp_path / "flight").remarks
    pattern = (
        r"gap: (messages from [\d.]+ s to [\d.]+ s may be missing: the recorder stood still .*)"
    )
    told_there = [match[1] for text in remarks if (match := re.fullmatch(pattern, text))]
    assert len(told_there) == len(remarks) >= int(values["standstills"]) >= 1
    information = yaml.safe_load((tmp_path / "flight" / "metadata.yaml").read_text())
    noted = information["rosbag2_bagfile_information"]["custom_data"]
    assert set(told_there) <= set(noted.values())
