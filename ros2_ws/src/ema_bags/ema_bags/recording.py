# SPDX-License-Identifier: Apache-2.0
"""Interface of recordings in bags and in memory: messages by topic, in the order of reception."""

from abc import ABC, abstractmethod
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from ema_bags.message_type import is_installed
from ema_core.wording import counted

CONVERT: Final = (
    "`ros2 bag convert -i BAG -o FILE`, with "
    "`output_bags: [{uri: NEW, storage_id: mcap, all: true}]` in FILE, rewrites it as MCAP"
)
"""Remedy for a bag in an unsupported storage or compression."""


@dataclass(frozen=True)
class Topic:
    """A topic of a recording."""

    type_name: str
    """Type of its messages, such as ``std_msgs/msg/Header``."""

    count: int
    """Number of its messages."""

    encoding: str
    """Encoding of its messages; "cdr" in ROS 2."""

    type_hash: str
    """Hash of the recorded type; empty if missing."""

    schema: str
    """Definition of the recorded type; empty if missing."""

    qos: str
    """Offered quality of service: a list of profiles in YAML."""

    def upgrade(self) -> Callable[[bytes], bytes] | None:
        """Return a function that upgrades messages of the topic to the installed type.

        Return None if the types are equal, or if the type is not installed.

        Raises
        ------
        ValueError
            If the encoding is not CDR, or the types differ by more than new fields with defaults.
        """
        if self.encoding != "cdr":
            raise ValueError(f"it is encoded as {self.encoding!r}, expected 'cdr'")
        if not is_installed(self.type_name):
            return None
        from ema_bags.schema import to_installed  # imports rosbags

        return to_installed(self.type_name, self.schema, self.type_hash)


class MessagePlace(NamedTuple):
    """Position of a message in a recording; messages are read in the order of their places."""

    log_time_ns: int
    """Time of reception [ns]."""

    file: int
    """Index of the file."""

    offset: int
    """Position of the stretch in the file."""

    number: int
    """Index of the message in the stretch."""


class Recorded(NamedTuple):
    """A message of a recording."""

    place: MessagePlace
    """Position of the message in the recording."""

    topic: str
    """Topic of the message."""

    type_name: str
    """Type of the message, such as ``std_msgs/msg/Header``."""

    message: Any
    """The message, decoded or serialised."""

    publish_time_ns: int
    """Time of publication [ns]."""

    @property
    def log_time_ns(self) -> int:
        """Time of reception [ns]."""
        return self.place.log_time_ns


class MalformedMessages:
    """Malformed messages by topic: the reason for the first, and the position of each."""

    def __init__(self) -> None:
        self._by_topic: dict[str, tuple[str, set[MessagePlace]]] = {}

    def note(self, item: Recorded, reason: str) -> None:
        """Add a message; repeated reads of a message count once."""
        first = f"the first of log time {item.log_time_ns} ns: {reason}"
        self._by_topic.setdefault(item.topic, (first, set()))[1].add(item.place)

    def remarks(self) -> list[str]:
        """Return a remark for each topic, with its number of malformed messages."""
        return [
            f"topic {name}: {counted(len(positions), 'malformed message')} skipped, {first}"
            for name, (first, positions) in self._by_topic.items()
        ]


class Recording(ABC):
    """Messages on topics, in the order of their log times.

    Attributes
    ----------
    path
        The file or folder of the recording.
    topics
        Recorded topics by name.
    malformed
        Messages that cannot be decoded; ``damage`` gives the reason, and counts each once.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: Mapping[str, Topic] = {}
        self.malformed = MalformedMessages()

    @property
    def writers(self) -> list[str]:
        """Programs that wrote the files, with their versions; empty if unknown."""
        return []

    @property
    def damage(self) -> str:
        """Description of damage and lost messages; empty while the recording seems intact."""
        return "; ".join(self.malformed.remarks())

    @property
    def remarks(self) -> list[str]:
        """Remarks on the recording so far."""
        return list(filter(None, [self.damage]))

    def readable_counts(self) -> dict[str, int]:
        """Return the number of readable messages of each topic."""
        return {name: topic.count for name, topic in self.topics.items()}

    def topics_of(self, *type_names: str) -> list[str]:
        """Return the topics with any of these types."""
        return [name for name, topic in self.topics.items() if topic.type_name in type_names]

    @abstractmethod
    def messages(
        self,
        topics: Iterable[str] | None = None,
        first: MessagePlace | None = None,
        last: MessagePlace | None = None,
    ) -> Iterator[Recorded]:
        """Return an iterator of decoded messages, in the order of their log times.

        Parameters
        ----------
        topics
            Names of the topics; None for all.
        first, last
            Places of the first and last message to read, inclusive; None for no limit.

        Raises
        ------
        ValueError
            If a topic is not in the recording, if its type differs from the installed type or has
            no definition, or if its encoding is not CDR.

        Notes
        -----
        A message that cannot be decoded is skipped; ``damage`` names and counts it.
        """

    def _chosen(self, topics: Iterable[str] | None) -> dict[str, Topic]:
        if topics is None:
            return dict(self.topics)
        names = [topics] if isinstance(topics, str) else list(topics)
        for name in names:
            if name not in self.topics:
                present = ", ".join(sorted(self.topics)) or "none"
                raise ValueError(f"{self.path} has no topic {name!r}; topics: {present}")
        return {name: self.topics[name] for name in names}


class MemoryRecording(Recording):
    """A recording in memory.

    Parameters
    ----------
    path
        The source file of the messages.
    messages
        Topic, type, message, log time [ns] and publish time [ns] of each message, in the order of
        log times.
    """

    def __init__(self, path: Path, messages: Iterable[tuple[str, str, Any, int, int]]) -> None:
        super().__init__(path)
        self._items = [
            Recorded(MessagePlace(log_time_ns, 0, 0, number), topic, kind, message, sent_ns)
            for number, (topic, kind, message, log_time_ns, sent_ns) in enumerate(messages)
        ]
        counts = Counter((item.topic, item.type_name) for item in self._items)
        self.topics = {
            topic: Topic(kind, count, "", "", "", "") for (topic, kind), count in counts.items()
        }

    def messages(
        self,
        topics: Iterable[str] | None = None,
        first: MessagePlace | None = None,
        last: MessagePlace | None = None,
    ) -> Iterator[Recorded]:
        """Return an iterator of messages, by log time (see ``Recording.messages``)."""
        chosen = self._chosen(topics)
        start = bisect_left(self._items, first, key=_place) if first else 0
        end = bisect_right(self._items, last, key=_place) if last else len(self._items)
        return (item for item in self._items[start:end] if item.topic in chosen)


def _place(item: Recorded) -> MessagePlace:
    return item.place
