# SPDX-License-Identifier: Apache-2.0
"""Connection of a dashboard client: its requests and outgoing message queue."""

import asyncio
import contextlib
import json
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Final

from aiohttp import WSCloseCode, WSMessage, WSMsgType
from aiohttp.web import WebSocketResponse

from ema_dashboard.hub import Hub, message_frame

SUBPROTOCOL: Final = "foxglove.sdk.v1"
MOST_REQUEST_BYTES: Final = 64 * 1024
"""Largest client message [B]; a larger message disconnects the client."""

_MOST_SUBSCRIPTIONS: Final = 1000
_REQUESTS_A_SECOND: Final = 50.0
_REQUESTS_AT_ONCE: Final = 200.0


class Client:
    """Connection to one client, using Foxglove's protocol in the hub's event loop.

    A client may subscribe, unsubscribe and control a playback, at a limited rate. Messages for a
    slow client are queued up to a limit; then the oldest messages are dropped, except messages of
    the protocol, which are necessary to read the rest. Kept messages of a channel are sent to a new
    subscriber one at a time, alternating with queued messages; they are read when they are sent,
    and are not queued.

    Parameters
    ----------
    hub
        Source of the messages.
    socket
        Connection to the client.
    control
        Called with a request for a playback; raises ValueError for an invalid request.
    most_bytes
        Largest size of the queue [B].

    Attributes
    ----------
    subscriptions
        Subscription numbers by channel.
    waiting_bytes
        Size of the queued messages [B].
    dropped
        Number of messages dropped because the client is slow.
    """

    def __init__(
        self, hub: Hub, socket: WebSocketResponse, control: Callable[[bytes], None], most_bytes: int
    ) -> None:
        self.subscriptions: dict[int, int] = {}
        self.dropped = 0
        self.waiting_bytes = 0
        self._hub = hub
        self._socket = socket
        self._control = control
        self._most_bytes = most_bytes
        self._protocol: deque[str | bytes] = deque()
        self._messages: deque[bytes] = deque()
        self._unsent: dict[int, deque[str]] = {}  # keys of kept messages, by channel
        self._filled = asyncio.Event()
        self._ended: asyncio.Future[tuple[int, bytes]] = asyncio.Future()
        self._allowance = _REQUESTS_AT_ONCE
        self._counted_s = time.monotonic()

    async def run(self) -> None:
        """Serve the client until either end closes the connection."""
        self._hub.join(self)
        tasks = [asyncio.ensure_future(self._receive()), asyncio.ensure_future(self._send())]
        code, reason = WSCloseCode.GOING_AWAY, b""
        try:
            done, _ = await asyncio.wait([*tasks, self._ended], return_when=asyncio.FIRST_COMPLETED)
            with contextlib.suppress(ConnectionError):
                code, reason = next(iter(done)).result()
        finally:
            self._hub.clients.discard(self)
            self._hub.totals.dropped += self.dropped
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            # The client may not answer.
            with contextlib.suppress(TimeoutError, ConnectionError):
                await asyncio.wait_for(self._socket.close(code=code, message=reason), 1.0)

    def take(self, frame: str | bytes, *, droppable: bool) -> None:
        """Queue a frame; droppable frames may be dropped in favour of later frames.

        If the queue exceeds its limit without droppable frames, the connection is closed.
        """
        if droppable and len(frame) > self._most_bytes:
            self.dropped += 1
            return
        if droppable and isinstance(frame, bytes):
            self._messages.append(frame)
        else:
            self._protocol.append(frame)
        self.waiting_bytes += len(frame)
        while self.waiting_bytes > self._most_bytes:
            if not self._messages:
                self.end(WSCloseCode.TRY_AGAIN_LATER, b"too slow")
                return
            self.waiting_bytes -= len(self._messages.popleft())
            self.dropped += 1
        self._filled.set()

    def send(self, content: dict[str, Any]) -> None:
        """Send a message of the protocol."""
        self.take(json.dumps(content), droppable=False)

    def end(self, code: int, reason: bytes) -> None:
        """Close the connection with a code and reason."""
        if not self._ended.done():
            self._ended.set_result((code, reason))

    async def _receive(self) -> tuple[int, bytes]:
        """Handle the client's requests. Return the close code and reason of the connection."""
        while True:
            message = await self._socket.receive()
            if message.type in (WSMsgType.CLOSE, WSMsgType.CLOSING, WSMsgType.CLOSED):
                return WSCloseCode.OK, b""
            if message.type is WSMsgType.ERROR:
                return WSCloseCode.PROTOCOL_ERROR, b""
            if not self._is_allowed():
                self._hub.totals.refused += 1
                return WSCloseCode.POLICY_VIOLATION, b"too many requests"
            if message.type is WSMsgType.PING:
                await self._socket.pong(message.data)
            elif message.type in (WSMsgType.TEXT, WSMsgType.BINARY):
                self._answer(message)

    def _is_allowed(self) -> bool:
        """Count a request. Return whether it is within the rate limit."""
        now_s = time.monotonic()
        earned = (now_s - self._counted_s) * _REQUESTS_A_SECOND
        self._allowance = min(self._allowance + earned, _REQUESTS_AT_ONCE) - 1.0
        self._counted_s = now_s
        return self._allowance >= 0.0

    def _answer(self, message: WSMessage) -> None:
        try:
            if message.type is WSMsgType.BINARY:
                self._control(message.data)
                return
            request = _request(message.data)
            if request["op"] == "subscribe":
                self._subscribe(request["subscriptions"])
            else:
                self._unsubscribe(request["subscriptionIds"])
        except ValueError as error:
            self._hub.totals.refused += 1
            self.send({"op": "status", "level": 2, "message": f"refused: {error}"})

    def _subscribe(self, items: list[dict[str, int]]) -> None:
        subscriptions = dict(self.subscriptions)
        for item in items:
            subscription, channel = item["id"], item["channelId"]
            if self._hub.kept(channel) is None:
                raise ValueError(f"channel {channel} does not exist")
            if channel in subscriptions or subscription in subscriptions.values():
                raise ValueError(f"channel {channel} or subscription {subscription} is in use")
            subscriptions[channel] = subscription
        # Subscribe before the kept messages are read, so that no message is missed in between.
        self.subscriptions = subscriptions
        for item in items:
            self._unsent[item["channelId"]] = deque(self._hub.kept(item["channelId"]) or ())
        self._filled.set()

    def _unsubscribe(self, numbers: list[int]) -> None:
        present = self.subscriptions.items()
        ended = [channel for channel, number in present if number in numbers]
        for channel in ended:
            self._unsent.pop(channel, None)
        self.subscriptions = {
            channel: number for channel, number in present if channel not in ended
        }

    async def _send(self) -> tuple[int, bytes]:
        while True:
            while self._protocol or self._messages or self._unsent:
                if self._protocol or self._messages:
                    frame = (self._protocol or self._messages).popleft()
                    self.waiting_bytes -= len(frame)
                    await self._pass_out(frame)
                if self._unsent:
                    await self._send_kept()
            self._filled.clear()
            await self._filled.wait()

    async def _send_kept(self) -> None:
        """Send the next kept message of new subscriptions in its current state."""
        channel, keys = next(iter(self._unsent.items()))
        if not keys:
            del self._unsent[channel]
            return
        message = (self._hub.kept(channel) or {}).get(keys.popleft())
        if message is None:
            return
        data = message.data
        if not isinstance(data, bytes):
            data = await asyncio.to_thread(data)
        # The client may have ended or replaced the subscription meanwhile.
        if self._unsent.get(channel) is keys:
            frame = message_frame(self.subscriptions[channel], message.log_time_ns, data)
            await self._pass_out(frame)

    async def _pass_out(self, frame: str | bytes) -> None:
        if isinstance(frame, str):
            await self._socket.send_str(frame)
        else:
            await self._socket.send_bytes(frame)
        self._hub.totals.messages += 1
        self._hub.totals.sent_bytes += len(frame)


def _request(data: str) -> Any:
    """Parse a client request. Raises ValueError if it is invalid or not supported."""
    try:
        request = json.loads(data)
    except RecursionError:
        raise ValueError("the JSON is nested too deeply") from None
    if not isinstance(request, dict):
        raise ValueError("expected a JSON object")
    if request.get("op") == "subscribe":
        items = request.get("subscriptions")
        numbers = [
            item.get(name) if isinstance(item, dict) else None
            for item in (items if isinstance(items, list) else [None])
            for name in ("id", "channelId")
        ]
    elif request.get("op") == "unsubscribe":
        numbers = request.get("subscriptionIds")
    else:
        raise ValueError(f"operation {str(request.get('op'))[:40]!r} is not supported")
    if not isinstance(numbers, list) or len(numbers) > 2 * _MOST_SUBSCRIPTIONS:
        raise ValueError(f"expected a list of at most {_MOST_SUBSCRIPTIONS} subscriptions")
    if not all(type(number) is int and 0 <= number < 2**32 for number in numbers):
        raise ValueError("expected subscription and channel numbers in [0, 2^32)")
    return request
