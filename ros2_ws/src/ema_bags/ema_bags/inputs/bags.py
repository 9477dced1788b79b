"""Bags of any make as series: MCAP by our own reader, sqlite3 by rosbags."""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_typestore

from ema_bags.inputs.mapping import Mapping
from ema_bags.inputs.series import Collector, Series
from ema_bags.metadata import METADATA_FILE, PACKED_SUFFIX
from ema_bags.reader import Bag
from ema_core.wording import counted, unknown_name

_PACKED_MCAP = f".mcap{PACKED_SUFFIX}"


@dataclass(frozen=True)
class BagTopic:
    """A topic of a bag: type and number of its messages."""

    type_name: str
    count: int


def is_bag(path: Path) -> bool:
    """Return whether a path looks like a bag: a folder, or a file of a storage of rosbag2."""
    return path.is_dir() or path.suffix in (".mcap", ".db3") or path.name.endswith(_PACKED_MCAP)


class AnyBag:
    """A bag of rosbag2: a file or a folder, MCAP or sqlite3, compressed or not.

    Parameters
    ----------
    path
        The bag.

    Attributes
    ----------
    topics
        What it holds, by topic.

    Raises
    ------
    ValueError
        When it cannot be read.
    OSError
        When it cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._bag: Bag | None = None
        # Why the first malformed message of each topic is none, and when they were received.
        self._malformed: dict[str, tuple[str, int]] = {}
        if _is_mcap(path):
            self._bag = Bag(path)
            self.topics = {
                name: BagTopic(topic.type_name, topic.count)
                for name, topic in self._bag.topics.items()
            }
            return
        with self._opened() as reader:
            self.topics = {
                name: BagTopic(topic.msgtype or "", topic.msgcount)
                for name, topic in reader.topics.items()
            }

    @property
    def damage(self) -> str:
        """What is damaged, and whether that can be known; empty as long as it seems whole."""
        if self._bag is not None:
            return "; ".join(self._bag.remarks)
        return "; ".join(
            f"topic {name}: {counted(count, 'malformed message')} skipped, {first}"
            for name, (first, count) in self._malformed.items()
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
                try:
                    message = reader.deserialize(data, connection.msgtype)
                except Exception as error:  # whatever the generated code comes upon
                    first = f"the first of time {received_ns} ns: no {connection.msgtype}: {error}"
                    malformed[connection.topic] += 1
                    # The largest of all times that it was read.
                    known, count = self._malformed.get(connection.topic, (first, 0))
                    count = max(count, malformed[connection.topic])
                    self._malformed[connection.topic] = (known, count)
                    continue
                yield connection.topic, message, 0, received_ns

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


def bag_series(bag: AnyBag, mapping: Mapping) -> tuple[dict[str, Series], str]:
    """Return what a mapping wants of a bag, by topic, and what was left out.

    Raises
    ------
    ValueError
        When a topic is not there, its type is another one than the mapping says, or not one
        message has what is wanted.
    """
    collector = Collector(mapping)
    for name, type_name in collector.types.items():
        there = bag.topics.get(name)
        if there and type_name and there.type_name != type_name:
            raise ValueError(
                f"{bag.path}: topic {name} holds {there.type_name}, the mapping says {type_name}"
            )
    # Names may have been recorded after the first values that they are of.
    for part in (collector.names_topics, collector.topics):
        for topic, message, sent_ns, received_ns in bag.messages(part) if part else ():
            collector.add(topic, message, sent_ns, received_ns)
    found = collector.series()
    for name, series in found.items():
        if not len(series):
            raise ValueError(f"{bag.path}: {collector.reason or f'topic {name} has no message'}")
    return found, collector.problem()


def _is_mcap(path: Path) -> bool:
    if path.is_file() or not path.exists():
        return path.suffix != ".db3"
    metadata = path / METADATA_FILE
    if not metadata.exists():
        return True
    from ema_core.yaml_file import load_yaml  # YAML only for these

    try:
        information = load_yaml(metadata)
        return information["rosbag2_bagfile_information"]["storage_identifier"] == "mcap"
    except (LookupError, TypeError, ValueError):
        return True  # the reader of MCAP says what is wrong
