"""The files of a recording that is being written, one after the other."""

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ema_recording.bag_file import BagFile, RecordedType
from ema_recording.metadata import (
    METADATA_FILE,
    FileInformation,
    bag_information,
    write_metadata,
)
from ema_recording.state_messages import StateMessages


@dataclass(frozen=True)
class FileSettings:
    """How files are written, and when the next one is begun; as of ``BagWriter``."""

    compression: str
    chunk_bytes: int
    max_bytes: int
    max_duration_s: float

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
        self._closed: list[FileInformation] = []
        self.file = self._next_file()

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
        """Write a message to this file, or to the next where this one is full."""
        if self._is_full(log_time_ns):
            self.begin_next(log_time_ns)
        self._write(topic, data, log_time_ns, publish_time_ns)
        self.note_state(topic, data, publish_time_ns)

    def begin_next(self, log_time_ns: int) -> None:
        """Begin the next file, with messages of a log time [ns]; an empty one stays the latest."""
        if self.file.information.count:
            self.close()
            self.file = self._next_file()
            for topic in self.topics.values():
                self.file.add_topic(topic.recorded)
        for state in self._states:
            self._write(state.topic, state.data, log_time_ns, state.publish_time_ns)

    def note_state(self, topic: str, data: bytes, publish_time_ns: int) -> None:
        """Take a message for how things stand, where its topic says that."""
        written = self.topics[topic]
        if self._folder is not None and written.says_state:
            self._states.note(topic, written.message_class, data, publish_time_ns)

    def close(self) -> None:
        """Close the file, and list it in the metadata of the folder."""
        self._closed.append(self.file.information)
        topics = [topic.recorded.information for topic in self.topics.values()]
        information = bag_information(self._closed, topics, self._custom_data)
        self.file.close(information)
        if self._folder is not None:
            write_metadata(self._folder, information)

    def _next_file(self) -> BagFile:
        path = self._path
        if self._folder is not None:
            path = self._folder / f"{self._folder.name}_{len(self._closed)}.mcap"
        return BagFile(path, self._settings.compression, self._settings.chunk_bytes)

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
