"""A recording, in a bag or in memory: its messages by topic, in the order of reception."""

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
"""Remedy for a bag in a storage or compression that is not read."""


@dataclass(frozen=True)
class Topic:
    """A topic of a recording.

    Attributes
    ----------
    type_name
        Type of its messages, such as ``std_msgs/msg/Header``.
    encoding
        How they are encoded; "cdr" in ROS 2.
    type_hash, schema
        Hash and definition of the type when it was recorded; empty when they are not there.
    qos
        What was offered, YAML text of a list.
    """

    type_name: str
    count: int
    encoding: str
    type_hash: str
    schema: str
    qos: str

    def upgrade(self) -> Callable[[bytes], bytes] | None:
        """Return the function that upgrades its messages to the installed type; None if equal.

        None as well where the type is not installed; ValueError as in ``to_installed``, and where
        they are not CDR.
        """
        if self.encoding != "cdr":
            raise ValueError(f"it is encoded as {self.encoding!r}, expected 'cdr'")
        if not is_installed(self.type_name):
            return None
        from ema_bags.schema import to_installed  # rosbags only for bags

        return to_installed(self.type_name, self.schema, self.type_hash)


class MessagePlace(NamedTuple):
    """Where a message is in a recording; messages are read in the order of their places."""

    log_time_ns: int
    file: int
    offset: int
    number: int


class Recorded(NamedTuple):
    """A message of a recording; ``message`` is the message itself, or its bytes."""

    place: MessagePlace
    topic: str
    type_name: str
    message: Any
    publish_time_ns: int

    @property
    def log_time_ns(self) -> int:
        """When it was received [ns]."""
        return self.place.log_time_ns


class MalformedMessages:
    """Malformed messages by topic: the reason for the first, and the position of each."""

    def __init__(self) -> None:
        self._found: dict[str, tuple[str, set[MessagePlace]]] = {}

    def note(self, item: Recorded, reason: str) -> None:
        """Add a message, which counts once however often it is read."""
        first = f"the first of log time {item.log_time_ns} ns: {reason}"
        self._found.setdefault(item.topic, (first, set()))[1].add(item.place)

    def remarks(self) -> list[str]:
        """Return their number, one remark per topic."""
        return [
            f"topic {name}: {counted(len(places), 'malformed message')} skipped, {first}"
            for name, (first, places) in self._found.items()
        ]


class Recording(ABC):
    """Messages on topics, in the order of their log times.

    Attributes
    ----------
    path
        The file or folder that they are from.
    topics
        What was recorded, by topic.
    malformed
        Messages that cannot be used; ``damage`` gives the reason, and counts each once.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: Mapping[str, Topic] = {}
        self.malformed = MalformedMessages()

    @property
    def writers(self) -> list[str]:
        """Programs that wrote the files, with their versions; empty where a file does not say."""
        return []

    @property
    def damage(self) -> str:
        """Position of damage and the loss; empty as long as the recording seems intact."""
        return "; ".join(self.malformed.remarks())

    @property
    def remarks(self) -> list[str]:
        """Remarks on the recording so far."""
        return list(filter(None, [self.damage]))

    def readable_counts(self) -> dict[str, int]:
        """Return how many messages of each topic can be read."""
        return {name: topic.count for name, topic in self.topics.items()}

    def topics_of(self, *type_names: str) -> list[str]:
        """Return the topics of some types."""
        return [name for name, topic in self.topics.items() if topic.type_name in type_names]

    @abstractmethod
    def messages(
        self,
        topics: Iterable[str] | None = None,
        first: MessagePlace | None = None,
        last: MessagePlace | None = None,
    ) -> Iterator[Recorded]:
        """Read and decode messages, in the order of their log times.

        Parameters
        ----------
        first, last
            Places of the first and last message wanted; None for all.

        Raises
        ------
        ValueError
            When a topic is not in the recording, its type differs from the installed one or has
            no definition, or it is not CDR.

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
        The file that the messages were made from.
    messages
        Topic, type, message, log time and publish time of each [ns], in the order of log times.
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
        """Return messages in the order of their log times, as ``Recording.messages``."""
        chosen = self._chosen(topics)
        start = bisect_left(self._items, first, key=_place) if first else 0
        end = bisect_right(self._items, last, key=_place) if last else len(self._items)
        return (item for item in self._items[start:end] if item.topic in chosen)


def _place(item: Recorded) -> MessagePlace:
    return item.place
