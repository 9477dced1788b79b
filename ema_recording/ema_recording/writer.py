"""Writes recordings as rosbag2 does, in MCAP."""

import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message

from ema_recording.bag_file import COMPRESSION, BagFile, RecordedType
from ema_recording.cdr import trimmer
from ema_recording.message_type import type_hash, type_name
from ema_recording.metadata import (
    METADATA_FILE,
    FileInformation,
    TopicInformation,
    bag_information,
    write_metadata,
)
from ema_recording.qos import offered_qos, offered_qos_profiles
from ema_recording.schema import schema_text
from ema_recording.state_messages import StateMessages, says_state


@dataclass(frozen=True)
class _Topic:
    message_class: type
    recorded: RecordedType
    says_state: bool
    trim: Callable[[bytes], bytes] | None


class BagWriter(AbstractContextManager["BagWriter", None]):
    """A recording that is being written.

    Messages are gathered in chunks. A chunk goes to the operating system when it is full, and
    after ``flush_s`` of wall time at the latest, whether or not messages arrive: a process that is
    killed loses what it wrote in the last ``flush_s`` seconds, and the file can be read up to
    there. (When the machine itself loses power, more may be lost.) Any thread may write.

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

    Attributes
    ----------
    file_path
        The file that is written.
    custom_data
        Texts by name for the ``custom_data`` of its metadata, written when it is closed.
    failure
        Why the recording cannot be written any more; None as long as it can. It is known here
        before the next message is refused for it.

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
        self._is_folder = self.path.suffix != ".mcap"
        if not self._is_folder and (max_bytes or max_duration_s):
            raise ValueError(
                f"{path} is one file: expected a folder (a name that does not end in .mcap) for a "
                "recording that is split"
            )
        _clear(self.path, overwrite)
        if self._is_folder:
            self.path.mkdir(parents=True)
            self.file_path = self._path_of(0)
        else:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.file_path = self.path
        self._compression, self._chunk_bytes = compression, chunk_bytes
        self._max_bytes, self._max_ns = max_bytes, round(max_duration_s * 1e9)
        self.custom_data: dict[str, str] = {}
        self._topics: dict[str, _Topic] = {}
        self._states = StateMessages()
        self._closed_files: list[FileInformation] = []
        self._file = BagFile(self.file_path, compression, chunk_bytes)
        self.failure: OSError | None = None
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._flusher = threading.Thread(
            target=self._keep_flushing, args=(flush_s / 2,), name="bag flusher", daemon=True
        )
        self._flusher.start()

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
        added = _Topic(message_class, recorded, says_state(message_class, qos), trimmer(name))
        with self._writing() as file:
            if topic in self._topics:
                raise ValueError(f"topic {topic} was added before")
            file.add_topic(recorded)
            self._topics[topic] = added

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
    ) -> None:
        """Write a message that is serialised already, as a raw subscription gives it.

        Parameters and errors as for :meth:`write`.
        """
        if publish_time_ns is None:
            publish_time_ns = log_time_ns
        for name, value in (("log_time_ns", log_time_ns), ("publish_time_ns", publish_time_ns)):
            if not 0 <= value < 2**63:
                raise ValueError(f"{name} = {value!r} ns on topic {topic} is outside [0, 2^63) ns")
        trim = self._topic(topic).trim
        data = trim(data) if trim else data
        with self._writing():
            if self._is_full(log_time_ns):
                self._begin_next(log_time_ns)
            self._write(topic, data, log_time_ns, publish_time_ns)
            self._note_state(topic, data, publish_time_ns)

    def note_state(self, topic: str, data: bytes, publish_time_ns: int) -> None:
        """Take a serialised message that is not written for how things stand from now on.

        The next file begins with it if its topic is latched, or describes an actuator.
        """
        with self._lock:
            self._note_state(topic, data, publish_time_ns)

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
        with self._writing():
            if not self._is_folder:
                raise ValueError(f"{self.path} is one file: expected a folder")
            if self._file.information.count:
                self._begin_next(log_time_ns)
            else:
                self._write_states(log_time_ns)

    def flush(self) -> None:
        """Hand everything written so far to the operating system."""
        with self._writing() as file:
            file.flush()

    def close(self) -> None:
        """Write index and metadata and close; a closed recording stays as it is.

        Raises
        ------
        OSError
            When the recording could not be written, now or before.
        """
        self._closing.set()
        self._flusher.join()
        with self._lock:
            if self._file.is_closed:
                return
            if self.failure:
                self._file.abandon()
                raise self.failure
            self._close_file()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _topic(self, topic: str) -> _Topic:
        if topic not in self._topics:
            known = ", ".join(self._topics) or "none"
            raise ValueError(f"topic {topic!r} was not added to the recording; added: {known}")
        return self._topics[topic]

    def _path_of(self, number: int) -> Path:
        return self.path / f"{self.path.name}_{number}.mcap"

    def _is_full(self, log_time_ns: int) -> bool:
        information = self._file.information
        if not information.count:
            return False
        age_ns = log_time_ns - information.start_ns
        return bool(
            (self._max_bytes and self._file.size >= self._max_bytes)
            or (self._max_ns and age_ns >= self._max_ns)
        )

    def _begin_next(self, log_time_ns: int) -> None:
        self._close_file()
        self.file_path = self._path_of(len(self._closed_files))
        self._file = BagFile(self.file_path, self._compression, self._chunk_bytes)
        for topic in self._topics.values():
            self._file.add_topic(topic.recorded)
        self._write_states(log_time_ns)

    def _write_states(self, log_time_ns: int) -> None:
        for state in self._states:
            self._write(state.topic, state.data, log_time_ns, state.publish_time_ns)

    def _write(self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        information = self._topics[topic].recorded.information
        self._file.write(topic, data, log_time_ns, publish_time_ns, information.count)
        information.count += 1

    def _note_state(self, topic: str, data: bytes, publish_time_ns: int) -> None:
        added = self._topic(topic)
        if self._is_folder and added.says_state:
            self._states.note(topic, added.message_class, data, publish_time_ns)

    def _close_file(self) -> None:
        """Close the file, and list it in the metadata of the folder."""
        files = [*self._closed_files, self._file.information]
        topics = [topic.recorded.information for topic in self._topics.values()]
        information = bag_information(files, topics, self.custom_data)
        self._file.close(information)
        if self._is_folder:
            write_metadata(self.path, information)
        self._closed_files = files

    @contextmanager
    def _writing(self) -> Iterator[BagFile]:
        """Give the file to one thread at a time, until it is closed or fails."""
        with self._lock:
            if self.failure:
                raise self.failure
            if self._file.is_closed:
                raise ValueError(f"the recording {self.path} is closed")
            try:
                yield self._file
            except OSError as error:
                self.failure = error
                raise

    def _keep_flushing(self, period_s: float) -> None:
        # The library itself ends a chunk by size only.
        while not self._closing.wait(period_s):
            try:
                self.flush()
            except OSError:
                return  # the next call of write or close raises it


def _clear(path: Path, overwrite: bool) -> None:
    """Remove a recording from a path, if that is allowed; raise if anything else is there."""
    if not path.exists():
        return
    if not overwrite:
        raise FileExistsError(f"{path} is there already")
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
        raise FileExistsError(f"{path} is not a recording alone: it is not replaced")
