# SPDX-License-Identifier: Apache-2.0
"""The player publishes a bag as recorded: whole, in parts, in a loop and step by step."""

import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from std_srvs.srv import Empty

from ema_bags import player_node
from ema_bags.playback_services import PLAYBACK_SERVICES
from ema_bags.player_node import PlayerNode
from ema_bags.recording import Recorded
from ema_bags.writer import BagWriter
from ema_interfaces.msg import (
    ActuatorDescription,
    FaultVectorStamped,
    Health,
    PlaybackState,
    TelemetryBlock,
)
from ema_ros.stamps import stamp_from_message
from ema_ros.status import ERROR, OK, WARN, Task
from ema_ros.topics import LATCHED_BY_MANY

from ..waiting import DEADLINE_S, wait_for
from .playback_calls import ask, check_done, check_refused
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
    """Bag with a latched text, a clock, and one second of numbered texts on two topics in turn."""
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


def texts(received: list[Any]) -> list[int]:
    return [int(message.data) for message in received]


def test_bag_is_played_in_order_with_its_clock(graph: Spinning, bag: Path):
    received = [graph.listen(String, f"t{number}", STREAM) for number in range(2)]
    clock = graph.listen(Clock, "/clock", BEST_EFFORT)
    player = player_of(graph, bag, rate=5.0)
    assert player.bring_up()
    assert player.finished.wait(DEADLINE_S)
    wait_for(lambda: len(received[0]) + len(received[1]) == 101, "all messages")
    assert texts(received[0]) == list(range(0, 101, 2))
    assert texts(received[1]) == list(range(1, 101, 2))
    end = Time(nanoseconds=START_NS + 100 * STEP_NS).to_msg()
    wait_for(lambda: clock[-1].clock == end, "the clock at the end")
    stamps_ns = [Time.from_msg(message.clock).nanoseconds for message in clock]
    assert stamps_ns == sorted(stamps_ns)
    assert stamps_ns[0] >= START_NS  # the recorded clock has 0
    assert len(clock) > 2  # best effort: some may be lost
    assert task(player).message == f"played 102 messages from {bag}"
    assert task(player).level == OK
    assert player.exit_code == 0


def test_player_waits_for_a_late_subscriber(graph: Spinning, bag: Path):
    player = player_of(graph, bag, rate=20.0)
    assert player.bring_up()
    wait_for(lambda: "waiting for a subscriber" in task(player).message, "the waiting")
    assert "/ema/t1" in task(player).message
    received = graph.listen(String, "t1", STREAM)
    assert player.finished.wait(DEADLINE_S)
    wait_for(lambda: len(received) == 50, "all messages")


def test_actuator_only_plays_messages_of_the_actuator_only(graph: Spinning, tmp_path: Path):
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


def test_player_ends_without_waiting_for_the_next_message(graph: Spinning, tmp_path: Path):
    with BagWriter(tmp_path / "slow.mcap") as writer:
        writer.add_topic("/ema/t0", String, STREAM)
        for hour in range(2):
            writer.write("/ema/t0", String(), START_NS + hour * 3600 * 10**9)
    received = graph.listen(String, "t0", STREAM)
    player = player_of(graph, tmp_path / "slow.mcap")
    assert player.bring_up()
    wait_for(lambda: received, "the first message")
    assert player.trigger_shutdown() == TransitionCallbackReturn.SUCCESS
    assert (len(received), player.exit_code) == (1, 0)


def numbers(received: list[list[Any]]) -> list[int]:
    return sorted(texts(received[0]) + texts(received[1]))


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        ({"start_offset": 0.5, "playback_duration": 0.25}, range(50, 76)),
        ({"start_offset": 1.0, "topics": ["t0", "latched"]}, range(100, 101)),
    ],
)
def test_a_part_of_a_bag_is_played(graph: Spinning, bag: Path, part: dict, expected: range):
    received = [graph.listen(String, f"t{number}", STREAM) for number in range(2)]
    latched = graph.listen(String, "latched", LATCHED)
    player = player_of(graph, bag, rate=10.0, **part)
    assert player.bring_up()
    assert player.finished.wait(DEADLINE_S)
    wait_for(lambda: len(received[0]) + len(received[1]) == len(expected), "all messages")
    assert numbers(received) == list(expected)
    # The message that is latched at the beginning is published before the part.
    wait_for(lambda: latched, "the latched message")
    assert [message.data for message in latched] == ["latched"]


@pytest.mark.parametrize(
    ("parameters", "reported"),
    [
        ({"actuator_only": True}, "flight.mcap: nothing to play: it has no actuator messages"),
        ({"start_offset": 1.5}, "start_offset = 1.5 s is after the end of"),
        ({"topics": ["latchd"]}, "did you mean '/ema/latched'"),
        ({"topics": ["latched"], "start_offset": 0.5}, "no message to play from 0.5 s to 1.000 s"),
    ],
)
def test_missing_part_is_refused(graph: Spinning, bag: Path, parameters: dict, reported: str):
    player = player_of(graph, bag, **parameters)
    assert player.trigger_configure() == TransitionCallbackReturn.FAILURE
    assert reported in player._refused


def test_each_pass_of_a_loop_begins_like_a_seek(graph: Spinning, bag: Path):
    received = graph.listen(String, "t0", STREAM)
    clock = graph.listen(Clock, "/clock", BEST_EFFORT)
    states = graph.listen(PlaybackState, "playback_state", LATCHED_BY_MANY)
    latched = graph.listen(String, "latched", LATCHED)
    player = player_of(graph, bag, rate=10.0, loop=True, start_offset=0.5)
    assert player.bring_up()
    wait_for(lambda: len(received) > 2 * 26, "a third pass")
    player.trigger_deactivate()
    assert not player.finished.is_set()
    cycle = list(range(50, 101, 2))
    assert texts(received)[: 2 * 26] == cycle * 2
    assert int(task(player).values["pass"]) >= 3
    wait_for(lambda: [state.jumped for state in states].count(True) >= 2, "the jumps")
    at = [stamp_from_message(state.position) for state in states if state.jumped]
    assert set(at) == {START_NS + 50 * STEP_NS}
    stamps = [stamp_from_message(message.clock) for message in clock]
    assert any(after < before for before, after in pairwise(stamps))
    wait_for(lambda: len(latched) >= 3, "what is latched, in each pass")


def test_paused_playback_continues_step_by_step(graph: Spinning, bag: Path):
    received = [graph.listen(String, f"t{number}", STREAM) for number in range(2)]
    player = player_of(graph, bag, start_paused=True, rate=20.0)
    assert player.bring_up()
    wait_for(lambda: not player._outputs.missing(), "the listeners")

    assert ask(graph, "is_paused").paused
    assert ask(graph, "get_rate").rate == 20.0
    check_done(ask(graph, "play_next"))  # it is the latched message
    check_done(ask(graph, "play_next"))
    wait_for(lambda: numbers(received) == [0], "a message")
    answer = ask(graph, "burst", num_messages=10)
    check_done(answer)
    assert answer.actually_burst == 10
    wait_for(lambda: numbers(received) == list(range(11)), "the messages")
    check_done(ask(graph, "toggle_paused"))
    assert not ask(graph, "is_paused").paused or player.finished.is_set()
    assert player.finished.wait(DEADLINE_S)
    wait_for(lambda: len(received[0]) + len(received[1]) == 101, "the rest")
    check_refused(ask(graph, "play_next"), "the player has ended")


def test_steps_end_with_the_bag_and_are_refused_during_playback(graph: Spinning, bag: Path):
    player = player_of(graph, bag, rate=0.01, wait_s=0.0)
    assert player.bring_up()
    check_refused(ask(graph, "play_next"), "the player is playing: pause it first")
    check_done(ask(graph, "toggle_paused"))
    before = player._playback.played
    answer = ask(graph, "burst", num_messages=0)
    check_done(answer)
    assert answer.actually_burst == 102 - before
    for name, fields in (("burst", {"num_messages": 10**12}), ("play_next", {})):
        check_refused(ask(graph, name, **fields), f"{bag} is at its end: seek first")


ROSBAG2_FIELDS = {
    "burst": ({"num_messages": "uint64"}, {"actually_burst": "uint64"}),
    "get_rate": ({}, {"rate": "double"}),
    "is_paused": ({}, {"paused": "boolean"}),
    "pause": ({}, {}),
    "play_next": ({}, {"success": "boolean"}),
    "resume": ({}, {}),
    "seek": ({"time": "builtin_interfaces/Time"}, {"success": "boolean"}),
    "set_rate": ({"rate": "double"}, {"success": "boolean"}),
    "toggle_paused": ({}, {}),
}
"""Fields of request and response of each service of rosbag2's player in Jazzy."""


def test_services_have_the_fields_of_rosbag2_and_the_reason_of_a_refusal():
    assert PLAYBACK_SERVICES.keys() == ROSBAG2_FIELDS.keys()
    is_rosbag2 = PLAYBACK_SERVICES["seek"].__module__.startswith("rosbag2_interfaces")
    refusal = {} if is_rosbag2 else {"success": "boolean", "message": "string"}
    for name, (request, response) in ROSBAG2_FIELDS.items():
        kind = PLAYBACK_SERVICES[name]
        assert kind.Request.get_fields_and_field_types() == request, name
        fields = kind.Response.get_fields_and_field_types()
        reasons = {} if name in ("get_rate", "is_paused") else refusal
        assert fields == response | reasons, name


def test_player_and_dashboard_have_the_types_of_rosbag2_where_they_are_installed(tmp_path: Path):
    names = ["".join(map(str.capitalize, name.split("_"))) for name in ROSBAG2_FIELDS]
    package = tmp_path / "rosbag2_interfaces"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "srv.py").write_text("".join(f"class {name}: pass\n" for name in names))
    program = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n"
        "from ema_bags import player_node\n"
        "from ema_dashboard import playback_control\n"
        "for module in (player_node, playback_control):\n"
        "    for kind in module.PLAYBACK_SERVICES.values():\n"
        "        print(kind.__module__, kind.__name__)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    expected = [f"rosbag2_interfaces.srv {name}" for name in names]
    assert sorted(done.stdout.splitlines()) == sorted(2 * expected)


def test_refusal_without_a_field_for_it_is_answered_and_logged(
    graph: Spinning, bag: Path, monkeypatch: pytest.MonkeyPatch
):
    """The service type ``Pause`` of rosbag2 has no fields."""
    monkeypatch.setitem(player_node.PLAYBACK_SERVICES, "pause", Empty)
    player = player_of(graph, bag)
    assert player.trigger_configure() == TransitionCallbackReturn.SUCCESS
    logged: list[str] = []
    monkeypatch.setattr(player, "get_logger", lambda: SimpleNamespace(warning=logged.append))
    assert graph.call(Empty, "player/pause") == Empty.Response()
    assert logged == ["pause refused: the player is inactive: expected active"]


def test_monitor_that_does_not_follow_the_clock_is_named(graph: Spinning, tmp_path: Path):
    with BagWriter(tmp_path / "b") as writer:
        writer.add_topic("/ema/telemetry", TelemetryBlock, STREAM)
        writer.write("/ema/telemetry", TelemetryBlock(), START_NS)
    for name, follows in (("monitor", False), ("monitor_2", True)):
        node = graph.node(name)
        node.create_subscription(TelemetryBlock, "telemetry", lambda _: None, STREAM)
        node.create_publisher(Health, f"{name}/health", LATCHED)
        node.set_parameters([Parameter("use_sim_time", value=follows)])
    player = player_of(graph, tmp_path / "b", start_paused=True)
    assert player.bring_up()
    wait_for(lambda: task(player).level == WARN, "the warning")
    assert "/ema/monitor does not follow /clock" in task(player).message
    wait_for(lambda: "monitor_2" not in task(player).message, "the other one's /clock")


def test_unplayable_messages_are_skipped_and_named(graph: Spinning, tmp_path: Path):
    path, time_ns = tmp_path / "odd.mcap", START_NS
    with BagWriter(path) as writer:
        for name in ("/ema/t0", "/ema/a b", "/rosout"):
            writer.add_topic(name, String, STREAM)
        for number in range(4):
            for name in ("/ema/t0", "/ema/a b", "/rosout"):
                time_ns = START_NS + number * STEP_NS
                writer.write(name, String(data=str(number)), time_ns, time_ns)
        # A message that is cut off within its text.
        writer.write_serialized("/ema/t0", b"\0\1\0\0\x09\0\0\0ab", time_ns + STEP_NS)
    received = graph.listen(String, "t0", STREAM)
    player = player_of(graph, path, rate=10.0, stay=True)
    assert player.bring_up()
    wait_for(lambda: len(received) == 4, "the good messages")
    wait_for(lambda: task(player).values["skipped"] == 1, "the malformed message is counted")
    printed = task(player)
    assert printed.level == WARN
    for expected in (
        "/ema/a b: not played",
        "/rosout: not played",
        "topic /ema/t0: 1 malformed message",
    ):
        assert expected in printed.message
