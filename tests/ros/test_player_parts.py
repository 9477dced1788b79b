"""Parts of a bag are played, again and again, and step by step."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from std_srvs.srv import Trigger

from ema_bags.player_node import PlayerNode
from ema_bags.writer import BagWriter
from ema_interfaces.msg import Health, PlaybackState, TelemetryBlock
from ema_interfaces.srv import BurstPlayback, GetPlaybackRate, IsPlaybackPaused
from ema_ros.stamps import stamp_from_message
from ema_ros.status import WARN
from ema_ros.topics import LATCHED_BY_MANY

from ..waiting import DEADLINE_S, wait_for
from .spinning import Spinning
from .test_player_node import (
    BEST_EFFORT,
    LATCHED,
    START_NS,
    STEP_NS,
    STREAM,
    bag,  # noqa: F401  a fixture
    player_of,
    task,
    texts,
)


def numbers(heard: list[list[Any]]) -> list[int]:
    return sorted(texts(heard[0]) + texts(heard[1]))


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        ({"start_offset": 0.5, "playback_duration": 0.25}, range(50, 76)),
        ({"start_offset": 1.0, "topics": ["t0", "latched"]}, range(100, 101)),
    ],
)
def test_a_part_of_a_bag_is_played(graph: Spinning, bag: Path, part: dict, expected: range):  # noqa: F811
    heard = [graph.listen(String, f"t{number}", STREAM) for number in range(2)]
    latched = graph.listen(String, "latched", LATCHED)
    player = player_of(graph, bag, rate=10.0, **part)
    assert player.bring_up()
    assert player.finished.wait(DEADLINE_S)
    wait_for(lambda: len(heard[0]) + len(heard[1]) == len(expected), "all messages")
    assert numbers(heard) == list(expected)
    # What holds at the beginning is published before it.
    wait_for(lambda: latched, "the latched message")
    assert [message.data for message in latched] == ["latched"]


@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        ({"start_offset": 1.5}, "start_offset = 1.5 s is beyond the end of"),
        ({"topics": ["t3"]}, "unknown topic '/ema/t3'"),
        (
            {"topics": ["latched"], "start_offset": 0.5},
            "there is no message to play from 0.5 s to 1.000 s",
        ),
    ],
)
def test_part_that_is_not_there_is_refused(
    graph: Spinning,
    bag: Path,  # noqa: F811
    parameters: dict,
    told: str,
):
    player = player_of(graph, bag, **parameters)
    assert player.trigger_configure() == TransitionCallbackReturn.FAILURE
    assert told in player._refused


def test_a_loop_begins_again_as_after_a_seek(graph: Spinning, bag: Path):  # noqa: F811
    heard = graph.listen(String, "t0", STREAM)
    clock = graph.listen(Clock, "/clock", BEST_EFFORT)
    states = graph.listen(PlaybackState, "playback_state", LATCHED_BY_MANY)
    latched = graph.listen(String, "latched", LATCHED)
    player = player_of(graph, bag, rate=10.0, loop=True, start_offset=0.5)
    assert player.bring_up()
    wait_for(lambda: len(heard) > 2 * 26, "a third pass")
    player.trigger_deactivate()
    assert not player.finished.is_set()
    one = list(range(50, 101, 2))
    assert texts(heard)[: 2 * 26] == one * 2
    assert int(task(player).values["pass"]) >= 3
    wait_for(lambda: [state.jumped for state in states].count(True) >= 2, "the jumps")
    at = [stamp_from_message(state.position) for state in states if state.jumped]
    assert set(at) == {START_NS + 50 * STEP_NS}
    stamps = [stamp_from_message(message.clock) for message in clock]
    assert any(after < before for before, after in pairwise(stamps))
    wait_for(lambda: len(latched) >= 3, "what is latched, in each pass")


def call(graph: Spinning, player: PlayerNode, kind: Any, name: str, **fields: Any) -> Any:
    node = graph.node(f"client_{len(graph.nodes)}")
    client = node.create_client(kind, f"{player.get_name()}/{name}")
    assert client.wait_for_service(DEADLINE_S)
    future = client.call_async(kind.Request(**fields))
    wait_for(future.done, "the answer")
    return future.result()


def test_paused_playback_goes_on_step_by_step(graph: Spinning, bag: Path):  # noqa: F811
    heard = [graph.listen(String, f"t{number}", STREAM) for number in range(2)]
    player = player_of(graph, bag, start_paused=True, rate=20.0)
    assert player.bring_up()
    wait_for(lambda: not player._outputs.missing(), "the listeners")

    def ask(kind: Any, name: str, **fields: Any) -> Any:
        return call(graph, player, kind, name, **fields)

    assert ask(IsPlaybackPaused, "is_paused").paused
    assert ask(GetPlaybackRate, "get_rate").rate == 20.0
    assert ask(Trigger, "play_next").success  # it is the latched message
    assert ask(Trigger, "play_next").success
    wait_for(lambda: numbers(heard) == [0], "a message")
    answer = ask(BurstPlayback, "burst", num_messages=10)
    assert (answer.success, answer.actually_burst) == (True, 10)
    wait_for(lambda: numbers(heard) == list(range(11)), "the messages")
    answer = ask(BurstPlayback, "burst", num_messages=0)
    assert (answer.success, answer.message) == (False, "num_messages = 0: expected at least 1")
    assert ask(Trigger, "toggle_paused").success
    assert not ask(IsPlaybackPaused, "is_paused").paused or player.finished.is_set()
    assert player.finished.wait(DEADLINE_S)
    wait_for(lambda: len(heard[0]) + len(heard[1]) == 101, "the rest")
    assert ask(Trigger, "play_next").message == "the player has ended"


def test_steps_end_at_the_end_and_are_refused_while_it_plays(graph: Spinning, bag: Path):  # noqa: F811
    player = player_of(graph, bag, rate=0.01, wait_s=0.0)
    assert player.bring_up()
    answer = call(graph, player, Trigger, "play_next")
    assert (answer.success, answer.message) == (False, "the player plays: pause it first")
    assert call(graph, player, Trigger, "toggle_paused").success
    before = player._playback.played
    answer = call(graph, player, BurstPlayback, "burst", num_messages=10**12)
    assert (answer.success, answer.actually_burst) == (True, 102 - before)
    answer = call(graph, player, Trigger, "play_next")
    assert answer.message == f"{bag} is at its end: seek first"


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


def test_what_cannot_be_played_is_left_out_and_named(graph: Spinning, tmp_path: Path):
    path, time_ns = tmp_path / "odd.mcap", START_NS
    with BagWriter(path) as writer:
        for name in ("/ema/t0", "/ema/a b", "/rosout"):
            writer.add_topic(name, String, STREAM)
        for number in range(4):
            for name in ("/ema/t0", "/ema/a b", "/rosout"):
                time_ns = START_NS + number * STEP_NS
                writer.write(name, String(data=str(number)), time_ns, time_ns)
        # Cut off within its text.
        writer.write_serialized("/ema/t0", b"\0\1\0\0\x09\0\0\0ab", time_ns + STEP_NS)
    heard = graph.listen(String, "t0", STREAM)
    player = player_of(graph, path, rate=10.0, stay=True)
    assert player.bring_up()
    wait_for(lambda: len(heard) == 4, "the good messages")
    wait_for(lambda: task(player).values["skipped"] == 1, "the malformed message is counted")
    said = task(player)
    assert said.level == WARN
    for expected in (
        "/ema/a b: not played",
        "/rosout: not played",
        "topic /ema/t0: 1 malformed message",
    ):
        assert expected in said.message
