# SPDX-License-Identifier: Apache-2.0
"""The recorder writes all messages, reports what it cannot record, and leaves readable bags."""

import errno
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger

from ema_bags import recorded_topic, recorder_node
from ema_bags.bag_file import BagFile
from ema_bags.qos import offered_qos, recorded_qos
from ema_bags.reader import Bag
from ema_bags.recorder_node import RecorderNode
from ema_interfaces.msg import Health, TelemetryBlock
from ema_ros.status import ERROR, OK, WARN, Task
from ema_ros.topics import ALIVE

from ..bags.recorded_messages import ros_messages
from ..waiting import wait_for
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
    latched = source.create_publisher(String, "latched", ALIVE)
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
    for topic, qos in (("/ema/telemetry", STREAM), ("/ema/latched", ALIVE)):
        (offered,) = recorded_qos(bag.topics[topic].qos)
        reported = {"history": "unknown", "depth": 0}  # not part of the discovery data
        assert offered_qos(offered) == offered_qos(qos) | reported


def test_default_in_the_root_namespace_omits_topics_that_all_nodes_share(
    graph: Spinning, tmp_path: Path
):
    wanted = graph.node(namespace="/flap_1").create_publisher(String, "text", STREAM)
    parameters = [Parameter("output", value=str(tmp_path / "flight"))]
    recorder = graph.add(RecorderNode(context=graph.context, parameter_overrides=parameters))
    assert recorder.bring_up()
    wait_for_match(recorder, wanted)
    recorded = set(recorder._topics)
    assert {"/flap_1/text", "/diagnostics"} <= recorded
    assert not recorded & {"/rosout", "/parameter_events"}


def test_default_topics_are_the_namespace_and_the_diagnostics(graph: Spinning, tmp_path: Path):
    source = graph.node(namespace="/flap_1")
    wanted = source.create_publisher(String, "deep/text", STREAM)
    excluded = [
        source.create_publisher(String, name, STREAM)
        for name in ("/elsewhere", "/flap_12/text", "_hidden", "deep/_hidden/text")
    ]
    parameters = [Parameter("output", value=str(tmp_path / "flight"))]
    recorder = graph.add(
        RecorderNode(namespace="/flap_1", context=graph.context, parameter_overrides=parameters)
    )
    assert recorder.bring_up()
    wait_for_match(recorder, wanted)
    for publisher in (*excluded, wanted):
        publisher.publish(String())
    for name in ("/diagnostics", "/flap_1/node_status"):
        wait_for(lambda name=name: name in str(task(recorder).values["topics"]), name)
    recorder.report()
    recorded(recorder, 2)
    recorder.trigger_shutdown()
    assert set(Bag(tmp_path / "flight").topics) == {
        "/diagnostics",
        "/flap_1/deep/text",
        "/flap_1/node_status",
        "/flap_1/recorder/transition_event",
    }


def test_log_times_are_simulated_with_simulated_time(graph: Spinning, tmp_path: Path):
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


def test_pausing_continues_in_the_same_bag(graph: Spinning, tmp_path: Path):
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


def test_existing_bag_is_not_overwritten_by_default(graph: Spinning, tmp_path: Path):
    path, second_path = tmp_path / "flight", tmp_path / "other"
    recorder = recorder_of(graph, path)
    assert recorder.bring_up()
    for name, value in (("output", str(second_path)), ("topics", ["text"])):
        [answer] = recorder.set_parameters([Parameter(name, value=value)])
        assert not answer.successful
        assert answer.reason.startswith(f"{name} cannot be changed while the node is active")
    recorder.trigger_deactivate()
    recorder.trigger_cleanup()
    before = (path / "flight_0.mcap").read_bytes()
    assert recorder.trigger_configure() == TransitionCallbackReturn.FAILURE
    refusal = recorder._refused
    assert str(path) in refusal
    assert "parameter output" in refusal
    assert "overwrite" in refusal
    assert (path / "flight_0.mcap").read_bytes() == before
    recorder.set_parameters([Parameter("output", value=str(second_path))])
    assert recorder.trigger_configure() == TransitionCallbackReturn.SUCCESS
    recorder.trigger_cleanup()
    assert (second_path / "metadata.yaml").exists()
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


def test_every_publisher_is_received_regardless_of_its_quality_of_service(
    graph: Spinning, tmp_path: Path
):
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


def test_gone_publisher_is_reported(graph: Spinning, tmp_path: Path):
    source = graph.node()
    publisher = source.create_publisher(String, "text", STREAM)
    private = source.create_publisher(String, "~/transition_event", STREAM)
    names = ["text", "source/transition_event", "never"]
    recorder = recorder_of(graph, tmp_path / "flight", topics=names)
    assert recorder.bring_up()
    wait_for_match(recorder, publisher, private)
    assert "/ema/never: no publisher yet" in task(recorder).message
    # The end of a lifecycle node is not a loss.
    source.destroy_publisher(private)
    transitions = recorder._topics["/ema/source/transition_event"]
    wait_for(lambda: not transitions.has_publisher, "the end of the transitions")
    assert "disappeared" not in task(recorder).message
    source.destroy_publisher(publisher)
    wait_for(lambda: task(recorder).values["publisher gone"] == "/ema/text", "the remark")
    assert "/ema/text: the publisher has disappeared" in task(recorder).message


@pytest.fixture
def other_graph() -> Iterator[Spinning]:
    """A graph with another DDS participant."""
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
def test_topic_of_another_type_version_is_not_recorded(
    graph: Spinning, tmp_path: Path, monkeypatch: Any, missing: bool
):
    def not_installed(name: str) -> str:
        if missing:
            raise ValueError(f"message type {name} is not installed")
        return "RIHS01_of_another_version"

    monkeypatch.setattr(recorded_topic, "type_hash", not_installed)
    graph.node().create_publisher(String, "text", STREAM)
    recorder = recorder_of(graph, tmp_path / "flight", topics=["text"])
    assert recorder.bring_up()
    wait_for(lambda: task(recorder).values["not recorded"] == "/ema/text", "the remark")
    reported = "not installed" if missing else "RIHS01_of_another_version"
    assert reported in task(recorder).message


def test_messages_that_the_middleware_drops_are_counted(
    graph: Spinning, tmp_path: Path, monkeypatch: Any
):
    """Losses of one publisher show by message numbers, losses of telemetry by sample numbers."""
    monkeypatch.setattr(recorded_topic, "RELIABLE_DEPTH", 5)
    shallow = QoSProfile(depth=5)
    text = graph.node().create_publisher(String, "text", shallow)
    telemetry = {
        name: graph.node(name).create_publisher(TelemetryBlock, "telemetry", shallow)
        for name in ("left", "right")
    }

    def publish(number: int) -> None:
        text.publish(String(data=str(number)))
        for name, publisher in telemetry.items():
            message = block(number)
            message.actuator_id = name
            publisher.publish(message)

    recorder = recorder_of(graph, tmp_path / "flight", topics=["text", "telemetry"])
    assert recorder.bring_up()
    wait_for_match(recorder, text, *telemetry.values())
    publish(0)
    recorded(recorder, 3)
    with recorder._writing:  # a disk that does not answer
        for number in range(1, 50):
            publish(number)
    wait_for(lambda: task(recorder).values["lost messages"], "the loss")
    # Missing telemetry shows by the next block.
    publish(50)

    def are_counted() -> bool:
        values = task(recorder).values
        return values["lost messages"] == 3 * 51 - int(values["messages"])

    wait_for(are_counted, "all that is missing to be counted")
    recorder.trigger_deactivate()
    lost = task(recorder).values["lost messages"]
    assert f"{lost} messages lost" in task(recorder).message
    by_topic = task(recorder).values["lost by topic"].replace(", ", " ").split(" ")
    assert by_topic[::2] == ["/ema/telemetry", "/ema/text"]
    assert sum(map(int, by_topic[1::2])) == lost > 0


def test_two_publishers_of_one_actuator_are_named_and_lose_nothing(
    graph: Spinning, other_graph: Spinning, tmp_path: Path
):
    first = graph.node().create_publisher(TelemetryBlock, "telemetry", STREAM)
    node = other_graph.node("intruder")
    second = node.create_publisher(TelemetryBlock, "telemetry", STREAM)
    recorder = recorder_of(graph, tmp_path / "flight", topics=["telemetry"])
    assert recorder.bring_up()
    wait_for_match(recorder, first, second)
    for number in range(100):
        first.publish(block(number))
        second.publish(block(10**9 + number))
    expected = (
        "/ema/telemetry: several publishers send actuator_id flap (/ema/intruder, /ema/source)"
    )
    wait_for(lambda: expected in task(recorder).message, "the collision")
    recorded(recorder, 200)
    assert task(recorder).values["lost messages"] == 0
    node.destroy_publisher(second)
    wait_for(lambda: task(recorder).level == OK, "the end of it")
    first.publish(block(100))
    recorded(recorder, 201)
    assert (task(recorder).level, task(recorder).values["lost messages"]) == (OK, 0)


def test_standstill_of_the_recorder_is_reported_in_status_and_bag(
    graph: Spinning, tmp_path: Path, monkeypatch: Any
):
    monkeypatch.setattr(recorder_node, "_STANDSTILL_S", 0.5)
    publisher = graph.node().create_publisher(String, "text", STREAM)
    recorder = recorder_of(graph, tmp_path / "flight", topics=["text"])
    assert recorder.bring_up()
    wait_for_match(recorder, publisher)
    # A busy machine may have suspended the recorder before, and may again.
    before = int(task(recorder).values["standstills"])
    with recorder._discovering:
        time.sleep(0.6)
    wait_for(lambda: int(task(recorder).values["standstills"]) > before, "the standstill")
    assert task(recorder).level == WARN
    assert "may be missing: the recorder was suspended for " in task(recorder).message
    recorder.trigger_shutdown()
    remarks = Bag(tmp_path / "flight").remarks
    pattern = (
        r"gap: (messages from [\d.]+ s to [\d.]+ s may be missing: the recorder was suspended .*)"
    )
    reported = [match[1] for text in remarks if (match := re.fullmatch(pattern, text))]
    assert len(reported) == len(remarks) >= 1
    information = yaml.safe_load((tmp_path / "flight" / "metadata.yaml").read_text())
    noted = information["rosbag2_bagfile_information"]["custom_data"]
    assert set(reported) <= set(noted.values())


def test_recorder_writes_when_a_level_changes_and_on_demand(
    graph: Spinning, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    source, path = graph.node(), tmp_path / "flight"
    text = source.create_publisher(String, "text", STREAM)
    output = source.create_publisher(Health, "health", LATCHED)
    topics = ["text", "health"]
    recorder = recorder_of(graph, path, topics=topics, snapshot_duration=1000.0)
    assert recorder.bring_up()
    wait_for_match(recorder, text, output)
    output.publish(Health(actuator_id="flap", level=Health.OK))
    for number in range(20):
        text.publish(String(data=str(number)))
    wait_for(lambda: recorder._recorded and len(recorder._recorded._kept) == 21, "all of it")
    assert task(recorder).values["messages"] == 0
    output.publish(Health(actuator_id="flap", level=Health.WARN))
    recorded(recorder, 22)
    assert task(recorder).values["snapshots"] == 1

    def snapshot() -> Trigger.Response:
        return graph.call(Trigger, "recorder/snapshot")

    def keep(data: str) -> None:
        text.publish(String(data=data))
        wait_for(lambda: task(recorder).values["kept [B]"], "the message")

    assert snapshot().message == "no messages received after the last snapshot"
    keep("20")
    answer = snapshot()
    assert answer.success
    assert answer.message == f"1 messages (0.000 s) written to {path / 'flight_1.mcap'}"

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    keep("21")
    with monkeypatch.context() as full:
        full.setattr(BagFile, "flush", refuse)
        answer = snapshot()
        assert task(recorder).level == ERROR
    assert not answer.success
    buffered = "are buffered in memory and not written yet: [Errno 28] No space left on device"
    assert buffered in answer.message
    recording = recorder._recorded
    assert recording is not None
    wait_for(lambda: recording.bag.failure is None, "the recorder to go on")
    keep("never written")
    recorder.trigger_shutdown()
    bag = Bag(path)
    texts = [item.message.data for item in bag.messages(["/ema/text"])]
    assert texts == [str(number) for number in range(22)]
    assert bag.damage == ""


def test_cache_that_is_too_small_is_reported(graph: Spinning, tmp_path: Path):
    text = graph.node().create_publisher(String, "text", STREAM)
    settings = {"snapshot_duration": 1000.0, "max_cache_size": 100_000}
    recorder = recorder_of(graph, tmp_path / "flight", topics=["text"], **settings)
    assert recorder.bring_up()
    wait_for_match(recorder, text)
    for number in range(12):
        text.publish(String(data=str(number) * 10_000))
    wait_for(
        lambda: "max_cache_size = 100000 B is enough for" in task(recorder).message, "the remark"
    )
    assert task(recorder).level == WARN
    assert int(task(recorder).values["kept [B]"]) <= 100_000
