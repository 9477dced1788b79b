"""The files of a recording that is being written, one after the other."""

import shutil
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ema_recording.bag_file import BagFile, RecordedType
from ema_recording.gaps import Gap
from ema_recording.held_file import WRITE_BYTES
from ema_recording.metadata import (
    METADATA_FILE,
    FileInformation,
    bag_information,
    write_metadata,
)
from ema_recording.state_messages import StateMessages

_AGAIN_S: Final = 1.0


@dataclass(frozen=True)
class FileSettings:
    """How files are written, and when the next one is begun; as of ``BagWriter``."""

    compression: str
    chunk_bytes: int
    max_bytes: int
    max_duration_s: float
    waits_for_room: bool = False

    @property
    def splits(self) -> bool:
        """Whether there may be several files."""
        return bool(self.max_bytes or self.max_duration_s)


@dataclass(frozen=True)
class WrittenTopic:
    """A topic that is written; ``says_state``: its latest message holds until the next one."""

    message_class: type
    recorded: RecordedType
    says_state: bool


class BagFiles:
    """The files of a recording: one, or those of a folder.

    Each begins with the latest message of each topic that says how things stand. The metadata of
    a folder list those that are closed.

    Parameters
    ----------
    custom_data
        Texts by name for the metadata; what they are then is written with each file.
    overwrite
        Whether a recording that is there already is replaced.

    Attributes
    ----------
    file
        The one that is written.

    Raises
    ------
    FileExistsError
        When the target is there already and is not to be replaced, or is no recording.
    ValueError
        When one file is to be split.
    """

    def __init__(
        self,
        path: Path,
        settings: FileSettings,
        custom_data: Mapping[str, str],
        *,
        overwrite: bool,
    ) -> None:
        self._folder = None if path.suffix == ".mcap" else path
        self._path = path
        self._settings = settings
        self._custom_data = custom_data
        if settings.splits:
            self.require_folder()
        _clear(path, overwrite)
        (self._folder or path.parent).mkdir(parents=True, exist_ok=True)
        self.topics: dict[str, WrittenTopic] = {}
        self._states = StateMessages()
        self._ended: list[FileInformation] = []
        # Files that have ended and are not on the disk yet, and the metadata of the folder.
        self._unwritten: list[BagFile] = []
        self._metadata: dict[str, Any] | None = None
        self._split_after_s = 0.0
        self._number = 0
        self.file = self._next_file()
        try:
            self.file.flush()
        except OSError:
            self.file.abandon()
            self.file.path.unlink()
            raise

    def require_folder(self) -> None:
        """Raise ValueError when there cannot be several files."""
        if self._folder is None:
            raise ValueError(
                f"{self._path} is one file: expected a folder (a name that does not end in .mcap) "
                "for a recording in several files"
            )

    def add_topic(self, topic: WrittenTopic) -> None:
        """Add a topic to this file and those that follow."""
        self.file.add_topic(topic.recorded)
        self.topics[topic.recorded.information.name] = topic

    def write(self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Write a message to this file, or to the next where this one is full.

        Raises
        ------
        OSError
            When the file could not be written; the message waits, as all that follows.
        """
        if self._is_full(log_time_ns) and time.monotonic() >= self._split_after_s:
            try:
                self.begin_next(log_time_ns)
            except OSError:
                if not self._settings.waits_for_room:
                    raise
                self._split_after_s = time.monotonic() + _AGAIN_S
        self._write(topic, data, log_time_ns, publish_time_ns)
        self.note_state(topic, data, publish_time_ns)
        if self.file.waiting >= WRITE_BYTES:
            self.file.write_waiting()

    def begin_next(self, log_time_ns: int) -> None:
        """Begin the next file, with messages of a log time [ns]; an empty one stays the latest."""
        if self.file.information.count:
            # If there is no room for the next one, this one goes on.
            following = self._next_file()
            try:
                self._end()
            except OSError:
                following.abandon()
                following.path.unlink(missing_ok=True)
                raise
            self.file = following
            for topic in self.topics.values():
                self.file.add_topic(topic.recorded)
        for state in self._states:
            self._write(state.topic, state.data, log_time_ns, state.publish_time_ns)
        # Last: what fails here waits, and the file is as it is to be.
        self._write_ended()
        self.file.write_waiting()

    def note_state(self, topic: str, data: bytes, publish_time_ns: int) -> None:
        """Take a message for how things stand, where its topic says that."""
        written = self.topics[topic]
        if self._folder is not None and written.says_state:
            self._states.note(topic, written.message_class, data, publish_time_ns)

    @property
    def waiting(self) -> int:
        """How much is not written yet, without the chunk that is being gathered [B]."""
        return self.file.waiting + sum(file.waiting for file in self._unwritten)

    def note_gap(self, gap: Gap) -> None:
        """Tell of messages that are not recorded."""
        self.file.note_gap(gap)

    def flush(self) -> None:
        """Hand everything so far to the operating system.

        Raises
        ------
        OSError
            When that could not be written; it waits.
        """
        self._write_ended()
        self.file.flush()

    def close(self) -> None:
        """Close the file, and list it in the metadata of the folder.

        Raises
        ------
        OSError
            When what waits could not be written; nothing of it waits any more.
        """
        try:
            self._end()
            self._write_ended()
        except OSError:
            self.abandon()
            raise

    def abandon(self) -> None:
        """Close what could not be written."""
        for file in (*self._unwritten, self.file):
            file.abandon()

    def _end(self) -> None:
        """End the file; what is left of it waits to be written."""
        topics = [topic.recorded.information for topic in self.topics.values()]
        ended = [*self._ended, self.file.information]
        information = bag_information(ended, topics, self._custom_data)
        self.file.finish(information)
        self._ended = ended
        self._unwritten.append(self.file)
        self._metadata = information

    def _write_ended(self) -> None:
        """Write what waits of the files that have ended, and the metadata of the folder."""
        while self._unwritten:
            self._unwritten[0].close()
            del self._unwritten[0]
        if self._folder is not None and self._metadata is not None:
            write_metadata(self._folder, self._metadata)
        self._metadata = None

    def _next_file(self) -> BagFile:
        path = self._path
        if self._folder is not None:
            path = self._folder / f"{self._folder.name}_{self._number}.mcap"
        file = BagFile(path, self._settings.compression, self._settings.chunk_bytes)
        self._number += 1
        return file

    def _is_full(self, log_time_ns: int) -> bool:
        information, settings = self.file.information, self._settings
        if not information.count:
            return False
        age_s = (log_time_ns - information.start_ns) / 1e9
        is_large = settings.max_bytes and self.file.size >= settings.max_bytes
        is_long = settings.max_duration_s and age_s >= settings.max_duration_s
        return bool(is_large or is_long)

    def _write(self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        information = self.topics[topic].recorded.information
        self.file.write(topic, data, log_time_ns, publish_time_ns, information.count)
        information.count += 1


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
