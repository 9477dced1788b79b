"""Writes recordings as rosbag2 does, in MCAP."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, Final, Literal

from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message

from ema_core.steady_thread import SteadyThread
from ema_recording.bag_file import COMPRESSION, RecordedType
from ema_recording.bag_files import BagFiles, FileSettings, WrittenTopic
from ema_recording.cdr import trimmer
from ema_recording.gaps import Gap
from ema_recording.message_type import type_hash, type_name
from ema_recording.metadata import TopicInformation
from ema_recording.qos import offered_qos, offered_qos_profiles
from ema_recording.schema import schema_text
from ema_recording.state_messages import says_state

_MOST_WAITING: Final = 16 * 1024 * 1024
_MOST_GAPS: Final = 100


class BagWriter(AbstractContextManager["BagWriter", None]):
    """A recording that is being written.

    Messages are gathered in chunks. A chunk goes to the operating system when it is full, and
    after ``flush_s`` of wall time at the latest, whether or not messages arrive: a process that is
    killed loses what it wrote in the last ``flush_s`` seconds, and the file can be read up to
    there. (When the machine itself loses power, more may be lost.) Any thread may write.

    With ``waits_for_room`` a disk that is full or fails ends nothing: what cannot be written waits
    in memory, 16 MiB of it, what comes beyond that is counted and lost, and all goes on in the same
    file when there is room. The metadata of the file tell of the gap.

    A folder may have several files. Each begins with the latest message of each topic that is
    latched, or describes an actuator, so that it can be read alone.

    Parameters
    ----------
    path
        Where to record: a name ending in ``.mcap`` makes this one file, any other name a folder
        with a file and ``metadata.yaml``. Missing parent folders are made.
    compression
        "zstd" or "none".
    chunk_bytes
        Size at which a chunk is full, before compression [B].
    flush_s
        Longest time that a message waits to be written [s].
    max_bytes
        Size from which on the next file is begun [B]; 0: whatever it is. A file becomes larger by
        at most a chunk and its index.
    max_duration_s
        Recorded time after which the next file is begun [s]; 0: never.
    overwrite
        Whether a recording that is there already is replaced.
    waits_for_room
        Whether to wait where the recording cannot be written, instead of giving up.
    on_failure
        Called as by ``SteadyThread`` when the thread that writes by time has ended by itself.

    Attributes
    ----------
    custom_data
        Texts by name for the ``custom_data`` of its metadata, written when a file is closed.
    failure
        Why the recording cannot be written; None as long as it can. It is known here before the
        next message is refused for it. Of one that waits for room it goes again.
    flusher
        The thread that writes by time.
    gaps
        What was received and could not be recorded, the last one open while ``failure`` is set, and
        what :meth:`note_gap` told of; the latest 100.
    not_recorded
        How many messages that are, those of earlier gaps among them.

    Raises
    ------
    FileExistsError
        When the target is there already and is not to be replaced, or is no recording.
    ValueError
        When a setting is impossible.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        compression: Literal["zstd", "none"] = "zstd",
        chunk_bytes: int = 128 * 1024,
        flush_s: float = 0.5,
        max_bytes: int = 0,
        max_duration_s: float = 0.0,
        overwrite: bool = False,
        waits_for_room: bool = False,
        on_failure: Callable[[str, str], object] = lambda failure, trace: None,
    ) -> None:
        if compression not in COMPRESSION:
            raise ValueError(f"compression = {compression!r}: expected 'zstd' or 'none'")
        if chunk_bytes < 1:
            raise ValueError(f"chunk_bytes = {chunk_bytes!r} B: expected at least 1 B")
        if not 0.0 < flush_s < float("inf"):
            raise ValueError(f"flush_s = {flush_s!r} s: expected a positive number of seconds")
        if max_bytes < 0:
            raise ValueError(f"max_bytes = {max_bytes!r} B: expected 0 or more")
        if not 0.0 <= max_duration_s < float("inf"):
            raise ValueError(f"max_duration_s = {max_duration_s!r} s: expected 0 or more seconds")
        self.path = Path(path)
        self.custom_data: dict[str, str] = {}
        settings = FileSettings(compression, chunk_bytes, max_bytes, max_duration_s, waits_for_room)
        self._files = BagFiles(self.path, settings, self.custom_data, overwrite=overwrite)
        self._trimmers: dict[str, Callable[[bytes], bytes]] = {}
        self._is_closed = False
        self._waits_for_room = waits_for_room
        self.failure: OSError | None = None
        self.gaps: list[Gap] = []
        self.not_recorded = 0
        self._gap: Gap | None = None
        self._ended_gaps = 0
        self._flush_s = flush_s / 2
        self._flushed_s = time.monotonic()
        self._lock = threading.Lock()
        self.flusher = SteadyThread("bag flusher", self._keep_flushing, on_failure)
        self.flusher.start()

    @property
    def file_path(self) -> Path:
        """The file that is written."""
        return self._files.file.path

    @property
    def waiting(self) -> int:
        """How much waits to be written, without the chunk that is being gathered [B]."""
        return self._files.waiting

    def add_topic(self, topic: str, message_class: type, qos: QoSProfile) -> None:
        """Add a topic; it must be added before it is written.

        Parameters
        ----------
        qos
            What its publisher offers.

        Raises
        ------
        ValueError
            When the topic was added before, or the type is not installed.
        """
        name = type_name(message_class)
        information = TopicInformation(topic, name, type_hash(name), offered_qos(qos))
        recorded = RecordedType(information, schema_text(name), offered_qos_profiles(qos))
        added = WrittenTopic(message_class, recorded, says_state(message_class, qos))
        trim = trimmer(name)
        with self._writing() as files:
            if topic in files.topics:
                raise ValueError(f"topic {topic} was added before")
            files.add_topic(added)
            if trim is not None:
                self._trimmers[topic] = trim

    def write(
        self, topic: str, message: Any, log_time_ns: int, publish_time_ns: int | None = None
    ) -> None:
        """Write a message.

        Parameters
        ----------
        log_time_ns
            When the message was received [ns].
        publish_time_ns
            When it was sent [ns]; the log time where that is not known.

        Raises
        ------
        ValueError
            When the topic was not added, the message is of another type, a time is out of range
            or the recording is closed.
        OSError
            When the recording could not be written, now or before.
        """
        expected = self._topic(topic).message_class
        if not isinstance(message, expected):
            raise ValueError(
                f"topic {topic} holds {type_name(expected)}, not {type(message).__name__}"
            )
        self.write_serialized(topic, serialize_message(message), log_time_ns, publish_time_ns)

    def write_serialized(
        self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int | None = None
    ) -> bool:
        """Write a message that is serialised already, as a raw subscription gives it.

        Parameters and errors as for :meth:`write`.

        Returns
        -------
        bool
            Whether it is, or will be, recorded; always, but while there is no room.
        """
        if publish_time_ns is None:
            publish_time_ns = log_time_ns
        for name, value in (("log_time_ns", log_time_ns), ("publish_time_ns", publish_time_ns)):
            if not 0 <= value < 2**63:
                raise ValueError(f"{name} = {value!r} ns on topic {topic} is outside [0, 2^63) ns")
        self._topic(topic)
        trim = self._trimmers.get(topic)
        data = trim(data) if trim else data
        with self._writing() as files:
            if self.failure and files.waiting > _MOST_WAITING:
                if self._gap is None:
                    self._gap = Gap(str(self.failure), log_time_ns, log_time_ns)
                    self.gaps.append(self._gap)
                    del self.gaps[:-_MOST_GAPS]
                self._gap.add(log_time_ns)
                self.not_recorded += 1
                files.note_state(topic, data, publish_time_ns)
                return False
            files.write(topic, data, log_time_ns, publish_time_ns)
            # The thread that flushes may get no processor while messages keep coming.
            if time.monotonic() - self._flushed_s >= self._flush_s:
                self._flush(files)
        return True

    def note_state(self, topic: str, data: bytes, publish_time_ns: int) -> None:
        """Take a serialised message that is not written for how things stand from now on.

        The next file begins with it if its topic is latched, or describes an actuator.
        """
        self._topic(topic)
        with self._writing() as files:
            files.note_state(topic, data, publish_time_ns)

    def note_gap(self, gap: Gap) -> None:
        """Tell of messages that did not come here.

        Raises
        ------
        ValueError, OSError
            As of :meth:`write`.
        """
        with self._writing() as files:
            self.gaps.insert(len(self.gaps) - (self._gap is not None), gap)
            del self.gaps[:-_MOST_GAPS]
            self._tell(gap, files)

    def begin_next_file(self, log_time_ns: int) -> None:
        """Begin the next file, unless nothing has been written to this one.

        Parameters
        ----------
        log_time_ns
            Log time of the messages that say how things stand, with which it begins [ns].

        Raises
        ------
        ValueError, OSError
            As for :meth:`write`; ValueError also when the recording is one file.
        """
        with self._writing() as files:
            files.require_folder()
            files.begin_next(log_time_ns)

    def flush(self) -> None:
        """Hand everything written so far to the operating system.

        Raises
        ------
        OSError
            When that could not be written, of a recording that does not wait for room.
        """
        with self._writing() as files:
            self._flush(files)

    def close(self) -> None:
        """Write index and metadata and close; a closed recording stays as it is.

        Raises
        ------
        OSError
            When the recording could not be written, now or before.
        """
        self.flusher.end()
        with self._lock:
            if self._is_closed:
                return
            self._is_closed = True
            if self.failure and not self._waits_for_room:
                self._files.abandon()
                raise self.failure
            self._end_gap(self._files)
            self._files.close()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _topic(self, topic: str) -> WrittenTopic:
        topics = self._files.topics
        if topic not in topics:
            known = ", ".join(topics) or "none"
            raise ValueError(f"topic {topic!r} was not added to the recording; added: {known}")
        return topics[topic]

    @contextmanager
    def _writing(self) -> Iterator[BagFiles]:
        """Give the files to one thread at a time, until they are closed or fail for good."""
        with self._lock:
            if self.failure and not self._waits_for_room:
                raise self.failure
            if self._is_closed:
                raise ValueError(f"the recording {self.path} is closed")
            try:
                yield self._files
            except OSError as error:
                self.failure = error
                if not self._waits_for_room:
                    raise

    def _flush(self, files: BagFiles) -> None:
        """Hand everything to the operating system, and note that there is room again."""
        self._flushed_s = time.monotonic()
        files.flush()
        if self.failure:
            self.failure = None
            self._end_gap(files)
            files.flush()

    def _end_gap(self, files: BagFiles) -> None:
        """Tell of the gap that has just ended, if there is one."""
        gap, self._gap = self._gap, None
        if gap is not None:
            self._tell(gap, files)

    def _tell(self, gap: Gap, files: BagFiles) -> None:
        """Write of a gap to the file, and to the metadata of the recording."""
        files.note_gap(gap)
        self._ended_gaps += 1
        self.custom_data[f"gap {self._ended_gaps}"] = str(gap)
        earlier = self._ended_gaps - _MOST_GAPS
        if self.custom_data.pop(f"gap {earlier}", None):
            self.custom_data["earlier gaps"] = f"{earlier}, each in a record of its file"

    def _keep_flushing(self) -> None:
        # The library itself ends a chunk by size only.
        while not self.flusher.ending.wait(self._flush_s):
            try:
                self.flush()
            except OSError:  # the next call of write or close raises it
                self.flusher.ending.set()
