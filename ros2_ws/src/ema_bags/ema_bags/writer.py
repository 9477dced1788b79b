# SPDX-License-Identifier: Apache-2.0
"""Writing of rosbag2 recordings in MCAP."""

import errno
import shutil
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message

from ema_bags.bag_file import BagFile, WrittenTopic
from ema_bags.gaps import Gap
from ema_bags.message_type import type_name
from ema_bags.metadata import METADATA_FILE, FileInformation, bag_information, write_metadata
from ema_core.steady_thread import SteadyThread

_WRITE_BYTES: Final = 64 * 1024
_MOST_WAITING: Final = 16 * 1024 * 1024


class _EndedFile(NamedTuple):
    """A closed file of a folder."""

    information: FileInformation
    counts: Counter[str]
    """Number of messages of each topic."""


class BagWriter(AbstractContextManager["BagWriter", None]):
    """An open recording.

    Messages are collected in chunks. A chunk is written to the operating system when it is full,
    and at least every ``flush_s`` of wall time. A killed process loses the messages of the last
    ``flush_s`` seconds; the file can be read up to them. A power failure of the machine may lose
    more. Any thread may write.

    With ``waits_for_room`` the recording survives a disk that is full or fails: up to 16 MiB are
    buffered in memory, later messages are counted and lost, and the recording continues in the
    same file when there is room. The metadata of the file describe the gap.

    A folder may have several files. Each file begins with the latest message of each latched topic
    and each description, so that it can be read without the previous files. The metadata of a
    folder list its closed files.

    Parameters
    ----------
    path
        Path of the recording: a name ending in ``.mcap`` is a single file, any other name a folder
        with files and ``metadata.yaml``. Missing parent folders are created.
    chunk_bytes
        Size at which a chunk is full, before compression [B].
    flush_s
        Longest time before a message is written [s].
    max_bytes
        Size at which the next file begins [B]; 0 for no limit. A file exceeds it by at most a
        chunk and its index.
    max_duration_s
        Recorded time after which the next file begins [s]; 0 for no limit.
    overwrite
        Whether an existing recording is replaced.
    waits_for_room
        Whether to buffer messages if the recording cannot be written, instead of raising OSError.
    on_failure
        Called with the failure and its traceback if the flushing thread ends unexpectedly.

    Attributes
    ----------
    custom_data
        Strings by name for ``custom_data`` of the metadata, written when a file is closed.
    failure
        Why the recording cannot be written, else None. It is set before a message is refused, and
        reset if the recording waits for room and can be written again.
    flusher
        The thread that flushes the file periodically.
    topics
        The added topics.
    removed
        Description of each file that was removed or moved during the recording.
    gaps
        Received messages that could not be recorded, and gaps added by :meth:`note_gap`; the last
        gap is open while ``failure`` is set.

    Raises
    ------
    FileExistsError
        If the path exists and must not be replaced, or is not a recording.
    ValueError
        If a setting is impossible, or the recording is closed.
    OSError
        If the recording could not be written, now or before, and does not wait for room.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        chunk_bytes: int = 128 * 1024,
        flush_s: float = 0.5,
        max_bytes: int = 0,
        max_duration_s: float = 0.0,
        overwrite: bool = False,
        waits_for_room: bool = False,
        on_failure: Callable[[str, str], object] = lambda failure, trace: None,
    ) -> None:
        if not 0.0 < flush_s < float("inf"):
            raise ValueError(f"flush_s = {flush_s!r} s: expected a positive number of seconds")
        self.path = Path(path)
        self._folder = None if self.path.suffix == ".mcap" else self.path
        self._chunk_bytes = chunk_bytes
        self._max_bytes, self._max_duration_s = max_bytes, max_duration_s
        if max_bytes or max_duration_s:
            self._require_folder()
        _clear(self.path, overwrite)
        (self._folder or self.path.parent).mkdir(parents=True, exist_ok=True)
        self.custom_data: dict[str, str] = {}
        self.topics: dict[str, WrittenTopic] = {}
        # The latest message of each state topic and actuator.
        self._states: dict[tuple[str, str], tuple[bytes, int]] = {}
        self._ended: list[_EndedFile] = []
        # Ended files with buffered data, and metadata of the folder that are not written yet.
        self._unwritten: list[BagFile] = []
        self._metadata: dict[str, Any] | None = None
        self._number = 0
        self._file = self._next_file()
        self._is_closed = False
        self._waits_for_room = waits_for_room
        self.failure: OSError | None = None
        self.removed: list[str] = []
        self.gaps: list[Gap] = []
        self._gap: Gap | None = None
        self._reported_gaps = 0
        self._flush_s = flush_s / 2
        self._flushed_s = time.monotonic()
        self._lock = threading.Lock()
        self.flusher = SteadyThread("bag flusher", self._keep_flushing, on_failure)
        self.flusher.start()

    @property
    def file_path(self) -> Path:
        """Path of the current file."""
        return self._file.path

    @property
    def waiting(self) -> int:
        """Size of the buffered data, without the current chunk [B]."""
        return sum(len(file.disk.held) for file in (self._file, *self._unwritten))

    def add_topic(self, topic: str, message_class: type, qos: QoSProfile) -> None:
        """Add a topic with the quality of service of its publisher, before its first message.

        Raises
        ------
        ValueError
            If the topic was added before, or the type is not installed.
        """
        added = WrittenTopic(topic, message_class, qos)
        with self._writing():
            if topic in self.topics:
                raise ValueError(f"topic {topic} was added before")
            self._file.add_topic(added)
            self.topics[topic] = added

    def write(
        self, topic: str, message: Any, log_time_ns: int, publish_time_ns: int | None = None
    ) -> None:
        """Write a message.

        Parameters
        ----------
        topic
            Name of an added topic.
        message
            The message.
        log_time_ns
            Time of reception [ns].
        publish_time_ns
            Time of publication [ns]; None for the log time.

        Raises
        ------
        ValueError
            If the topic was not added, the message has another type, a time is out of range or
            the recording is closed.
        OSError
            If the recording could not be written, now or before.
        """
        expected = self._topic(topic).message_class
        if not isinstance(message, expected):
            raise ValueError(
                f"topic {topic} has type {type_name(expected)}, not {type(message).__name__}"
            )
        self.write_serialized(topic, serialize_message(message), log_time_ns, publish_time_ns)

    def write_serialized(
        self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int | None = None
    ) -> bool:
        """Write a serialised message, as from a raw subscription.

        Parameters and errors are the same as in :meth:`write`. Return False if the message is
        lost because neither the disk nor the buffer has room, else True.
        """
        if publish_time_ns is None:
            publish_time_ns = log_time_ns
        for name, value in (("log_time_ns", log_time_ns), ("publish_time_ns", publish_time_ns)):
            if not 0 <= value < 2**63:
                raise ValueError(f"{name} = {value!r} ns on topic {topic} is outside [0, 2^63) ns")
        written = self._topic(topic)
        data = written.trim(data)
        with self._writing():
            if self.failure and self.waiting > _MOST_WAITING:
                if self._gap is None:
                    self._gap = Gap(str(self.failure), log_time_ns, log_time_ns)
                    self.gaps.append(self._gap)
                self._gap.add(log_time_ns)
                self._note_state(written, data, publish_time_ns)
                return False
            if self._is_full(log_time_ns) and not self.failure:
                with self._trying():
                    self._begin_next(log_time_ns)
            self._file.write(written, data, log_time_ns, publish_time_ns)
            self._note_state(written, data, publish_time_ns)
            if len(self._file.disk.held) >= _WRITE_BYTES:
                with self._trying():
                    self._file.disk.flush()
            # The flushing thread may get no processor while messages arrive.
            if time.monotonic() - self._flushed_s >= self._flush_s:
                self._flush()
        return True

    def note_state(self, topic: str, data: bytes, publish_time_ns: int) -> None:
        """Keep a serialised message, which is not written, as the latest state of its topic.

        The next file begins with it if its topic is latched, or describes an actuator.
        """
        with self._writing():
            self._note_state(self._topic(topic), data, publish_time_ns)

    def note_gap(self, gap: Gap) -> None:
        """Report messages that were not received."""
        with self._writing():
            self.gaps.insert(len(self.gaps) - (self._gap is not None), gap)
            self._report_gap(gap)

    def begin_next_file(self, log_time_ns: int) -> None:
        """Begin the next file; an empty current file is used as the next file.

        The file begins with the latest states, at a log time [ns].

        Raises
        ------
        ValueError
            If the recording is a single file.
        """
        with self._writing():
            self._require_folder()
            self._begin_next(log_time_ns)

    def limit_size(self, most_bytes: int) -> list[str]:
        """Delete the oldest closed files until the folder's files have at most ``most_bytes``.

        The current file is never deleted. Return the names of the deleted files.

        Raises
        ------
        ValueError
            If the recording is a single file.
        """
        with self._writing():
            self._require_folder()
            folder = self._folder or self.path
            sizes = {
                file.information.name: _size(folder / file.information.name) for file in self._ended
            }
            total = self._file.disk.tell() + sum(sizes.values())
            deleted: list[str] = []
            while self._ended and total > most_bytes:
                oldest = self._ended.pop(0)
                (folder / oldest.information.name).unlink(missing_ok=True)
                total -= sizes[oldest.information.name]
                for name, count in oldest.counts.items():
                    self.topics[name].count -= count
                deleted.append(oldest.information.name)
            if deleted:
                self._metadata = self._folder_information()
                self._write_ended()
        return deleted

    def flush(self) -> None:
        """Write all messages so far to the operating system."""
        with self._writing():
            self._flush()

    def close(self) -> None:
        """Write index and metadata, and close; a second call has no effect.

        Raises
        ------
        OSError
            If the recording could not be written, now or before.
        """
        self.flusher.end()
        with self._lock:
            if self._is_closed:
                return
            self._is_closed = True
            try:
                if self.failure and not self._waits_for_room:
                    raise self.failure
                self._end_gap()
                self._end_file()
                self._write_ended()
            except OSError:
                for file in (*self._unwritten, self._file):
                    file.disk.close()
                raise

    def __exit__(self, *_: object) -> None:
        self.close()

    def _topic(self, topic: str) -> WrittenTopic:
        if topic not in self.topics:
            added = ", ".join(self.topics) or "none"
            raise ValueError(f"topic {topic!r} was not added to the recording; added: {added}")
        return self.topics[topic]

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Serialise writing; raise an error if the recording is closed or has failed."""
        with self._lock:
            if self.failure and not self._waits_for_room:
                raise self.failure
            if self._is_closed:
                raise ValueError(f"the recording {self.path} is closed")
            with self._trying():
                yield

    @contextmanager
    def _trying(self) -> Iterator[None]:
        """Record a failure, and raise it unless the recording waits for room."""
        try:
            yield
        except OSError as error:
            self.failure = error
            if not self._waits_for_room:
                raise

    def _require_folder(self) -> None:
        if self._folder is None:
            raise ValueError(
                f"{self.path} is a single file: expected a folder (a name without .mcap) for a "
                "recording in several files"
            )

    def _next_file(self) -> BagFile:
        """Create the next file, with its first bytes on the disk."""
        path = self.path
        if self._folder is not None:
            path = self._folder / f"{self._folder.name}_{self._number}.mcap"
        file = BagFile(path, self._chunk_bytes)
        try:
            file.flush()
        except OSError:
            file.disk.close()
            path.unlink(missing_ok=True)
            raise
        self._number += 1
        for topic in self.topics.values():
            file.add_topic(topic)
        return file

    def _is_full(self, log_time_ns: int) -> bool:
        information = self._file.information
        if not information.count:
            return False
        age_s = (log_time_ns - information.start_ns) / 1e9
        is_large = self._max_bytes and self._file.disk.tell() >= self._max_bytes
        return bool(is_large or (self._max_duration_s and age_s >= self._max_duration_s))

    def _begin_next(self, log_time_ns: int) -> None:
        """Begin the next file; if there is no room for it, continue the current file."""
        if self._file.information.count:
            following = self._next_file()
            self._end_file()
            self._file = following
        self._write_states(log_time_ns)
        self._write_ended()

    def _write_states(self, log_time_ns: int) -> None:
        """Write the latest states, for a reader without the previous files."""
        for (topic, _), (data, publish_time_ns) in self._states.items():
            self._file.write(self.topics[topic], data, log_time_ns, publish_time_ns)

    def _note_state(self, topic: WrittenTopic, data: bytes, publish_time_ns: int) -> None:
        """Keep a message as the latest state of its topic and actuator."""
        if not topic.is_state:
            return
        actuator = ""
        if topic.has_actuator:
            try:
                message: Any = deserialize_message(data, topic.message_class)
            except Exception:  # the middleware raises various errors for malformed messages
                return
            actuator = message.actuator_id
        self._states.pop((topic.name, actuator), None)  # moves to the end
        self._states[topic.name, actuator] = data, publish_time_ns

    def _end_file(self) -> None:
        """End the current file; ``_write_ended`` writes its buffered data."""
        self._ended.append(_EndedFile(self._file.information, self._file.counts))
        self._metadata = self._folder_information()
        self._file.finish(self._metadata)
        self._unwritten.append(self._file)

    def _folder_information(self) -> dict[str, Any]:
        files = [file.information for file in self._ended]
        return bag_information(files, self.topics.values(), self.custom_data)

    def _write_ended(self) -> None:
        """Write the buffered data of ended files, and the metadata of the folder."""
        while self._unwritten:
            self._unwritten[0].close()
            del self._unwritten[0]
        if self._folder is not None and self._metadata is not None:
            write_metadata(self._folder, self._metadata)
        self._metadata = None

    def _flush(self) -> None:
        """Write all messages to the operating system; if that succeeds, clear ``failure``."""
        self._flushed_s = time.monotonic()
        if not self._file.disk.is_at(self._file.path):
            self._replace_removed()
        self._write_ended()
        self._file.flush()
        if self.failure:
            self.failure = None
            self._end_gap()
            self._file.flush()

    def _replace_removed(self) -> None:
        """Begin a file in place of the removed current file."""
        gone, span = self._file, self._file.information
        reason = f"{gone.path} was removed or moved during the recording"
        if not self._waits_for_room:
            raise FileNotFoundError(errno.ENOENT, reason)
        (self._folder or self.path.parent).mkdir(parents=True, exist_ok=True)
        if self._folder is not None:
            self._ended = [
                file for file in self._ended if (self._folder / file.information.name).exists()
            ]
        self._file = self._next_file()
        gone.disk.close()
        for name, topic in self.topics.items():
            topic.count -= gone.counts[name]
        gap = Gap(reason, span.start_ns, span.end_ns, span.count)
        self.removed.append(str(gap))
        self.gaps.append(gap)
        self._report_gap(gap)
        self._write_states(span.end_ns)

    def _end_gap(self) -> None:
        """Report the gap that has just ended, if there is one."""
        gap, self._gap = self._gap, None
        if gap is not None:
            self._report_gap(gap)

    def _report_gap(self, gap: Gap) -> None:
        """Add a gap to the file and to the metadata of the recording."""
        self._file.note_gap(gap)
        self._reported_gaps += 1
        self.custom_data[f"gap {self._reported_gaps}"] = str(gap)

    def _keep_flushing(self) -> None:
        # The library ends chunks by size only.
        while not self.flusher.ending.wait(self._flush_s):
            try:
                self.flush()
            except OSError:  # the next call of write or close raises it
                self.flusher.ending.set()


def _size(path: Path) -> int:
    """Return the size of a file [B]; 0 if it does not exist."""
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


def _clear(path: Path, overwrite: bool) -> None:
    """Remove a recording from a path if allowed; raise FileExistsError for anything else."""
    if not path.exists():
        return
    if not overwrite:
        raise FileExistsError(f"{path} already exists")
    is_file = path.suffix == ".mcap"
    if is_file and path.is_file():
        path.unlink()
    elif (
        not is_file
        and path.is_dir()
        and all(item.suffix == ".mcap" or item.name == METADATA_FILE for item in path.iterdir())
    ):
        shutil.rmtree(path)
    else:
        raise FileExistsError(f"{path} contains more than a recording: it was not replaced")
