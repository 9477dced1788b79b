"""Requests of clients to a player: to pause, to seek, to play faster."""

import queue
import threading
from collections.abc import Callable
from typing import Any, Final

from foxglove.websocket import (
    PlaybackCommand,
    PlaybackControlRequest,
    PlaybackState,
    PlaybackStatus,
    ServerListener,
)
from rclpy.client import Client
from rclpy.node import Node
from std_srvs.srv import Trigger

from ema_core.steady_thread import SteadyThread
from ema_interfaces.msg import PlaybackState as PlayerState
from ema_interfaces.srv import SeekPlayback, SetPlaybackRate
from ema_ros.stamps import stamp_from_message, stamp_to_message

_ANSWER_S: Final = 10.0  # a seek reads the bag for what is latched
_TOLD_S: Final = 2.0
_MOST_WAITING: Final = 8

_STATUS: Final = {
    PlayerState.PLAYING: PlaybackStatus.Playing,
    PlayerState.PAUSED: PlaybackStatus.Paused,
    PlayerState.ENDED: PlaybackStatus.Ended,
}


class PlaybackControl(ServerListener):
    """Does with a player what clients ask for, one request after the other, in a thread of its own.

    It is the listener of the server of foxglove-sdk, whose threads must not wait for a player.

    Parameters
    ----------
    node
        Whose clients call the services of the player.
    broadcast
        Called with how the playback stands.
    on_failure
        Called as by ``SteadyThread`` when the thread has ended by itself.

    Attributes
    ----------
    thread
        The thread.
    """

    def __init__(
        self,
        node: Node,
        broadcast: Callable[[PlaybackState], None],
        on_failure: Callable[[str, str], object],
    ) -> None:
        self._node = node
        self._broadcast = broadcast
        self._player = ""
        self._clients: dict[str, Client] = {}
        self._state: PlayerState | None = None
        self._jumps = 0
        self._told = threading.Condition()
        self._requests: queue.Queue[PlaybackControlRequest | None] = queue.Queue(_MOST_WAITING)
        self.thread = SteadyThread("playback", self._work, on_failure)
        self.thread.start()

    def stop(self) -> None:
        """Ask no more of the player."""
        self.thread.ending.set()
        self._ask(None)
        self.thread.end(_ANSWER_S)
        self.set_player("")

    def set_player(self, player: str) -> None:
        """Set the full name of the node that plays; empty when there is none."""
        if player == self._player:
            return
        self._player = player
        clients, self._clients = self._clients, {}
        for client in clients.values():
            self._node.destroy_client(client)
        if player:
            kinds = {"pause": Trigger, "resume": Trigger}
            kinds |= {"set_rate": SetPlaybackRate, "seek": SeekPlayback}
            self._clients = {
                name: self._node.create_client(kind, f"{player}/{name}")
                for name, kind in kinds.items()
            }
        else:
            self._state = None

    def note_state(self, state: PlayerState) -> None:
        """Take how the player stands, and tell the clients."""
        with self._told:
            self._state = state
            self._jumps += state.jumped
            self._told.notify_all()
        self._broadcast(_playback_state(state, did_seek=state.jumped))

    def on_playback_control_request(self, playback_control_request: PlaybackControlRequest) -> None:
        """Take a request of a client; called by foxglove-sdk in threads of its own."""
        self._ask(playback_control_request)

    def _ask(self, request: PlaybackControlRequest | None) -> None:
        while True:
            try:
                self._requests.put_nowait(request)
                return
            except queue.Full:  # a slider that is drawn: where it was does not matter
                try:
                    self._requests.get_nowait()
                except queue.Empty:
                    continue

    def _work(self) -> None:
        while (request := self._requests.get()) is not None:
            with self._told:
                before, jumps = self._state, self._jumps
            if before is None:
                continue
            try:
                did_seek = self._obey(request, before)
                # The player answers and tells how it stands in two ways: the one may be quicker.
                with self._told:
                    self._told.wait_for(
                        lambda request=request, jumps=jumps + did_seek: self._is_done(
                            request, jumps
                        ),
                        _TOLD_S,
                    )
            except Exception as error:  # the player may go in the midst of a call
                self._node.get_logger().warning(f"the player does not do as asked: {error}")
                did_seek = False
            state = self._state or before
            self._broadcast(_playback_state(state, did_seek=did_seek, request=request.request_id))

    def _is_done(self, request: PlaybackControlRequest, jumps: int) -> bool:
        """Return whether the player stands as it was asked to, after so many jumps."""
        state = self._state
        if state is None:  # it has gone
            return True
        refused = PlayerState.PAUSED if _wants_to_play(request) else PlayerState.PLAYING
        return state.status != refused and _has_rate(request, state) and self._jumps >= jumps

    def _obey(self, request: PlaybackControlRequest, state: PlayerState) -> bool:
        """Do what is asked and not so already; return whether there was a seek."""
        # What is known of the state may be old: pausing twice does no harm, nor does going on.
        if not _wants_to_play(request):
            self._call("pause", Trigger.Request())
        if not _has_rate(request, state):
            self._call("set_rate", SetPlaybackRate.Request(rate=float(request.playback_speed)))
        if request.seek_time is not None:
            self._call("seek", SeekPlayback.Request(time=stamp_to_message(request.seek_time)))
        if _wants_to_play(request):
            self._call("resume", Trigger.Request())
        return request.seek_time is not None

    def _call(self, name: str, request: Any) -> None:
        """Call a service of the player.

        Raises
        ------
        ValueError
            When the player refuses; the message is its reason.
        TimeoutError
            When it does not answer.
        """
        client = self._clients.get(name)
        if client is None or not client.service_is_ready():
            raise ValueError(f"there is no service {self._player}/{name}")
        answered = threading.Event()
        future = client.call_async(request)
        future.add_done_callback(lambda _: answered.set())
        if not answered.wait(_ANSWER_S):
            client.remove_pending_request(future)
            raise TimeoutError(f"{self._player}/{name} has not answered for {_ANSWER_S:g} s")
        response: Any = future.result()
        if not response.success:
            raise ValueError(f"{name}: {response.message}")


def _wants_to_play(request: PlaybackControlRequest) -> bool:
    return request.playback_command == PlaybackCommand.Play


def _has_rate(request: PlaybackControlRequest, state: PlayerState) -> bool:
    # The protocol has single precision.
    return abs(request.playback_speed - state.rate) <= 1e-6 * state.rate


def _playback_state(state: PlayerState, *, did_seek: bool, request: str = "") -> PlaybackState:
    return PlaybackState(
        _STATUS[state.status],
        stamp_from_message(state.position),
        state.rate,
        did_seek,
        request or None,
    )
