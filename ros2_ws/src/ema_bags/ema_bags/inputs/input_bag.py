# SPDX-License-Identifier: Apache-2.0
"""A third-party bag as mapped series."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Self

from ema_bags.inputs.bags import bag_series, open_bag, recorded_joints
from ema_bags.inputs.guess import Guess
from ema_bags.inputs.input_file import MOST_LISTED, InputFile
from ema_bags.inputs.joint_messages import JOINT_STATE
from ema_bags.inputs.joint_sources import EFFORT_UNIT
from ema_bags.inputs.mapping import Clock, ColumnMapping
from ema_bags.inputs.series import Series
from ema_core.description import ActuatorDescription


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
        """Raise ValueError, because a bag has no columns."""
        raise ValueError(f"{self.path} is a bag: expected a table")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the topics."""
        return tuple(self._bag.topics)

    def recognised(
        self, description: ActuatorDescription, clock: Clock | None = None
    ) -> list[tuple[Guess, Mapping[str, Series]]]:
        """Recognise the joints on the topics, in order of decreasing travel."""
        del clock  # messages have stamps
        # The effort of a drive with a data sheet is its current.
        unit = "A" if description.is_modelled else EFFORT_UNIT
        joints = recorded_joints(self._bag, unit)
        if description.is_modelled:
            joints = [joint for joint in joints if joint.guess.mapping.has_command]
        if joints:
            return [(joint.guess, joint.by_topic) for joint in joints]
        topics = self._bag.topics
        has_states = any(topic.type_name == JOINT_STATE for topic in topics.values())
        missing = (
            "recognized as the command" if has_states else f"of type {JOINT_STATE} with a joint"
        )
        listed = ", ".join(f"{name} ({topic.type_name})" for name, topic in topics.items())
        raise ValueError(
            f"{self.path}: no topic {missing}; topics: {listed or 'none'}: write a mapping by "
            "hand, following the examples"
        )

    def contents(self) -> list[str]:
        """Return a line with name, number of messages and type of each of the first 40 topics."""
        topics = list(self._bag.topics.items())[:MOST_LISTED]
        return [f"topic {name}: {topic.count} of {topic.type_name}" for name, topic in topics]
