# SPDX-License-Identifier: Apache-2.0
"""Playback control by clients: pause, seek and rate."""

import asyncio
import struct
from collections import deque
from typing import Any, Final, NamedTuple

from rclpy.client import Client
from rclpy.node import Node

from ema_bags.playback_services import PLAYBACK_SERVICES
from ema_dashboard.hub import Hub
from ema_dashboard.service_call import call
from ema_interfaces.msg import PlaybackState
from ema_ros.stamps import stamp_from_message, stamp_to_message

_CONFIRMED_S: Final = 2.0
_MOST_WAITING: Final = 8
_REQUEST: Final = struct.Struct("<BBfBQI")
_MOST_BYTES: Final = 512
_PAUSE: Final = 1
_CALLED: Final = ("pause", "resume", "seek", "set_rate")
# Status codes of the protocol, which has 2 for a player that waits for data.
_STATUS: Final = {PlaybackState.PLAYING: 0, PlaybackState.PAUSED: 1, PlaybackState.ENDED: 3}


class Request(NamedTuple):
    """A client's playback request."""

    plays: bool
    """Whether to play or to pause."""
    rate: float
    """Ratio of playback speed to recorded speed [-]."""
    seek_ns: int | None
    """Time to seek [ns]; None to continue."""
    name: bytes
    """Name that identifies the request in its acknowledgement."""


class PlaybackControl:
    """Forwards client requests to a player one at a time, in the hub's event loop."""

    def __init__(self, node: Node, hub: Hub) -> None:
        self._node = node
        self._hub = hub
        self._player = ""
        self._clients: dict[str, Client] = {}
        self._state: PlaybackState | None = None
        self._jumps = 0
        self._state_changed = asyncio.Event()
        # Older positions of a slider are irrelevant.
        self._requests: deque[Request] = deque(maxlen=_MOST_WAITING)
        self._work: asyncio.Task[None] | None = None

    def set_player(self, player: str) -> None:
        """Set the full name of the player node; an empty name means that there is no player."""
        if player == self._player:
            return
        self._player = player
        clients, self._clients = self._clients, {}
        for client in clients.values():
            self._node.destroy_client(client)
        if player:
            self._clients = {
                name: self._node.create_client(PLAYBACK_SERVICES[name], f"{player}/{name}")
                for name in _CALLED
            }
        else:
            self._state = None

    def note_state(self, state: PlaybackState) -> None:
        """Store the state of the player, and send it to the clients."""
        self._state = state
        self._jumps += state.jumped
        self._hub.in_loop(self._state_changed.set)
        self._hub.send_playback(_frame(state, did_seek=state.jumped))

    def ask(self, data: bytes) -> None:
        """Queue a playback request of a client, encoded by Foxglove's protocol.

        Call it only in the hub's event loop. If eight requests wait, the oldest is dropped.

        Raises
        ------
        ValueError
            If the message is not a playback request, or there is no playback.
        """
        if data[:1] != b"\3" or not _REQUEST.size <= len(data) <= _MOST_BYTES:
            raise ValueError("expected a binary playback control request")
        if self._state is None:
            raise ValueError("there is no playback to control")
        _, command, rate, seeks, seek_ns, _ = _REQUEST.unpack_from(data)
        name = data[_REQUEST.size :]
        self._requests.append(Request(command != _PAUSE, rate, seek_ns if seeks else None, name))
        if self._work is None or self._work.done():
            self._work = self._hub.loop.create_task(self._obey_all())

    async def _obey_all(self) -> None:
        while self._requests:
            request, before, jumps = self._requests.popleft(), self._state, self._jumps
            if before is None:
                continue
            did_seek = False
            try:
                await self._obey(request, before)
                did_seek = request.seek_ns is not None
                # The player sends its answer and its state separately: either may arrive first.
                async with asyncio.timeout(_CONFIRMED_S):
                    while not self._is_done(request, jumps + did_seek):
                        self._state_changed.clear()
                        await self._state_changed.wait()
            except TimeoutError:
                pass
            except Exception as error:  # the player may end during a call
                self._node.get_logger().warning(f"the player did not execute a request: {error}")
            state = self._state or before
            self._hub.send_playback(_frame(state, did_seek=did_seek, request=request.name))

    def _is_done(self, request: Request, jumps: int) -> bool:
        """Return whether the player has reached the requested state, or has ended.

        A state counts only after ``jumps`` jumps in time in total.
        """
        state = self._state
        if state is None:  # the player has ended
            return True
        refused = PlaybackState.PAUSED if request.plays else PlaybackState.PLAYING
        return state.status != refused and _has_rate(request, state) and self._jumps >= jumps

    async def _obey(self, request: Request, state: PlaybackState) -> None:
        """Call the services that bring the player to the requested state.

        The rate is set only if it differs from the rate in ``state``.
        """
        # The state may be outdated; pausing or resuming twice is harmless.
        if not request.plays:
            await self._call("pause")
        if not _has_rate(request, state):
            await self._call("set_rate", rate=request.rate)
        if request.seek_ns is not None:
            await self._call("seek", time=stamp_to_message(request.seek_ns))
        if request.plays:
            await self._call("resume")

    async def _call(self, name: str, **fields: Any) -> None:
        request = PLAYBACK_SERVICES[name].Request(**fields)
        await call(self._hub, self._clients.get(name), f"{self._player}/{name}", request)


def _has_rate(request: Request, state: PlaybackState) -> bool:
    # The protocol has single precision.
    return abs(request.rate - state.rate) <= 1e-6 * state.rate


def _frame(state: PlaybackState, *, did_seek: bool, request: bytes = b"") -> bytes:
    """Return the playback state encoded for the protocol."""
    fields = (_STATUS[state.status], stamp_from_message(state.position), state.rate, did_seek)
    return struct.pack("<BBQfBI", 5, *fields, len(request)) + request
