# SPDX-License-Identifier: Apache-2.0
"""Reading of rosbag2 recordings in MCAP, including the intact part of damaged recordings."""

import shutil
import tempfile
import weakref
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import zstandard

from ema_bags.gaps import Gap
from ema_bags.mcap_file import Contents, DamageError, Stretch, read_contents, read_messages
from ema_bags.recording import MessagePlace, Recorded, Recording, Topic
from ema_bags.schema import decoder, schema_text
from ema_core.expecting import require_type
from ema_core.files import require_regular_file
from ema_core.wording import counted

_MOST_GAPS: Final = 10


class Bag(Recording):
    """A recording: one ``.mcap`` file, or a folder written by ``ros2 bag record``.

    Messages and files that rosbag2 compressed by zstd are unpacked. A file that was not closed, is
    truncated or lost its index is read once when the recording is opened. A damaged chunk is
    skipped as a whole.

    Attributes
    ----------
    topics
        Recorded topics by name.
    start_ns, end_ns
        Log times of the first and last message [ns]; None without messages.
    malformed
        Messages that cannot be decoded; ``damage`` gives the reason, and counts each once.

    Raises
    ------
    FileNotFoundError
        If the file or folder does not exist, or has no recording.
    ValueError
        If a file is empty or not MCAP, if the storage or compression is not supported, or if a
        topic has two types.
    """

    def __init__(self, path: str | Path) -> None:
        require_type("path", path, (str, Path))
        super().__init__(Path(path))
        self._damage: dict[str, None] = {}
        self._is_whole = True
        self._files: dict[Path, Contents] = {}
        self._unpacked: dict[Path, Any] = {}
        if not self.path.exists():
            raise FileNotFoundError(f"{self.path} not found: expected an .mcap file or a folder")
        if self.path.is_dir():
            self._open_folder()
        else:
            self._open_file(self.path)
        self.topics = self._find_topics()
        stretches = [item for contents in self._files.values() for item in contents.stretches]
        self.start_ns = min((stretch.start_ns for stretch in stretches), default=None)
        self.end_ns = max((stretch.end_ns for stretch in stretches), default=None)

    @property
    def writers(self) -> list[str]:
        """Programs that wrote the files, with their versions."""
        return sorted({contents.library for contents in self._files.values()} - {""})

    @property
    def damage(self) -> str:
        """Description of damage and lost messages; empty while the recording seems intact.

        Damaged chunks of an indexed file and malformed messages are detected when they are read.
        """
        return "; ".join([*self._damage, *self.malformed.remarks()])

    @property
    def is_whole(self) -> bool:
        """Whether no message in the part read so far is lost through damage.

        A file that was not closed may lack messages.
        """
        return self._is_whole

    @property
    def gaps(self) -> list[Gap]:
        """Gaps reported by the recorder."""
        return [gap for contents in self._files.values() for gap in contents.gaps]

    @property
    def remarks(self) -> list[str]:
        """Remarks on the recording so far: damage and gaps."""
        gaps = self.gaps
        texts = [f"gap: {gap}" for gap in gaps[:_MOST_GAPS]]
        if more := gaps[_MOST_GAPS:]:
            lacking = counted(sum(gap.messages for gap in more), "message")
            unknown = (
                "" if all(gap.messages for gap in more) else ", and further messages may be missing"
            )
            texts.append(f"{counted(len(more), 'more gap')}: {lacking} not recorded{unknown}")
        return list(filter(None, (self.damage, *texts)))

    def readable_counts(self) -> dict[str, int]:
        """Return the number of readable messages of each topic, by reading all chunks."""
        counts = Counter(item.topic for item in self.raw_messages())
        return {name: counts[name] for name in self.topics}

    def messages(
        self,
        topics: Iterable[str] | None = None,
        first: MessagePlace | None = None,
        last: MessagePlace | None = None,
    ) -> Iterator[Recorded]:
        """Return an iterator of decoded messages, by log time (see ``Recording.messages``)."""
        chosen = self._chosen(topics)
        decoders = {
            name: self._decoder(name, topic) for name, topic in chosen.items() if topic.count
        }
        return self._decoded(decoders, self._in_log_order(chosen, first, last))

    def raw_messages(
        self,
        topics: Iterable[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[Recorded]:
        """Return an iterator of serialised messages, in the order of their log times.

        Parameters
        ----------
        topics
            Names of the topics; None for all.
        start_ns, end_ns
            Log times of the first and last message [ns]; None for no limit.

        Raises
        ------
        ValueError
            If a topic is not in the recording.
        """
        first = None if start_ns is None else MessagePlace(start_ns, -1, -1, -1)
        last = None if end_ns is None else MessagePlace(end_ns + 1, -1, -1, -1)
        return self._in_log_order(self._chosen(topics), first, last)

    def _open_folder(self) -> None:
        from ema_bags.metadata import METADATA_FILE, folder_contents  # imports YAML

        folder = folder_contents(self.path)
        self._note(self.path, *folder.damage)
        for path in folder.files:
            try:
                self._open_file(path)
            except ValueError as error:
                if len(folder.files) == 1:
                    raise
                self._note(self.path, str(error))
        count = sum(contents.counts.total() for contents in self._files.values())
        if folder.message_count is not None and folder.message_count > count:
            listed = f"{METADATA_FILE} lists {counted(folder.message_count, 'message')}"
            self._note(self.path, f"{listed}, but {count} were found")

    def _open_file(self, path: Path) -> None:
        require_regular_file(path)
        try:
            with self._readable(path).open("rb") as file:
                contents = self._files[path] = read_contents(file)
        except ValueError as error:
            raise ValueError(f"{path} {error}") from error
        self._note(path, *contents.damage, is_loss=not contents.is_whole)

    def _readable(self, path: Path) -> Path:
        """Return the path of a file, or of its unpacked copy, which may be partial."""
        if path not in self._unpacked:
            with path.open("rb") as packed:
                if packed.read(len(zstandard.FRAME_HEADER)) != zstandard.FRAME_HEADER:
                    return path
                packed.seek(0)
                unpacked = tempfile.NamedTemporaryFile(prefix="ema_bag_")  # noqa: SIM115
                weakref.finalize(self, unpacked.close)
                reader = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
                try:
                    shutil.copyfileobj(reader, unpacked)
                except zstandard.ZstdError as error:
                    if not unpacked.tell():
                        raise ValueError(
                            f"cannot be unpacked: {error}; expected a file compressed by zstd"
                        ) from error
                unpacked.flush()
                self._unpacked[path] = unpacked
        return Path(self._unpacked[path].name)

    def _note(self, path: Path, *findings: str, is_loss: bool = True) -> None:
        # In a folder, findings name their file.
        self._is_whole = self._is_whole and not (findings and is_loss)
        prefix = "" if path == self.path else f"{path.name}: "
        self._damage.update(dict.fromkeys(f"{prefix}{item}" for item in findings))

    def _find_topics(self) -> dict[str, Topic]:
        topics: dict[str, Topic] = {}
        for contents in self._files.values():
            for number, channel in contents.channels.items():
                schema = contents.schemas.get(channel.schema_id)
                is_text = schema is not None and schema.encoding == "ros2msg"
                before = topics.get(channel.topic)
                topic = Topic(
                    schema.name if schema else "",
                    contents.counts[number] + (before.count if before else 0),
                    channel.message_encoding,
                    channel.metadata.get("topic_type_hash", ""),
                    schema.data.decode("utf-8", "replace") if schema and is_text else "",
                    channel.metadata.get("offered_qos_profiles", ""),
                )
                if before and before.type_name != topic.type_name:
                    raise ValueError(
                        f"{self.path}: topic {channel.topic} has two types, {before.type_name} "
                        f"and {topic.type_name}: expected one type"
                    )
                topics[channel.topic] = topic
        return topics

    def _decoder(self, name: str, topic: Topic) -> Callable[[bytes], Any]:
        try:
            if upgrade := topic.upgrade():
                decode = decoder(topic.type_name, schema_text(topic.type_name))
                return lambda data: decode(upgrade(data))
            return decoder(topic.type_name, topic.schema or schema_text(topic.type_name))
        except ValueError as error:
            raise ValueError(f"{self.path}: topic {name} cannot be decoded: {error}") from error

    def _decoded(
        self, decoders: Mapping[str, Callable[[bytes], Any]], items: Iterable[Recorded]
    ) -> Iterator[Recorded]:
        for item in items:
            try:
                message = decoders[item.topic](item.message)
            except ValueError as error:
                self.malformed.note(item, str(error))
                continue
            yield Recorded(*item[:3], message, item.publish_time_ns)

    def _in_log_order(
        self, chosen: Mapping[str, Topic], first: MessagePlace | None, last: MessagePlace | None
    ) -> Iterator[Recorded]:
        numbers: Counter[str] = Counter()
        # Stretches may overlap in time: messages wait, the earliest last, until no later stretch
        # can contain earlier messages. Equal times stay in the order of the files.
        waiting: list[Recorded] = []
        for file_number, path, stretch in self._stretches(chosen):
            if first and stretch.end_ns < first.log_time_ns:
                continue
            if last and stretch.start_ns > last.log_time_ns:
                break
            while waiting and waiting[-1].log_time_ns < stretch.start_ns:
                yield waiting.pop()
            for item in self._read(file_number, path, stretch, chosen):
                numbers[item.topic] += 1
                if (not first or first <= item.place) and (not last or item.place <= last):
                    waiting.append(item)
            waiting.sort(reverse=True)
        while waiting:
            yield waiting.pop()
        if first or last:
            return
        for name, topic in chosen.items():
            if numbers[name] < topic.count:
                lost = f"{topic.count - numbers[name]} of {topic.count} messages are lost"
                self._note(self.path, f"topic {name}: {lost}")

    def _stretches(self, chosen: Mapping[str, Topic]) -> list[tuple[int, Path, Stretch]]:
        """Return the stretches that may have messages of the topics, ordered by first log time."""
        stretches = []
        for file_number, (path, contents) in enumerate(self._files.items()):
            channels = {n for n, channel in contents.channels.items() if channel.topic in chosen}
            for stretch in contents.stretches:
                if not stretch.channels or stretch.channels & channels:
                    stretches.append((file_number, path, stretch))
        return sorted(stretches, key=lambda item: (item[2].start_ns, item[0], item[2].offset))

    def _read(
        self, file_number: int, path: Path, stretch: Stretch, chosen: Mapping[str, Topic]
    ) -> Iterator[Recorded]:
        """Yield the messages of a stretch; nothing if it is damaged."""
        contents = self._files[path]
        try:
            messages = read_messages(self._readable(path), stretch, contents)
        except DamageError as error:
            self._note(path, f"the chunk at byte {stretch.offset} is lost: {error}")
            return
        for number, stored in enumerate(messages):
            data, channel = stored.data, contents.channels.get(stored.channel_id)
            if channel is None or channel.topic not in chosen:
                continue
            topic = chosen[channel.topic]
            # No CDR message begins with the magic number of zstd.
            if topic.encoding == "cdr" and data.startswith(zstandard.FRAME_HEADER):
                try:
                    data = zstandard.decompress(data)
                except zstandard.ZstdError as error:
                    lost = f"topic {channel.topic}: a compressed message is lost: {error}"
                    self._note(path, lost)
                    continue
            position = MessagePlace(stored.log_time, file_number, stretch.offset, number)
            yield Recorded(position, channel.topic, topic.type_name, data, stored.publish_time)
