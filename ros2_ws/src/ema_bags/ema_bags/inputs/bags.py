"""Bags of any make as series: MCAP by our own reader, sqlite3 by rosbags."""

from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_typestore

from ema_bags.inputs.mapping import Mapping
from ema_bags.inputs.series import Collector, Series
from ema_bags.metadata import METADATA_FILE, PACKED_SUFFIX
from ema_bags.reader import Bag
from ema_core.wording import counted, unknown_name
from ema_core.yaml_file import load_yaml


def is_bag(path: Path) -> bool:
    """Return whether a path looks like a bag: a folder, or a file of a storage of rosbag2."""
    name = path.name.removesuffix(PACKED_SUFFIX)
    return path.is_dir() or path.suffix == ".db3" or name.endswith(".mcap")


class AnyBag:
    """A bag of rosbag2: a file or a folder, MCAP or sqlite3, compressed or not.

    Parameters
    ----------
    path
        The bag.

    Attributes
    ----------
    topics
        Type and number of its messages by topic.

    Raises
    ------
    ValueError
        When it cannot be read.
    OSError
        When it cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._bag = Bag(path) if _is_mcap(path) else None
        # How many messages of a topic are malformed, and why the first one is.
        self._malformed = Counter[str]()
        self._reasons: dict[str, str] = {}
        self.topics: dict[str, tuple[str, int]]
        if self._bag is not None:
            there = self._bag.topics.items()
            self.topics = {name: (topic.type_name, topic.count) for name, topic in there}
            return
        with self._opened() as reader:
            self.topics = {
                name: (topic.msgtype or "", topic.msgcount) for name, topic in reader.topics.items()
            }

    @property
    def damage(self) -> str:
        """What is damaged, and whether that can be known; empty as long as it seems whole."""
        if self._bag is not None:
            return "; ".join(self._bag.remarks)
        return "; ".join(
            f"topic {name}: {counted(count, 'malformed message')} skipped, {self._reasons[name]}"
            for name, count in self._malformed.items()
        )

    def messages(self, topics: Iterable[str]) -> Iterator[tuple[str, Any, int, int]]:
        """Yield topic, message, time of sending (0: not known) and of reception [ns].

        Raises
        ------
        ValueError
            When a topic is not there, or its type not known.

        Notes
        -----
        A message that cannot be decoded is skipped; ``damage`` names and counts it.
        """
        wanted = list(topics)
        for name in wanted:
            if name not in self.topics:
                raise ValueError(f"{self.path}: {unknown_name('topic', name, self.topics)}")
        if self._bag is not None:
            for item in self._bag.messages(wanted):
                yield item.topic, item.message, item.publish_time_ns, item.log_time_ns
            return
        malformed = Counter[str]()
        with self._opened() as reader:
            chosen = [item for item in reader.connections if item.topic in wanted]
            for connection, received_ns, data in reader.messages(chosen):
                topic, kind = connection.topic, connection.msgtype
                try:
                    message = reader.deserialize(data, kind)
                except Exception as error:  # whatever the generated code comes upon
                    reason = f"the first of time {received_ns} ns: no {kind}: {error}"
                    self._reasons.setdefault(topic, reason)
                    malformed[topic] += 1
                    self._malformed |= malformed  # the largest of all times that it was read
                    continue
                yield topic, message, 0, received_ns

    def series(self, mapping: Mapping) -> tuple[dict[str, Series], str]:
        """Return what a mapping wants, by topic, and what was left out.

        Raises
        ------
        ValueError
            When a topic is not there, its type is another one than the mapping says, or not one
            message has what is wanted.
        """
        collector = Collector(mapping)
        for name, type_name in collector.types.items():
            there = self.topics.get(name)
            if there and type_name and there[0] != type_name:
                raise ValueError(
                    f"{self.path}: topic {name} holds {there[0]}, the mapping says {type_name}"
                )
        # Names may have been recorded after the first values that they are of.
        for part in (collector.names_topics, collector.topics):
            for item in self.messages(part) if part else ():
                collector.add(*item)
        found = collector.take()
        for name, series in found.items():
            if not len(series):
                reason = collector.reason or f"topic {name} has no message"
                raise ValueError(f"{self.path}: {reason}")
        return found, collector.problem()

    def joints_by_travel(self, topic: str) -> list[str]:
        """Return the joints of a topic of joint states, the one that moves most first."""
        reach: dict[str, tuple[float, float]] = {}
        for _, message, _, _ in self.messages([topic]):
            for name, position in zip(message.name, message.position, strict=False):
                low, high = reach.get(name, (position, position))
                reach[name] = min(low, position), max(high, position)
        return sorted(reach, key=lambda name: reach[name][0] - reach[name][1])

    def _opened(self) -> AnyReader:
        """Return a reader; a bag without definitions of its types is read with those of Jazzy."""
        try:
            return _Reader([self.path], default_typestore=get_typestore(Stores.ROS2_JAZZY))
        except AnyReaderError as error:
            raise ValueError(f"{self.path} cannot be read: {error}") from error


class _Reader(AnyReader):
    def open(self) -> None:
        try:
            super().open()
        except AnyReaderError as error:
            raise ValueError(f"the bag cannot be read: {error}") from error


def _is_mcap(path: Path) -> bool:
    metadata = path / METADATA_FILE
    if not metadata.exists():
        return path.suffix != ".db3"
    try:
        information = load_yaml(metadata)
        return information["rosbag2_bagfile_information"]["storage_identifier"] == "mcap"
    except (LookupError, TypeError, ValueError):
        return True  # the reader of MCAP says what is wrong
