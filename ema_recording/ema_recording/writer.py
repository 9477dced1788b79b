"""Writes recordings as rosbag2 does, in MCAP."""

import shutil
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from mcap.writer import CompressionType, Writer
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message

from ema_core import __version__
from ema_recording.message_type import type_hash, type_name
from ema_recording.metadata import (
    METADATA_FILE,
    NEVER_NS,
    TopicInformation,
    bag_information,
    serialized_metadata,
    write_metadata,
)
from ema_recording.qos import offered_qos, offered_qos_profiles
from ema_recording.schema import schema_text

_COMPRESSION = {"zstd": CompressionType.ZSTD, "none": CompressionType.NONE}


@dataclass
class _Channel:
    number: int
    message_class: type
    information: TopicInformation


class BagWriter(AbstractContextManager["BagWriter", None]):
    """A recording that is being written.

    Messages are gathered in chunks. A chunk goes to the operating system when it is full, and
    after ``flush_s`` of wall time at the latest, whether or not messages arrive: a process that is
    killed loses what it wrote in the last ``flush_s`` seconds, and the file can be read up to
    there. (When the machine itself loses power, more may be lost.) Any thread may write.

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
    overwrite
        Whether a recording that is there already is replaced.

    Attributes
    ----------
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
        overwrite: bool = False,
    ) -> None:
        if compression not in _COMPRESSION:
            raise ValueError(f"compression = {compression!r}: expected 'zstd' or 'none'")
        if chunk_bytes < 1:
            raise ValueError(f"chunk_bytes = {chunk_bytes!r} B: expected at least 1 B")
        if not 0.0 < flush_s < float("inf"):
            raise ValueError(f"flush_s = {flush_s!r} s: expected a positive number of seconds")
        self.path = Path(path)
        _clear(self.path, overwrite)
        if self.path.suffix == ".mcap":
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.file_path = self.path
        else:
            self.path.mkdir(parents=True)
            self.file_path = self.path / f"{self.path.name}_0.mcap"
        self.custom_data: dict[str, str] = {}
        self._channels: dict[str, _Channel] = {}
        self._schemas: dict[str, int] = {}
        self._start_ns, self._end_ns = NEVER_NS, 0
        self._file = self.file_path.open("xb")
        self._mcap = Writer(self._file, chunk_bytes, _COMPRESSION[compression])
        self._mcap.start(profile="ros2", library=f"ema_recording {__version__}")
        self._mcap.flush()
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
        schema, version = schema_text(name), type_hash(name)
        with self._writing() as mcap:
            if topic in self._channels:
                raise ValueError(f"topic {topic} was added before")
            if name not in self._schemas:
                self._schemas[name] = mcap.register_schema(name, "ros2msg", schema.encode())
            number = mcap.register_channel(
                topic,
                "cdr",
                self._schemas[name],
                {"offered_qos_profiles": offered_qos_profiles(qos), "topic_type_hash": version},
            )
            information = TopicInformation(topic, name, version, offered_qos(qos))
            self._channels[topic] = _Channel(number, message_class, information)

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
        expected = self._channel(topic).message_class
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
        channel = self._channel(topic)
        if publish_time_ns is None:
            publish_time_ns = log_time_ns
        for name, value in (("log_time_ns", log_time_ns), ("publish_time_ns", publish_time_ns)):
            if not 0 <= value < 2**63:
                raise ValueError(f"{name} = {value!r} ns on topic {topic} is outside [0, 2^63) ns")
        with self._writing() as mcap:
            sequence = channel.information.count % 2**32
            mcap.add_message(channel.number, log_time_ns, data, publish_time_ns, sequence)
            channel.information.count += 1
            self._start_ns = min(self._start_ns, log_time_ns)
            self._end_ns = max(self._end_ns, log_time_ns)

    def flush(self) -> None:
        """Hand everything written so far to the operating system."""
        with self._writing() as mcap:
            mcap.flush()

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
            if self._file.closed:
                return
            with self._file:
                if self.failure:
                    raise self.failure
                information = bag_information(
                    self.file_path.name,
                    [channel.information for channel in self._channels.values()],
                    self._start_ns,
                    self._end_ns,
                    self.custom_data,
                )
                record = {"serialized_metadata": serialized_metadata(information)}
                self._mcap.add_metadata("rosbag2", record)
                self._mcap.finish()
            if self.file_path != self.path:
                write_metadata(self.path, information)

    def __exit__(self, *_: object) -> None:
        self.close()

    def _channel(self, topic: str) -> _Channel:
        if topic not in self._channels:
            known = ", ".join(self._channels) or "none"
            raise ValueError(f"topic {topic!r} was not added to the recording; added: {known}")
        return self._channels[topic]

    @contextmanager
    def _writing(self) -> Iterator[Writer]:
        """Give the MCAP writer to one thread at a time, until it is closed or fails."""
        with self._lock:
            if self.failure:
                raise self.failure
            if self._file.closed:
                raise ValueError(f"the recording {self.path} is closed")
            try:
                yield self._mcap
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
