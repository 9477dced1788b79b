"""A third-party bag as mapped series."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Self

from ema_bags.inputs.bags import bag_series, joints_by_travel, open_bag
from ema_bags.inputs.guess import JOINT_STATE, Guess, guess_topics
from ema_bags.inputs.input_file import MOST_LISTED, InputFile
from ema_bags.inputs.mapping import Clock, ColumnMapping
from ema_bags.inputs.series import Series


class InputBag(InputFile):
    """A rosbag2 bag in MCAP or SQLite storage.

    Parameters
    ----------
    path
        Path of the bag: a file or a folder.

    Raises
    ------
    ValueError
        If the bag cannot be read.
    OSError
        If the bag cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._problem = ""
        self._bag = open_bag(path)

    @property
    def remarks(self) -> list[str]:
        """Remarks on problems encountered while reading."""
        return [remark for remark in ("; ".join(self._bag.remarks), self._problem) if remark]

    def series(self, mapping: ColumnMapping) -> Mapping[str, Series]:
        """Return the mapped series by topic."""
        if mapping.is_table:
            raise ValueError(
                f"{self.path} is a bag, but position has no topic: expected a mapping of topics"
            )
        series, self._problem = bag_series(self._bag, mapping)
        return series

    def parts(self, columns: Sequence[str]) -> Iterator[tuple[list[str], Self]]:
        """Raise ValueError: a bag has no columns."""
        raise ValueError(f"{self.path} is a bag: expected a table")

    def guess_sources(self, clock: Clock | None, *, needs_command: bool) -> Guess:
        """Guess the sources by the types of the topics, and the joint by its travel."""
        del clock  # messages have stamps
        topics = {name: topic.type_name for name, topic in self._bag.topics.items() if topic.count}
        states = [name for name, kind in topics.items() if kind == JOINT_STATE]
        joints = {name: joints_by_travel(self._bag, name) for name in states}
        return guess_topics(topics, joints, needs_command=needs_command)

    def contents(self) -> list[str]:
        """Describe the topics, one line each."""
        topics = list(self._bag.topics.items())[:MOST_LISTED]
        return [f"topic {name}: {topic.count} of {topic.type_name}" for name, topic in topics]
