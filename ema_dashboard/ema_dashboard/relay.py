"""A client of the dashboard: what it is sent, and what it may ask for."""

import asyncio
import contextlib
import json
import struct
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from aiohttp import ClientWebSocketResponse, WSCloseCode, WSMessage, WSMsgType
from aiohttp.web import WebSocketResponse

from ema_dashboard.channels import KeptMessage
from ema_dashboard.outbox import Outbox, OverflowingError

SUBPROTOCOL: Final = "foxglove.sdk.v1"
MOST_REQUEST_BYTES: Final = 64 * 1024
"""Size of a client's message beyond which it is disconnected [B]."""

_MOST_SUBSCRIPTIONS: Final = 1000
_REQUESTS_A_SECOND: Final = 50.0
_REQUESTS_AT_ONCE: Final = 200.0
_MESSAGE: Final = 1  # opcodes of binary frames: of the server
_PLAYBACK: Final = 3  # of a client
_MOST_PLAYBACK_BYTES: Final = 512

Kept = Callable[[int], Mapping[str, KeptMessage] | None]
"""What a new subscriber of a channel gets, by its keys; None if the channel is unknown."""


@dataclass
class Totals:
    """What all clients together were sent since the dashboard came up."""

    messages: int = 0
    sent_bytes: int = 0
    dropped: int = 0
    refused: int = 0


class Relay:
    """Passes frames between a client and the server of foxglove-sdk.

    The server sends to it as fast as it can; what the client does not take in time waits here,
    bounded. A client may subscribe, unsubscribe and control a playback, at a bounded rate, and
    nothing else. What is kept of a channel is sent to a new subscriber alone: one at a time,
    as the client takes it, in turn with what waits. It is looked up when its turn comes, so that
    nothing of it waits here and it is never older than what the client got before; and not before
    the server has registered the subscription, so that nothing is missed in between.

    Parameters
    ----------
    outer, inner
        Connections to the client and to the server.
    """

    def __init__(
        self,
        outer: WebSocketResponse,
        inner: ClientWebSocketResponse,
        kept: Kept,
        most_bytes: int,
        totals: Totals,
    ) -> None:
        self._outer = outer
        self._inner = inner
        self._kept = kept
        self._totals = totals
        self._outbox = Outbox(most_bytes)
        self._subscriptions: dict[int, int] = {}  # channel by subscription
        self._unsent: dict[int, deque[str]] = {}  # keys of what is kept, by subscription
        # Subscriptions that the server may not have registered yet, each after a ping of its own.
        self._unregistered: dict[bytes, Sequence[dict[str, int]]] = {}
        self._pings = 0
        self._begun = asyncio.Event()
        self._turn = asyncio.Lock()
        self._allowance = _REQUESTS_AT_ONCE
        self._counted_s = time.monotonic()

    @property
    def dropped(self) -> int:
        """Number of messages that were dropped because the client is slow."""
        return self._outbox.dropped

    @property
    def waiting_bytes(self) -> int:
        """How much waits for the client [B]."""
        return self._outbox.waiting_bytes

    async def run(self) -> None:
        """Pass frames until one of both ends has closed; then both are closed."""
        tasks = [
            asyncio.ensure_future(step())
            for step in (self._receive, self._collect, self._send, self._send_kept)
        ]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            code, words = next(iter(done)).result()
        except ConnectionError:
            code, words = WSCloseCode.GOING_AWAY, b""
        except OverflowingError:
            code, words = WSCloseCode.TRY_AGAIN_LATER, b"too slow"
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            self._totals.dropped += self._outbox.dropped
            await self._inner.close()
        await self.close(code, words)

    async def close(self, code: int, words: bytes) -> None:
        """Close the connection to the client, which may not listen any more."""
        with contextlib.suppress(TimeoutError, ConnectionError):
            await asyncio.wait_for(self._outer.close(code=code, message=words), 1.0)

    async def _receive(self) -> tuple[int, bytes]:
        """Pass on what the client asks for; return why that ended."""
        while True:
            message = await self._outer.receive()
            if message.type in (WSMsgType.CLOSE, WSMsgType.CLOSING, WSMsgType.CLOSED):
                return WSCloseCode.OK, b""
            if message.type is WSMsgType.ERROR:
                return WSCloseCode.PROTOCOL_ERROR, b""
            if not self._is_allowed():
                self._totals.refused += 1
                return WSCloseCode.POLICY_VIOLATION, b"too many requests"
            if message.type is WSMsgType.PING:
                await self._outer.pong(message.data)
            elif message.type in (WSMsgType.TEXT, WSMsgType.BINARY):
                await self._answer(message)

    def _is_allowed(self) -> bool:
        """Count a request; return whether it is within the rate."""
        now_s = time.monotonic()
        earned = (now_s - self._counted_s) * _REQUESTS_A_SECOND
        self._allowance = min(self._allowance + earned, _REQUESTS_AT_ONCE) - 1.0
        self._counted_s = now_s
        return self._allowance >= 0.0

    async def _answer(self, message: WSMessage) -> None:
        try:
            if message.type is WSMsgType.BINARY:
                _check_playback(message.data)
                await self._inner.send_bytes(message.data)
                return
            request = _request(message.data)
            if request["op"] == "subscribe":
                await self._begin(request["subscriptions"])
                return
        except ValueError as error:
            self._totals.refused += 1
            status = {"op": "status", "level": 2, "message": f"refused: {error}"}
            self._outbox.put(json.dumps(status), droppable=True)
            return
        asked = dict.fromkeys(request["subscriptionIds"])
        known = [number for number in asked if number in self._subscriptions]
        for number in known:
            self._subscriptions.pop(number, None)
            self._unsent.pop(number, None)
        # Written anew: nothing that a client says reaches the server as it is.
        await self._inner.send_str(json.dumps({"op": "unsubscribe", "subscriptionIds": known}))

    async def _begin(self, items: Sequence[dict[str, int]]) -> None:
        """Subscribe; what is kept of the channels follows when the server has registered that.

        Raises
        ------
        ValueError
            When one of the channels is unknown or is subscribed to already.
        """
        known = dict(self._subscriptions)
        for item in items:
            subscription, channel = item["id"], item["channelId"]
            if self._kept(channel) is None:
                raise ValueError(f"there is no channel {channel}")
            if subscription in known or channel in known.values():
                raise ValueError(f"channel {channel} or subscription {subscription} is in use")
            known[subscription] = channel
        self._subscriptions = known
        items = [{name: item[name] for name in ("id", "channelId")} for item in items]
        self._pings += 1
        number = str(self._pings).encode()
        self._unregistered[number] = items
        await self._inner.send_str(json.dumps({"op": "subscribe", "subscriptions": items}))
        # The server does one thing after the other: once it answers, it sends what is published.
        await self._inner.ping(number)

    def _registered(self, number: bytes) -> None:
        """Send what is kept of the channels whose subscriptions the server has registered."""
        for item in self._unregistered.pop(number, ()):
            if self._subscriptions.get(item["id"]) == item["channelId"]:
                self._unsent[item["id"]] = deque(self._kept(item["channelId"]) or ())
        self._begun.set()

    async def _collect(self) -> tuple[int, bytes]:
        """Collect what the server sends; return why that ended."""
        async for message in self._inner:
            if message.type is WSMsgType.TEXT:
                self._outbox.put(message.data, droppable=False)
            elif message.type is WSMsgType.BINARY:
                is_message = message.data[:1] == bytes([_MESSAGE])
                self._outbox.put(message.data, droppable=is_message)
            elif message.type is WSMsgType.PONG:
                self._registered(bytes(message.data))
            elif message.type is WSMsgType.PING:
                await self._inner.pong(message.data)
        return WSCloseCode.SERVICE_RESTART, b"the dashboard has changed what it serves"

    async def _send(self) -> tuple[int, bytes]:
        while True:
            frame = await self._outbox.take()
            async with self._turn:
                await self._pass_out(frame)

    async def _send_kept(self) -> tuple[int, bytes]:
        """Send what is kept of new subscriptions, each message when the one before is taken."""
        while True:
            while not self._unsent:
                self._begun.clear()
                await self._begun.wait()
            subscription, keys = next(iter(self._unsent.items()))
            if not keys:
                del self._unsent[subscription]
                continue
            key = keys.popleft()
            async with self._turn:
                # Looked up in its turn: whatever is published from now on is sent after it.
                kept = self._kept(self._subscriptions.get(subscription, -1)) or {}
                if key not in kept:
                    continue
                data, log_time_ns, _ = kept[key]
                if not isinstance(data, bytes):
                    data = await asyncio.get_running_loop().run_in_executor(None, data)
                # The client may have ended the subscription, or begun another of that number.
                if self._unsent.get(subscription) is keys:
                    header = struct.pack("<BIQ", _MESSAGE, subscription, log_time_ns)
                    await self._pass_out(header + data)

    async def _pass_out(self, frame: str | bytes) -> None:
        if isinstance(frame, str):
            await self._outer.send_str(frame)
        else:
            await self._outer.send_bytes(frame)
        self._totals.messages += 1
        self._totals.sent_bytes += len(frame)


def _request(data: str) -> Any:
    """Return a request of a client; ValueError when it is not one that is served."""
    try:
        request = json.loads(data)
    except RecursionError:
        raise ValueError("JSON that is nested too deeply") from None
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
        raise ValueError(f"operation {str(request.get('op'))[:40]!r} is not served")
    if not isinstance(numbers, list) or len(numbers) > 2 * _MOST_SUBSCRIPTIONS:
        raise ValueError(f"expected a list of at most {_MOST_SUBSCRIPTIONS} subscriptions")
    if not all(type(number) is int and 0 <= number < 2**32 for number in numbers):
        raise ValueError("expected numbers of subscriptions and channels in [0, 2^32)")
    return request


def _check_playback(data: bytes) -> None:
    if data[:1] != bytes([_PLAYBACK]) or len(data) > _MOST_PLAYBACK_BYTES:
        raise ValueError("of binary messages only the control of a playback is served")
