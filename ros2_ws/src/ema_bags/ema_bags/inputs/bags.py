# SPDX-License-Identifier: Apache-2.0
"""Series from rosbag2 bags: MCAP read by ``ema_bags.reader``, SQLite by rosbags."""

from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from ema_bags.inputs.joint_messages import is_read
from ema_bags.inputs.joint_topics import JointTopics, TopicJoint
from ema_bags.inputs.mapping import ColumnMapping
from ema_bags.inputs.series import Collector, Series
from ema_bags.metadata import METADATA_FILE, PACKED_SUFFIX
from ema_bags.recording import MalformedMessages, MessagePlace, Recorded, Topic
from ema_bags.suffixes import MCAP, SQLITE
from ema_core.files import require_regular_file
from ema_core.wording import unknown_name

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

    from ema_bags.reader import Bag


def is_bag(path: Path) -> bool:
    """Return whether a path looks like a bag: a folder, or a file with a rosbag2 suffix."""
    name = path.name.removesuffix(PACKED_SUFFIX)
    return path.is_dir() or path.suffix == SQLITE or name.endswith(MCAP)


class SqliteBag:
    """A rosbag2 bag in SQLite storage: a file or folder, optionally compressed.

    Parameters
    ----------
    path
        Path of the bag.

    Attributes
    ----------
    topics
        Recorded topics by name.

    Raises
    ------
    ValueError
        If the bag cannot be read.
    OSError
        If the bag cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.is_dir():
            require_regular_file(path)
        self._malformed = MalformedMessages()
        with self._opened() as reader:
            self.topics = {
                name: Topic(topic.msgtype or "", topic.msgcount, "cdr", "", "", "")
                for name, topic in reader.topics.items()
            }

    @property
    def remarks(self) -> list[str]:
        """Descriptions of the malformed messages read so far."""
        return self._malformed.remarks()

    def messages(self, topics: Iterable[str]) -> Iterator[Recorded]:
        """Yield decoded messages in order of reception; malformed messages are skipped.

        Publish times are 0 (unknown).
        """
        wanted = list(topics)
        with self._opened() as reader:
            chosen = [item for item in reader.connections if item.topic in wanted]
            # The position of a message must not depend on which topics are selected.
            numbers = Counter[str]()
            for connection, received_ns, data in reader.messages(chosen):
                topic, kind = connection.topic, connection.msgtype
                position = MessagePlace(received_ns, 0, 0, numbers[topic])
                numbers[topic] += 1
                item = Recorded(position, topic, kind, data, 0)
                try:
                    item = item._replace(message=reader.deserialize(data, kind))
                except Exception as error:  # the generated code raises various errors
                    self._malformed.note(item, f"no {kind}: {error}")
                    continue
                yield item

    @contextmanager
    def _opened(self) -> Iterator["AnyReader"]:
        """Yield an open reader; bags without type definitions are read with the Jazzy types."""
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore

        try:
            store = get_typestore(Stores.ROS2_JAZZY)
            with AnyReader([self.path], default_typestore=store) as reader:
                yield reader
        except AnyReaderError as error:
            raise ValueError(f"{self.path} cannot be read: {error}") from error


AnyBag: TypeAlias = "Bag | SqliteBag"


def open_bag(path: Path) -> AnyBag:
    """Open a rosbag2 bag in MCAP or sqlite3 storage."""
    from ema_bags.reader import Bag  # imports rosbags and mcap

    is_whole = (path / METADATA_FILE).exists()
    is_sqlite = path.suffix == SQLITE or (
        is_whole and any(path.glob("*.db3*")) and not any(path.glob("*.mcap*"))
    )
    return SqliteBag(path) if is_sqlite else Bag(path)


def bag_series(bag: AnyBag, mapping: ColumnMapping) -> tuple[dict[str, Series], str]:
    """Return the mapped series of a bag by topic, and a remark on skipped messages ("" if none).

    Raises
    ------
    ValueError
        If a topic is missing, its type differs from the mapping, or no message has the mapped
        fields.
    """
    collector = Collector(mapping)
    for name in collector.topics:
        if name not in bag.topics:
            raise ValueError(f"{bag.path}: {unknown_name('topic', name, bag.topics)}")
    for name, type_name in collector.types.items():
        recorded_type = bag.topics[name].type_name
        if type_name and recorded_type != type_name:
            raise ValueError(
                f"{bag.path}: topic {name} has type {recorded_type}, but the mapping has "
                f"{type_name}"
            )
    # Read the names first: they may have been recorded after the first values.
    for part in (collector.names_topics, collector.topics):
        for item in bag.messages(part) if part else ():
            collector.add(item.topic, item.message, item.publish_time_ns, item.log_time_ns)
    by_topic = collector.take()
    # A payload that never changes may not have been published; it is unknown.
    payload = mapping.payload.topic if mapping.payload else ""
    for name, series in by_topic.items():
        if not len(series) and name != payload:
            reason = collector.reason or f"topic {name} has no messages"
            raise ValueError(f"{bag.path}: {reason}")
    return by_topic, collector.problem()


def recorded_joints(bag: AnyBag, effort_unit: str) -> list[TopicJoint]:
    """Return the joints recognised on the topics of a bag, in order of decreasing travel.

    Parameters
    ----------
    bag
        The bag.
    effort_unit
        Unit of the effort, unless the field name denotes a current.
    """
    topics = JointTopics()
    kinds = {name: topic.type_name for name, topic in bag.topics.items()}
    wanted = [name for name, kind in kinds.items() if is_read(name, kind)]
    for item in bag.messages(wanted) if wanted else ():
        sent_ns = item.publish_time_ns
        topics.add(item.topic, kinds[item.topic], item.message, sent_ns, item.log_time_ns)
    return sorted(topics.joints(effort_unit), key=lambda joint: -joint.travel)
