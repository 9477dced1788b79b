"""The player gives a bag back as it was recorded: message by message, in time, and no more."""

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String

from ema_bags.player_node import PlayerNode
from ema_bags.reader import Bag, Recorded
from ema_bags.recorder_node import RecorderNode
from ema_bags.writer import BagWriter
from ema_interfaces.msg import ActuatorDescription, FaultVectorStamped, Health, TelemetryBlock
from ema_ros.status import ERROR, OK, Task

from ..bags.recorded_messages import ros_messages
from ..waiting import DEADLINE_S, wait_for
from .spinning import Spinning

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STREAM = QoSProfile(depth=100)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
START_NS = 1_700_000_000_000_000_000
STEP_NS = 10_000_000


def player_of(graph: Spinning, bag: Path, **parameters: Any) -> PlayerNode:
    return graph.managed(PlayerNode, bag=str(bag), **parameters)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """One second of numbered texts on two topics in turn, a latched one before them, a clock."""
    path = tmp_path / "flight.mcap"
    with BagWriter(path, chunk_bytes=2000) as writer:
        writer.add_topic("/ema/latched", String, LATCHED)
        writer.add_topic("/clock", Clock, BEST_EFFORT)
        for name in ("/ema/t0", "/ema/t1"):
            writer.add_topic(name, String, STREAM)
        writer.write("/ema/latched", String(data="latched"), START_NS)
        writer.write("/clock", Clock(), START_NS)
        for number in range(101):
            text = String(data=f"{number}")
            writer.write(f"/ema/t{number % 2}", text, START_NS + number * STEP_NS)
    return path


def task(player: PlayerNode) -> Task:
    (only,) = player.tasks()
    return only


def texts(heard: list[Any]) -> list[int]:
    return [int(message.data) for message in heard]


def test_bag_is_played_in_order_with_its_clock(graph: Spinning, bag: Path):
    heard = [graph.listen(String, f"t{number}", STREAM) for number in range(2)]
    clock = graph.listen(Clock, "/clock", BEST_EFFORT)
    player = player_of(graph, bag, rate=5.0)
    assert player.bring_up()
    assert player.finished.wait(DEADLINE_S)
    wait_for(lambda: len(heard[0]) + len(heard[1]) == 101, "all messages")
    assert texts(heard[0]) == list(range(0, 101, 2))
    assert texts(heard[1]) == list(range(1, 101, 2))
    end = Time(nanoseconds=START_NS + 100 * STEP_NS).to_msg()
    wait_for(lambda: clock[-1].clock == end, "the clock at the end")
    stamps_ns = [Time.from_msg(message.clock).nanoseconds for message in clock]
    assert stamps_ns == sorted(stamps_ns)
    assert stamps_ns[0] >= START_NS  # the recorded clock says 0
    assert len(clock) > 2  # best effort: some may be lost
    assert task(player).message == f"played 102 messages of {bag}"
    assert task(player).level == OK
    assert player.exit_code == 0


def test_subscriber_that_comes_late_is_waited_for(graph: Spinning, bag: Path):
    player = player_of(graph, bag, rate=20.0)
    assert player.bring_up()
    wait_for(lambda: "waiting for a subscriber" in task(player).message, "the waiting")
    assert "/ema/t1" in task(player).message
    heard = graph.listen(String, "t1", STREAM)
    assert player.finished.wait(DEADLINE_S)
    wait_for(lambda: len(heard) == 50, "all messages")


def test_only_what_an_actuator_sends_is_played_on_demand(graph: Spinning, tmp_path: Path):
    actuator: dict[str, type] = {
        "/ema/telemetry": TelemetryBlock,
        "/ema/actuator_description": ActuatorDescription,
        "/ema/simulated_faults": FaultVectorStamped,
        "/ema/joint_states": JointState,
    }
    monitor: dict[str, type] = {"/ema/health": Health, "/ema/header": Header}
    with BagWriter(tmp_path / "b") as writer:
        for name, kind in (actuator | monitor).items():
            writer.add_topic(name, kind, STREAM)
            writer.write(name, kind(), START_NS)
    player = player_of(graph, tmp_path / "b", actuator_only=True)
    assert player.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert set(player._outputs.publishers) == set(actuator)
    everything = player_of(graph, tmp_path / "b")
    assert everything.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert set(everything._outputs.publishers) == set(actuator | monitor)


def test_failure_while_playing_ends_the_player(graph: Spinning, bag: Path, monkeypatch: Any):
    player = player_of(graph, bag, wait_s=0.0)
    assert player.trigger_configure() == TransitionCallbackReturn.SUCCESS

    def publish(_: Recorded) -> None:
        raise RuntimeError("the middleware is gone")

    monkeypatch.setattr(player._playback, "_publish", publish)
    player.trigger_activate()
    assert player.finished.wait(DEADLINE_S)
    assert (task(player).level, player.exit_code) == (ERROR, 1)
    assert "the middleware is gone" in task(player).message


def test_recording_what_is_played_gives_the_same_messages(
    graph: Spinning, bag: Path, tmp_path: Path
):
    topics = ["/ema/latched", "/ema/t0", "/ema/t1"]
    player = player_of(graph, bag, rate=5.0, wait_s=8.0)
    assert player.trigger_configure() == TransitionCallbackReturn.SUCCESS
    recorder = graph.managed(RecorderNode, output=str(tmp_path / "again"), topics=topics)
    assert recorder.bring_up()
    wait_for(
        lambda: all(item.get_subscription_count() for item in player._outputs.publishers.values()),
        "the recorder",
    )
    player.trigger_activate()
    assert player.finished.wait(DEADLINE_S)
    wait_for(lambda: recorder._recorded.messages == 102, "all messages")
    recorder.trigger_shutdown()
    first, again = Bag(bag), Bag(tmp_path / "again")
    for topic in topics:
        assert [item.message for item in ros_messages(again, [topic])] == [
            item.message for item in ros_messages(first, [topic])
        ]
        assert again.topics[topic].type_hash == first.topics[topic].type_hash


def player_process(*parameters: str) -> subprocess.Popen[str]:
    options = [word for item in parameters for word in ("-p", item)]
    return subprocess.Popen(
        [sys.executable, "-m", "ema_bags.player_node", "--ros-args", *options],
        stderr=subprocess.PIPE,
        text=True,
    )


def test_what_cannot_be_played_is_one_clear_line(bag: Path):
    with player_process(f"bag:={bag}", "actuator_only:=true") as process:
        try:
            assert process.wait(timeout=DEADLINE_S) == 1
        finally:
            process.kill()
        assert process.stderr is not None
        (line,) = process.stderr.read().splitlines()
    assert f"{bag}: nothing to play: no message of an actuator" in line


def test_interrupted_player_does_not_wait_for_the_next_message(graph: Spinning, tmp_path: Path):
    with BagWriter(tmp_path / "slow.mcap") as writer:
        writer.add_topic("/ema/t0", String, STREAM)
        for hour in range(2):
            writer.write("/ema/t0", String(), START_NS + hour * 3600 * 10**9)
    heard = graph.listen(String, "t0", STREAM)
    with player_process(f"bag:={tmp_path / 'slow.mcap'}") as process:
        try:
            wait_for(lambda: heard, "the first message")
            process.send_signal(signal.SIGINT)
            assert process.wait(timeout=DEADLINE_S) == 0
        finally:
            process.kill()
