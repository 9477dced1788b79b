"""One MCAP file of a recording that is being written, also while the disk is full."""

import errno
import os
from collections import Counter
from dataclasses import dataclass
from io import BufferedWriter
from pathlib import Path
from typing import Any, cast

from mcap.writer import Writer

from ema_bags.gaps import GAP, Gap
from ema_bags.metadata import FileInformation, TopicInformation, serialized_metadata
from ema_core import __version__


@dataclass
class RecordedType:
    """A topic as it is written to each file: its metadata, schema and offered QoS as YAML."""

    information: TopicInformation
    schema: str
    offered_qos: str


class _HeldFile:
    """A new file whose ``write`` takes everything: ``flush`` alone fails, and can be repeated.

    Whoever writes through it never stops in the middle of a record.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)
        self._written = 0
        self.held = bytearray()

    def write(self, data: bytes) -> int:
        self.held += data
        return len(data)

    def tell(self) -> int:
        return self._written + len(self.held)

    def flush(self) -> None:
        while self.held:
            count = self._file.write(self.held) or 0
            if not count:
                raise OSError(errno.EIO, "nothing was written")
            self._written += count
            del self.held[:count]

    def close(self) -> None:
        self._file.close()

    def is_at(self, path: Path) -> bool:
        """Return whether it still has a name."""
        try:
            return os.path.samestat(os.fstat(self._file.fileno()), os.stat(path))
        except FileNotFoundError:
            return False


class BagFile:
    """One MCAP file; what does not fit on the disk waits in memory until there is room.

    Attributes
    ----------
    information
        Its name, and the extent of what is in it.
    counts
        How many messages of each topic.

    Raises
    ------
    OSError
        When there is such a file, or it cannot be made.
    """

    def __init__(self, path: Path, chunk_bytes: int) -> None:
        self.path = path
        self.information = FileInformation(path.name)
        self.counts: Counter[str] = Counter()
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._file = _HeldFile(path)
        # It writes, tells where it is and flushes: more is not asked of a stream.
        self._mcap = Writer(cast(BufferedWriter, self._file), chunk_bytes)
        self._mcap.start(profile="ros2", library=f"ema_bags {__version__}")

    @property
    def size(self) -> int:
        """Bytes so far, without the chunk that is being gathered."""
        return self._file.tell()

    @property
    def is_there(self) -> bool:
        """Whether it has neither been removed nor moved."""
        return self._file.is_at(self.path)

    @property
    def waiting(self) -> int:
        """How many of them are not written yet [B]."""
        return len(self._file.held)

    def add_topic(self, topic: RecordedType) -> None:
        """Add a topic that messages follow of."""
        name = topic.information.type_name
        if name not in self._schemas:
            self._schemas[name] = self._mcap.register_schema(name, "ros2msg", topic.schema.encode())
        self._channels[topic.information.name] = self._mcap.register_channel(
            topic.information.name,
            "cdr",
            self._schemas[name],
            {
                "offered_qos_profiles": topic.offered_qos,
                "topic_type_hash": topic.information.type_hash,
            },
        )

    def write(
        self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int, n: int
    ) -> None:
        """Take a message, the ``n``-th of its topic; ``flush`` writes it."""
        channel = self._channels[topic]
        self._mcap.add_message(channel, log_time_ns, data, publish_time_ns, n % 2**32)
        self.information.add(log_time_ns)
        self.counts[topic] += 1

    def note_gap(self, gap: Gap) -> None:
        """Tell of messages that are not recorded."""
        record = {
            "reason": gap.reason,
            "messages": str(gap.count),
            "start_ns": str(gap.start_ns),
            "end_ns": str(gap.end_ns),
        }
        self._mcap.add_metadata(GAP, record)

    def write_waiting(self) -> None:
        """Hand what waits to the operating system, without the chunk that is being gathered.

        Raises
        ------
        OSError
            When that could not be written; it waits.
        """
        self._file.flush()

    def flush(self) -> None:
        """Hand everything so far to the operating system.

        Raises
        ------
        OSError
            When that could not be written; it waits.
        """
        self._mcap.flush()

    def finish(self, information: dict[str, Any]) -> None:
        """End the file with metadata and index; they wait to be written."""
        record = {"serialized_metadata": serialized_metadata(information)}
        self._mcap.add_metadata("rosbag2", record)
        self._mcap.finish()

    def close(self) -> None:
        """Write what waits, and close.

        Raises
        ------
        OSError
            When that could not be written; the file stays open.
        """
        self._file.flush()
        self._file.close()

    def abandon(self) -> None:
        """Close a file that could not be written."""
        self._file.close()
