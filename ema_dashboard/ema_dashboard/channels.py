"""Topics as channels of foxglove-sdk, and what is kept of them for clients that come later."""

import logging
import secrets
import threading
from collections.abc import Callable
from typing import Final, NamedTuple

import foxglove
from foxglove import Channel, Context, Schema
from foxglove.websocket import PlaybackState, ServerListener, WebSocketServer

from ema_dashboard.known_topics import KnownTopic
from ema_recording.message_type import type_name
from ema_recording.schema import schema_text

# It logs what clients do wrong, in threads of its own; the relay counts that.
logging.getLogger("foxglove").setLevel(logging.CRITICAL)

_BACKLOG: Final = 4096
_MOST_KEPT: Final = 1000


class KeptMessage(NamedTuple):
    """A message for clients to come, or what makes it; its times [ns]."""

    data: bytes | Callable[[], bytes]
    log_time_ns: int
    stamp_ns: int


class Channels:
    """Channels of topics, by their full names, and the server that offers them.

    The server listens on an address of loopback that is chosen at random, out of millions, and a
    port of the system's choice, so that no page in a browser finds it without passing the checks of
    ``WebServer``.

    Parameters
    ----------
    name
        What clients show as the name of the server.
    listener
        Called by the server, in threads of its own, when a client controls a playback.
    """

    def __init__(self, name: str, listener: ServerListener) -> None:
        self._name = name
        self._listener = listener
        self._context = Context()
        self._lock = threading.Lock()
        self._channels: dict[str, Channel] = {}
        self._kept: dict[int, dict[str, KeptMessage]] = {}
        self._host = ".".join(map(str, (127, *(2 + secrets.randbelow(250) for _ in range(3)))))
        self._server: WebSocketServer | None = None
        self.playback_range: tuple[int, int] | None = None

    @property
    def address(self) -> str:
        """Address of the server, for the relay."""
        server = self._server  # another thread may begin it anew
        return f"http://{self._host}:{server.port if server else 0}/"

    def start(self, playback_range: tuple[int, int] | None = None) -> None:
        """Start the server, anew if it runs: its clients are disconnected.

        Parameters
        ----------
        playback_range
            First and last time of a playback that clients can control [ns]; None without one.
        """
        self.stop()
        self.playback_range = playback_range
        self._server = foxglove.start_server(
            name=self._name,
            host=self._host,
            port=0,
            capabilities=[],
            server_listener=self._listener,
            supported_encodings=["cdr"],
            context=self._context,
            message_backlog_size=_BACKLOG,
            playback_time_range=playback_range,
        )

    def stop(self) -> None:
        """Stop the server."""
        if self._server is not None:
            self._server.stop()
            self._server = None

    def close(self) -> None:
        """Stop the server and remove all channels."""
        self.stop()
        for channel in self._channels.values():
            channel.close()
        with self._lock:
            self._channels.clear()
            self._kept.clear()

    def __len__(self) -> int:
        return len(self._channels)

    def __contains__(self, topic: str) -> bool:
        return topic in self._channels

    def add(self, topic: KnownTopic) -> None:
        """Offer a topic to clients."""
        name = type_name(topic.message_class)
        schema = Schema(name=name, encoding="ros2msg", data=schema_text(name).encode())
        # Clients are told of the channel at once: what they ask about it has to wait for the rest.
        with self._lock:
            channel = Channel(
                topic.name, message_encoding="cdr", schema=schema, context=self._context
            )
            self._channels[topic.name] = channel
            self._kept[channel.id()] = {}

    def has_clients(self, topic: str) -> bool:
        """Return whether a client looks at a topic."""
        channel = self._channels.get(topic)
        return channel is not None and channel.has_sinks()

    def send(self, topic: str, data: bytes, log_time_ns: int) -> None:
        """Send a message to the clients of a topic."""
        self._channels[topic].log(data, log_time=log_time_ns)

    def keep(
        self,
        topic: str,
        key: str,
        data: bytes | Callable[[], bytes],
        log_time_ns: int,
        stamp_ns: int = 0,
    ) -> None:
        """Keep a message for clients to come, instead of the one with the same key.

        Parameters
        ----------
        data
            The message, or what makes it when it is needed, in any thread.
        stamp_ns
            The time that it is about [ns].
        """
        with self._lock:
            kept = self._kept[self._channels[topic].id()]
            kept.pop(key, None)
            kept[key] = KeptMessage(data, log_time_ns, stamp_ns)
            if len(kept) > _MOST_KEPT:
                del kept[next(iter(kept))]

    def forget(self, topic: str, stamp_ns: int) -> None:
        """Drop what is kept of a topic and stamped later than a time [ns]."""
        with self._lock:
            kept = self._kept[self._channels[topic].id()]
            for key in [key for key, item in kept.items() if item.stamp_ns > stamp_ns]:
                del kept[key]

    def kept(self, channel_id: int) -> dict[str, KeptMessage] | None:
        """Return what is kept of a channel now, by its keys; any thread may ask.

        None when there is no such channel.
        """
        with self._lock:
            kept = self._kept.get(channel_id)
            return None if kept is None else dict(kept)

    def broadcast_playback(self, state: PlaybackState) -> None:
        """Tell clients how a playback stands."""
        server = self._server  # another thread may begin it anew
        if server is not None and self.playback_range is not None:
            server.broadcast_playback_state(state)
