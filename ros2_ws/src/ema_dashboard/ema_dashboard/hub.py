# SPDX-License-Identifier: Apache-2.0
"""Hub: topics as channels of Foxglove's protocol, their latest messages, and their clients.

Messages are published from any thread; clients run in the event loop of the hub.
"""

import asyncio
import json
import struct
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple, Protocol

from ema_bags.message_type import type_name
from ema_bags.schema import schema_text
from ema_dashboard.known_topics import KnownTopic

_NAME: Final = "EMA health monitor"
_MOST_KEPT: Final = 1000
_NS_PER_S: Final = 1_000_000_000


class KeptMessage(NamedTuple):
    """Message for later clients, or a function that computes it, with its times [ns]."""

    data: bytes | Callable[[], bytes]
    log_time_ns: int
    stamp_ns: int


@dataclass
class Totals:
    """Counts over all clients: current clients and waiting bytes; other counts since the start."""

    clients: int = 0
    """Number of connected clients."""
    messages: int = 0
    """Number of sent messages."""
    sent_bytes: int = 0
    """Size of the sent messages [B]."""
    waiting_bytes: int = 0
    """Size of the waiting messages [B]."""
    dropped: int = 0
    """Number of dropped messages."""
    refused: int = 0
    """Number of refused requests."""


class Subscriber(Protocol):
    """A client of the hub."""

    subscriptions: dict[int, int]
    """Subscription numbers by channel."""
    dropped: int
    """Number of messages dropped because the client is slow."""
    waiting_bytes: int
    """Size of the waiting messages [B]."""

    def take(self, frame: str | bytes, *, droppable: bool) -> None:
        """Queue a frame; droppable frames may be dropped in favour of later frames."""

    def send(self, content: dict[str, Any]) -> None:
        """Send a message of the protocol."""

    def end(self, code: int, reason: bytes) -> None:
        """Close the connection."""


@dataclass
class _Channel:
    advertisement: dict[str, Any]
    kept: dict[str, KeptMessage] = field(default_factory=dict)

    @property
    def number(self) -> int:
        return self.advertisement["id"]


class Hub:
    """Channels by topic with their kept messages, and the connected clients.

    Attributes
    ----------
    loop
        Event loop of the clients.
    clients
        Connected clients; changed in the loop only.
    playback_range
        First and last time of a playback that clients can control [ns]; None without a playback.
    totals
        Counts of sent and refused messages, excluding connected clients.
    """

    def __init__(self) -> None:
        self.loop = asyncio.new_event_loop()
        self.clients: set[Subscriber] = set()
        self.playback_range: tuple[int, int] | None = None
        self.totals = Totals()
        self._lock = threading.Lock()
        self._channels: dict[str, _Channel] = {}
        self._session = time.time_ns()

    def __len__(self) -> int:
        return len(self._channels)

    def __contains__(self, topic: str) -> bool:
        return topic in self._channels

    def add(self, topic: KnownTopic) -> None:
        """Offer a topic to clients."""
        name = type_name(topic.message_class)
        channel = _Channel(
            {
                "id": len(self._channels) + 1,
                "topic": topic.name,
                "encoding": "cdr",
                "schemaName": name,
                "schemaEncoding": "ros2msg",
                "schema": schema_text(name),
            }
        )
        with self._lock:
            self._channels[topic.name] = channel
        self.in_loop(self._send_all, json.dumps(_advertise([channel])))

    def has_clients(self, topic: str) -> bool:
        """Return whether a client shows a topic. Thread-safe."""
        channel = self._channels.get(topic)
        return channel is not None and any(
            channel.number in client.subscriptions for client in tuple(self.clients)
        )

    def publish(self, topic: str, data: bytes, log_time_ns: int) -> None:
        """Send a message to the clients of a topic. Thread-safe."""
        # Later subscribers receive the kept messages.
        if self.has_clients(topic):
            self.in_loop(self._send, self._channels[topic].number, data, log_time_ns)

    def keep(
        self,
        topic: str,
        key: str,
        data: bytes | Callable[[], bytes],
        log_time_ns: int,
        stamp_ns: int = 0,
    ) -> None:
        """Keep a message for later clients, replacing the message with the same key.

        Parameters
        ----------
        topic
            Full name of the topic.
        key
            Key of the message, such as the actuator id.
        data
            The message, or a function that computes it on request, in any thread.
        log_time_ns
            Time of reception [ns].
        stamp_ns
            Time stamp of the message [ns].
        """
        with self._lock:
            kept = self._channels[topic].kept
            kept.pop(key, None)
            kept[key] = KeptMessage(data, log_time_ns, stamp_ns)
            if len(kept) > _MOST_KEPT:
                del kept[next(iter(kept))]

    def forget(self, topic: str, stamp_ns: int) -> None:
        """Discard kept messages of a topic with stamps later than ``stamp_ns``."""
        with self._lock:
            kept = self._channels[topic].kept
            for key in [key for key, item in kept.items() if item.stamp_ns > stamp_ns]:
                del kept[key]

    def kept(self, number: int) -> dict[str, KeptMessage] | None:
        """Return the kept messages of a channel by key; None for an unknown channel."""
        with self._lock:
            for channel in self._channels.values():
                if channel.number == number:
                    return dict(channel.kept)
        return None

    def offer_playback(self, playback_range: tuple[int, int] | None) -> None:
        """Start or stop offering playback control. Disconnects all clients.

        The protocol announces capabilities only at the start of a connection.
        """
        self.playback_range = playback_range
        self._session = time.time_ns()
        self.in_loop(self.end_all, 1012, b"the dashboard has changed what it serves")

    def figures(self) -> Totals:
        """Return the current totals, including connected clients."""
        clients = tuple(self.clients)
        dropped = self.totals.dropped + sum(client.dropped for client in clients)
        waiting = sum(client.waiting_bytes for client in clients)
        return replace(self.totals, dropped=dropped, waiting_bytes=waiting)

    def send_playback(self, frame: bytes) -> None:
        """Send the state of a playback to all clients."""
        if self.playback_range is not None:
            self.in_loop(self._send_all, frame)

    def join(self, client: Subscriber) -> None:
        """Add a new client, and send it the available channels; runs in the loop."""
        information: dict[str, Any] = {
            "op": "serverInfo",
            "name": _NAME,
            "capabilities": [],
            "supportedEncodings": ["cdr"],
            "metadata": {},
            "sessionId": str(self._session),
        }
        if self.playback_range is not None:
            start, end = self.playback_range
            information["capabilities"] = ["playbackControl"]
            information |= {"dataStartTime": _time(start), "dataEndTime": _time(end)}
        client.send(information)
        client.send(_advertise(list(self._channels.values())))
        self.clients.add(client)

    def end_all(self, code: int, reason: bytes) -> None:
        """Close all client connections; must run in the loop."""
        for client in tuple(self.clients):
            client.end(code, reason)

    def in_loop(self, call: Callable[..., object], *arguments: Any) -> None:
        """Call a function in the event loop. Thread-safe."""
        with suppress(RuntimeError):  # the dashboard ends
            self.loop.call_soon_threadsafe(call, *arguments)

    def _send(self, number: int, data: bytes, log_time_ns: int) -> None:
        for client in self.clients:
            subscription = client.subscriptions.get(number)
            if subscription is not None:
                client.take(message_frame(subscription, log_time_ns, data), droppable=True)

    def _send_all(self, frame: str | bytes) -> None:
        for client in self.clients:
            client.take(frame, droppable=False)


def message_frame(subscription: int, log_time_ns: int, data: bytes) -> bytes:
    """Return a topic's message encoded for the protocol."""
    return struct.pack("<BIQ", 1, subscription, log_time_ns) + data


def _advertise(channels: list[_Channel]) -> dict[str, Any]:
    return {"op": "advertise", "channels": [channel.advertisement for channel in channels]}


def _time(time_ns: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(time_ns, _NS_PER_S)
    return {"sec": seconds, "nsec": nanoseconds}
