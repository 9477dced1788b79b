# SPDX-License-Identifier: Apache-2.0
"""One MCAP file of an open recording, which buffers data while the disk is full."""

import errno
import os
from collections import Counter
from contextlib import suppress
from functools import cached_property
from io import BufferedWriter
from pathlib import Path
from typing import Any, cast

from mcap.writer import Writer
from rclpy.qos import DurabilityPolicy, QoSProfile

from ema_bags.gaps import GAP, Gap
from ema_bags.message_type import type_hash, type_name
from ema_bags.metadata import FileInformation, serialized_metadata
from ema_bags.qos import offered_qos, offered_qos_profiles
from ema_bags.schema import schema_text, trimmer
from ema_core import __version__
from ema_interfaces.msg import ActuatorDescription, Usage


class WrittenTopic:
    """A topic being recorded, with the quality of service of its publisher.

    Attributes
    ----------
    count
        Number of messages written.
    is_state
        Whether the latest message describes a state that lasts until the next message.
    trim
        Function that removes padding bytes after the content of a serialised message.
    """

    def __init__(self, name: str, message_class: Any, qos: QoSProfile) -> None:
        self.name, self.message_class = name, message_class
        self.type_name = type_name(message_class)
        self.type_hash = type_hash(self.type_name)
        self.schema = schema_text(self.type_name)
        self.trim = trimmer(self.type_name)
        self.qos, self.qos_text = offered_qos(qos), offered_qos_profiles(qos)
        is_latched = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
        self.is_state = is_latched or issubclass(message_class, (ActuatorDescription, Usage))
        self.count = 0

    @cached_property
    def has_actuator(self) -> bool:
        """Whether messages on this topic name an actuator."""
        return "actuator_id" in self.message_class.get_fields_and_field_types()


class HeldFile:
    """A new file with an unlimited buffer: only ``flush`` can fail, and it can be retried.

    A writer therefore never fails in the middle of a record.

    Attributes
    ----------
    held
        Bytes not written yet.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)
        self._written = 0
        self.held = bytearray()

    def write(self, data: bytes) -> int:
        """Buffer bytes, and return their number."""
        self.held += data
        return len(data)

    def tell(self) -> int:
        """Return the number of bytes accepted."""
        return self._written + len(self.held)

    def flush(self) -> None:
        """Write the held bytes to the operating system."""
        while self.held:
            count = self._file.write(self.held) or 0
            if not count:
                raise OSError(errno.EIO, "no bytes were written")
            self._written += count
            del self.held[:count]

    def close(self) -> None:
        """Close the file; held bytes are lost."""
        self._file.close()

    def is_at(self, path: Path) -> bool:
        """Return whether the open file is still at ``path``, neither removed nor moved."""
        try:
            return os.path.samestat(os.fstat(self._file.fileno()), os.stat(path))
        except FileNotFoundError:
            return False


class BagFile:
    """An MCAP file; data that do not fit on the disk stay in memory until there is room.

    Attributes
    ----------
    information
        Name of the file, and time range and number of its messages.
    counts
        Number of messages of each topic.
    disk
        The file on the disk; the current chunk is not yet part of it.

    Raises
    ------
    OSError
        If the file exists or cannot be created. Methods raise it if buffered data could not be
        written; the data stay buffered.
    """

    def __init__(self, path: Path, chunk_bytes: int) -> None:
        self.path = path
        self.information = FileInformation(path.name)
        self.counts: Counter[str] = Counter()
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self.disk = HeldFile(path)
        # The writer needs only ``write``, ``tell`` and ``flush`` of a stream.
        self._mcap = Writer(cast(BufferedWriter, self.disk), chunk_bytes)
        self._mcap.start(profile="ros2", library=f"ema_bags {__version__}")
        with suppress(OSError):  # a reader of a new bag finds a valid file
            self.disk.flush()

    def add_topic(self, topic: WrittenTopic) -> None:
        """Add a topic before its first message."""
        kind = topic.type_name
        if kind not in self._schemas:
            self._schemas[kind] = self._mcap.register_schema(kind, "ros2msg", topic.schema.encode())
        metadata = {"offered_qos_profiles": topic.qos_text, "topic_type_hash": topic.type_hash}
        self._channels[topic.name] = self._mcap.register_channel(
            topic.name, "cdr", self._schemas[kind], metadata
        )

    def write(self, topic: WrittenTopic, data: bytes, log_time_ns: int, sent_ns: int) -> None:
        """Add the next message of a topic, which is buffered until ``flush``."""
        channel, number = self._channels[topic.name], topic.count % 2**32
        self._mcap.add_message(channel, log_time_ns, data, sent_ns, number)
        self.information.add(log_time_ns)
        self.counts[topic.name] += 1
        topic.count += 1

    def note_gap(self, gap: Gap) -> None:
        """Add a metadata record about messages that were not recorded."""
        self._mcap.add_metadata(GAP, gap.as_metadata())

    def flush(self) -> None:
        """Write all messages so far to the operating system."""
        self._mcap.flush()

    def finish(self, information: dict[str, Any]) -> None:
        """Add metadata and index to the end of the file; ``close`` writes them."""
        record = {"serialized_metadata": serialized_metadata(information)}
        self._mcap.add_metadata("rosbag2", record)
        self._mcap.finish()

    def close(self) -> None:
        """Write the buffered data and close the file; if writing fails, the file stays open."""
        self.disk.flush()
        self.disk.close()
