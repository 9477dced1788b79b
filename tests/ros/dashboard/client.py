# SPDX-License-Identifier: Apache-2.0
"""Clients of the dashboard, which use the protocol of Foxglove over a real connection."""

import asyncio
import json
import struct
import threading
from collections import defaultdict
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any, Self

from aiohttp import ClientSession, WSMsgType
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from ...waiting import DEADLINE_S, wait_for

SUBPROTOCOL = "foxglove.sdk.v1"


class Web:
    """An event loop in a thread, with an HTTP session."""

    def __enter__(self) -> Self:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever)
        self._thread.start()
        self.session = self.run(self._open())
        return self

    def __exit__(self, *_: object) -> None:
        self.run(self.session.close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def run(self, work: Coroutine[Any, Any, Any]) -> Any:
        """Run a coroutine and return its result."""
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(DEADLINE_S)

    def begin(self, work: Coroutine[Any, Any, Any]) -> Any:
        """Start a coroutine and return its future, which can be cancelled."""
        return asyncio.run_coroutine_threadsafe(work, self._loop)

    def get(
        self, url: str, method: str = "get", **options: Any
    ) -> tuple[int, dict[str, str], bytes]:
        """Return status, headers and content of the answer to an HTTP request."""

        async def request() -> tuple[int, dict[str, str], bytes]:
            async with self.session.request(
                method, url, allow_redirects=False, **options
            ) as answer:
                return answer.status, dict(answer.headers), await answer.read()

        return self.run(request())

    def view(self, url: str, **options: Any) -> "Viewer":
        """Connect a new client to a dashboard."""
        return Viewer(self, url, **options)

    async def _open(self) -> ClientSession:
        return ClientSession()


class Viewer:
    """A client of the dashboard, with its channels and received messages.

    Attributes
    ----------
    channels
        Advertised channels, by topic.
    received
        Log times [ns] and messages by topic, decoded by the advertised schema.
    reported
        Other messages of the protocol, in order.
    """

    def __init__(self, web: Web, url: str, **options: Any) -> None:
        self._web = web
        self.channels: dict[str, dict[str, Any]] = {}
        self.received: dict[str, list[tuple[int, Any]]] = defaultdict(list)
        self.reported: list[Any] = []
        self._decoders = DecoderFactory()
        self._topics: dict[int, str] = {}
        self._numbers: dict[str, int] = {}
        self.socket = web.run(self._connect(url, options))
        self._reading = web.begin(self._read())

    def close(self) -> None:
        """Close the connection."""
        self._web.run(self.socket.close())
        with suppress(asyncio.CancelledError):
            self._reading.result(DEADLINE_S)

    def subscribe_to(self, *topics: str) -> None:
        """Subscribe to topics as soon as they are advertised."""
        for topic in topics:
            wait_for(lambda topic=topic: topic in self.channels, f"{topic} is advertised")
            number = len(self._topics) + 1
            self._topics[number], self._numbers[topic] = topic, number
            channel = self.channels[topic]["id"]
            self.send({"op": "subscribe", "subscriptions": [{"id": number, "channelId": channel}]})

    def unsubscribe_from(self, *topics: str) -> None:
        """Unsubscribe from topics."""
        numbers = [self._numbers.pop(topic) for topic in topics]
        self.send({"op": "unsubscribe", "subscriptionIds": numbers})

    def send(self, message: Any) -> None:
        """Send bytes, a text, or an object as JSON."""
        if isinstance(message, bytes):
            self._web.run(self.socket.send_bytes(message))
        else:
            text = message if isinstance(message, str) else json.dumps(message)
            self._web.run(self.socket.send_str(text))

    def control(
        self, *, play: bool, speed: float = 1.0, seek_ns: int | None = None, request: str = "r"
    ) -> None:
        """Send a request to the playback."""
        word = request.encode()
        fields = (3, 0 if play else 1, speed, seek_ns is not None, seek_ns or 0, len(word))
        self.send(struct.pack("<BBfBQI", *fields) + word)

    def wait_for(self, topic: str, count: int = 1) -> list[Any]:
        """Wait for ``count`` messages on a topic. Return all messages received so far."""
        wait_for(lambda: len(self.received[topic]) >= count, f"{count} messages on {topic}")
        return [message for _, message in self.received[topic]]

    def wait_until_received(self, topic: str, is_meant: Callable[[Any], bool]) -> None:
        """Wait for a message that satisfies a condition."""
        received = self.received[topic]
        wait_for(lambda: any(is_meant(message) for _, message in received), f"the one on {topic}")

    async def _connect(self, url: str, options: dict[str, Any]) -> Any:
        return await self._web.session.ws_connect(
            url, protocols=(SUBPROTOCOL,), max_msg_size=0, **options
        )

    async def _read(self) -> None:
        async for message in self.socket:
            if message.type is WSMsgType.TEXT:
                self._take_text(json.loads(message.data))
            elif message.type is WSMsgType.BINARY:
                self._take_data(message.data)

    def _take_text(self, content: dict[str, Any]) -> None:
        if content["op"] == "advertise":
            for channel in content["channels"]:
                self.channels[channel["topic"]] = channel
        else:
            self.reported.append(content)

    def _take_data(self, data: bytes) -> None:
        if data[0] == 1:
            number, log_time_ns = struct.unpack_from("<IQ", data, 1)
            topic = self._topics[number]
            channel = self.channels[topic]
            self.received[topic].append((log_time_ns, self._decoder(channel)(data[13:])))
        elif data[0] == 5:
            status, time_ns, speed, jumped, _ = struct.unpack_from("<BQfBI", data, 1)
            self.reported.append(
                {
                    "op": "playbackState",
                    "status": status,
                    "time_ns": time_ns,
                    "speed": speed,
                    "jumped": bool(jumped),
                    "request": data[19:].decode(),
                }
            )

    def _decoder(self, channel: dict[str, Any]) -> Any:
        schema = Schema(
            id=channel["id"],
            name=channel["schemaName"],
            encoding=channel["schemaEncoding"],
            data=channel["schema"].encode(),
        )
        return self._decoders.decoder_for(channel["encoding"], schema)
