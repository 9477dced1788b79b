# SPDX-License-Identifier: Apache-2.0
"""A replay is controlled by its services, and by Foxglove through the dashboard."""

import queue
import struct
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from builtin_interfaces.msg import Time as TimeMessage
from rclpy.qos import QoSProfile, ReliabilityPolicy

from ema_bags.player_node import PlayerNode
from ema_bags.writer import BagWriter
from ema_dashboard.hub import Hub
from ema_dashboard.playback_control import PlaybackControl
from ema_interfaces.msg import Health, PlaybackState, TelemetryBlock
from ema_ros import topics
from ema_ros.stamps import stamp_from_message, stamp_to_message

from ...waiting import DEADLINE_S, wait_for
from ..playback_calls import ask, check_done, check_refused
from .client import Viewer
from .session import DashboardSession

START_NS = 1_700_000_000_000_000_000
STEP_NS = 10_000_000
LAST = 2000  # twenty seconds


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bag of numbered telemetry blocks, and healths of two actuators every 5 s."""
    path = tmp_path_factory.mktemp("bag") / "flight.mcap"
    with BagWriter(path) as writer:
        writer.add_topic("/ema/telemetry", TelemetryBlock, topics.STREAM)
        writer.add_topic("/ema/health", Health, topics.LATCHED)
        writer.add_topic("/ema/playback_state", PlaybackState, topics.LATCHED)
        writer.write("/ema/playback_state", PlaybackState(bag="another"), START_NS)
        for number in range(LAST + 1):
            at_ns = START_NS + number * STEP_NS
            writer.write("/ema/telemetry", TelemetryBlock(first_index=number), at_ns)
            if number % 500 == 0:
                writer.write("/ema/health", health("left", at_ns), at_ns)
            if number % 500 == 100:
                writer.write("/ema/health", health("right", at_ns), at_ns)
    return path


def health(actuator_id: str, stamp_ns: int) -> Health:
    message = Health(actuator_id=actuator_id)
    message.header.stamp = stamp_to_message(stamp_ns)
    return message


class Replay:
    """A player, and the messages received from it."""

    def __init__(self, session: DashboardSession, bag: Path, **parameters: Any) -> None:
        self.player: PlayerNode = session.managed(PlayerNode, bag=str(bag), **parameters)
        self.states: list[PlaybackState] = []
        self.indices: list[int] = []
        self.healths: list[Health] = []
        self.session = session
        listen = session.node("listener").create_subscription
        listen(PlaybackState, "playback_state", self.states.append, topics.LATCHED)
        listen(Health, "health", self.healths.append, topics.LATCHED_BY_MANY)
        # The depth covers the whole bag, so that a busy machine loses nothing.
        every = QoSProfile(depth=LAST + 1, reliability=ReliabilityPolicy.RELIABLE)
        listen(TelemetryBlock, "telemetry", self._note_block, every)
        assert self.player.bring_up()
        wait_for(lambda: len(self.indices) > 5, "the player to play")

    def _note_block(self, block: TelemetryBlock) -> None:
        self.indices.append(block.first_index)

    def call(self, name: str, **fields: Any) -> Any:
        return ask(self.session, name, **fields)

    def seek(self, seconds: float) -> Any:
        return self.call("seek", time=at(seconds))

    def wait_for_state(self, is_meant: Callable[[PlaybackState], bool]) -> PlaybackState:
        wait_for(lambda: self.states and is_meant(self.states[-1]), "a state of the playback")
        return self.states[-1]


def at(seconds: float) -> TimeMessage:
    return stamp_to_message(START_NS + round(seconds * 1e9))


def position_s(state: PlaybackState) -> float:
    return (stamp_from_message(state.position) - START_NS) / 1e9


def test_seek_publishes_latched_messages_of_the_new_time_and_continues(session, bag):
    replay = Replay(session, bag)
    check_done(replay.call("pause"))
    for seconds, latched in (
        (12.0, {("left", 10), ("right", 11)}),
        (5.5, {("left", 5), ("right", 1)}),
    ):
        replay.healths.clear()
        replay.states.clear()
        check_done(replay.seek(seconds))
        state = replay.wait_for_state(lambda state: state.status == PlaybackState.PAUSED)
        assert position_s(state) == seconds
        assert any(state.jumped for state in replay.states)
        wait_for(lambda: len(replay.healths) == 2, "what is latched")
        stamps = {(m.actuator_id, m.header.stamp.sec - START_NS // 10**9) for m in replay.healths}
        assert stamps == latched
        replay.indices.clear()
    check_done(replay.call("resume"))
    wait_for(lambda: len(replay.indices) > 20, "it to play on")
    assert replay.indices[:20] == list(range(550, 570))


def test_impossible_rates_and_times_are_refused(session, bag):
    replay = Replay(session, bag)
    for rate in (0.0, -1.0, 101.0, float("nan")):
        answer = replay.call("set_rate", rate=rate)
        check_refused(answer, "rate = ")
        assert replay.player._playback.rate == 1.0
    answer = replay.seek(30.0)
    check_refused(answer, f"is outside {bag}")


def test_player_that_stays_at_the_end_can_seek_back(session, bag):
    replay = Replay(session, bag, rate=100.0, stay=True)
    replay.wait_for_state(lambda state: state.status == PlaybackState.ENDED)
    wait_for(lambda: len(replay.indices) == LAST + 1, "all messages")  # late on a busy machine
    assert not replay.player.finished.is_set()
    check_refused(replay.call("resume"), "seek first")
    check_done(replay.seek(19.0))
    replay.indices.clear()
    check_done(replay.call("resume"))
    wait_for(lambda: len(replay.indices) == 101, "the last second again")
    assert replay.indices == list(range(1900, 2001))


def reconnected(session: DashboardSession, node: Any) -> Viewer:
    """Return a new client to which the server offers playback control."""

    def connect() -> Viewer | None:
        viewer = session.view(node)
        wait_for(lambda: viewer.reported or viewer.socket.closed, "the information of the server")
        offers = viewer.reported and "playbackControl" in viewer.reported[0]["capabilities"]
        return viewer if offers else None

    return wait_for(connect, "the control of a playback")


def reported(viewer: Viewer, request: str) -> dict[str, Any]:
    """Wait for the playback state that answers a request, and return it."""

    def answers() -> list[dict[str, Any]]:
        return [item for item in viewer.reported if item.get("request") == request]

    wait_for(answers, f"an answer to {request}")
    return answers()[-1]


def test_foxglove_controls_a_replay(session, bag):
    node = session.dashboard()
    before = session.view(node)
    replay = Replay(session, bag, stay=True)
    wait_for(lambda: before.socket.closed, "the server to start anew")  # clients then reconnect
    viewer = reconnected(session, node)
    information = viewer.reported[0]
    assert information["dataStartTime"] == {"sec": START_NS // 10**9, "nsec": 0}
    assert information["dataEndTime"] == {"sec": START_NS // 10**9 + 20, "nsec": 0}
    viewer.subscribe_to("/ema/telemetry", "/ema/health")

    viewer.control(play=False, request="pause")
    assert reported(viewer, "pause")["status"] == 1
    played = replay.player._playback.played
    viewer.control(play=False, speed=4.0, seek_ns=START_NS + 12 * 10**9, request="seek")
    answer = reported(viewer, "seek")
    assert (answer["status"], answer["speed"], answer["jumped"]) == (1, 4.0, True)
    assert answer["time_ns"] == START_NS + 12 * 10**9
    assert replay.player._playback.played == played
    assert replay.player._playback.rate == 4.0
    viewer.received.clear()
    viewer.control(play=True, speed=4.0, request="play")
    assert reported(viewer, "play")["status"] == 0
    wait_for(lambda: len(viewer.received["/ema/telemetry"]) > 10, "telemetry from there on")
    at_ns, block = viewer.received["/ema/telemetry"][0]
    assert block.first_index >= 1200
    # Log times are in the time of the bag, up to a step of the clock.
    assert abs(at_ns - (START_NS + block.first_index * STEP_NS)) < 10**9

    viewer.control(play=False, speed=4.0, seek_ns=START_NS + 2 * 10**9, request="back")
    reported(viewer, "back")
    late = reconnected(session, node)
    late.subscribe_to("/ema/health")
    stamps = {m.header.stamp.sec - START_NS // 10**9 for m in late.wait_for("/ema/health", 2)}
    assert stamps == {0, 1}  # nothing later than the new time


def test_request_that_the_player_refuses_is_answered_and_changes_nothing(session, bag):
    node = session.dashboard()
    replay = Replay(session, bag)
    viewer = reconnected(session, node)
    viewer.control(play=True, seek_ns=START_NS + 10**12, request="far")
    assert not reported(viewer, "far")["jumped"]
    viewer.control(play=True, speed=1e6, request="fast")
    assert reported(viewer, "fast")["speed"] == 1.0
    assert replay.player._playback.rate == 1.0


def test_answer_reports_the_state_of_the_player_after_the_request(session, monkeypatch):
    asked, frames = threading.Event(), queue.SimpleQueue()

    async def call(*_: object, **__: object) -> None:
        asked.set()

    def tell(_: Hub, frame: bytes) -> None:
        if frame.endswith(b"late"):
            frames.put(frame)

    monkeypatch.setattr(PlaybackControl, "_call", call)
    monkeypatch.setattr(Hub, "send_playback", tell)
    node = session.dashboard()
    control = node._playback
    control.note_state(PlaybackState(status=PlaybackState.PLAYING, rate=1.0, position=at(3.0)))
    fields = (3, 1, 2.0, 1, START_NS + 5 * 10**9, 4)
    node._hub.in_loop(control.ask, struct.pack("<BBfBQI", *fields) + b"late")
    # The services have answered; the states that show their effects follow late, one by one.
    assert asked.wait(DEADLINE_S)
    for rate, seconds in ((1.0, 3.0), (2.0, 3.0), (2.0, 5.0)):
        state = PlaybackState(status=PlaybackState.PAUSED, rate=rate, position=at(seconds))
        state.jumped = seconds == 5.0
        control.note_state(state)
    frame = frames.get(timeout=DEADLINE_S)
    assert struct.unpack_from("<BBQfBI", frame) == (5, 1, START_NS + 5 * 10**9, 2.0, 1, 4)


def test_player_with_an_unknown_name_is_awaited(
    session: DashboardSession, monkeypatch: pytest.MonkeyPatch
):
    """The middleware reports such a name until it has discovered the node of a publisher."""
    node = session.dashboard()
    players: list[str] = []
    unknown = SimpleNamespace(
        node_name="_NODE_NAME_UNKNOWN_", node_namespace="_NODE_NAMESPACE_UNKNOWN_"
    )
    named = SimpleNamespace(node_name="player", node_namespace="/ema")
    monkeypatch.setattr(node._playback, "set_player", players.append)
    for info in (unknown, named):
        monkeypatch.setattr(node, "get_publishers_info_by_topic", lambda _, info=info: [info])
        node._find_player()
    assert set(players) == {"/ema/player"}
