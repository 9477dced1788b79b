"""A file or bag of any make, with what it holds."""

from collections.abc import Mapping as ByTopic
from pathlib import Path

import numpy as np

from ema_bags.inputs.bags import AnyBag, bag_series, is_bag
from ema_bags.inputs.guess import Guess, guess_columns, guess_topics, refine
from ema_bags.inputs.importing import primary_stamps
from ema_bags.inputs.joining import join_topics
from ema_bags.inputs.mapping import Mapping
from ema_bags.inputs.series import Series
from ema_bags.inputs.tables import TableColumns, read_columns, table_series
from ema_core.description import ActuatorDescription

_MOST_LISTED = 40


class InputFile:
    """A CSV or Parquet file, or a bag.

    Parameters
    ----------
    path
        The file, or the folder of a bag.
    mapping
        Mapping that says how a CSV file is written; None finds out.

    Attributes
    ----------
    remarks
        What was found wrong while reading.

    Raises
    ------
    ValueError
        When it cannot be read.
    OSError
        When it cannot be opened.
    """

    def __init__(self, path: Path, mapping: Mapping | None = None) -> None:
        self.path = path
        self.remarks: list[str] = []
        self._columns: TableColumns | None = None
        self._bag: AnyBag | None = None
        if not path.exists():
            raise FileNotFoundError(2, "there is no such file", str(path))
        if is_bag(path):
            self._bag = AnyBag(path)
            self._note_damage("")
        else:
            self._columns = read_columns(path, mapping.table if mapping else None)

    def series(self, mapping: Mapping) -> ByTopic[str, Series]:
        """Return what a mapping wants, by topic; that of a table has the topic ``""``.

        Raises
        ------
        ValueError
            When it is not there.
        """
        if self._columns is not None:
            if not mapping.is_table:
                raise ValueError(
                    f"{self.path} is a table, but position has topic {mapping.position.topic!r}: "
                    "expected a mapping of columns"
                )
            return {"": table_series(self._columns, mapping)}
        assert self._bag is not None
        if mapping.is_table:
            raise ValueError(
                f"{self.path} is a bag, but position has no topic: expected a mapping of topics"
            )
        known = self._bag.damage
        found, problem = bag_series(self._bag, mapping)
        self._note_damage(known)
        if problem:
            self.remarks.append(problem)
        return found

    def guess(self, description: ActuatorDescription) -> Guess:
        """Return a mapping guessed from what the file holds.

        Raises
        ------
        ValueError
            When it holds nothing that seems to be a position and its command.
        """
        if self._columns is not None:
            first = guess_columns(self._columns)
        else:
            first = guess_topics(*self._topics_and_joints())
        series = self.series(first.mapping)
        stamps, _ = primary_stamps(series[first.mapping.position.topic], first.mapping)
        return refine(first, join_topics(series, first.mapping, stamps), stamps, description)

    def contents(self) -> list[str]:
        """Return what the file holds, a line a column or topic."""
        if self._columns is not None:
            lines = []
            for name, values in list(self._columns.values.items())[:_MOST_LISTED]:
                finite = values[np.isfinite(values)] if values.dtype.kind == "f" else values
                reach = f"{finite.min():.6g} to {finite.max():.6g}" if len(finite) else "no number"
                empty = len(values) - len(finite)
                unit = self._columns.units.get(name, "")
                lines.append(
                    f"column {name!r}{f' [{unit}]' if unit else ''}: {reach}"
                    + (f", {empty} of {len(values)} empty" if empty else "")
                )
            return lines
        assert self._bag is not None
        return [
            f"topic {name}: {topic.count} of {topic.type_name}"
            for name, topic in list(self._bag.topics.items())[:_MOST_LISTED]
        ]

    def _note_damage(self, known: str) -> None:
        """Add what is damaged to the remarks, in the place of what was known of it before."""
        assert self._bag is not None
        if known in self.remarks:
            self.remarks.remove(known)
        if self._bag.damage:
            self.remarks.append(self._bag.damage)

    def _topics_and_joints(self) -> tuple[dict[str, str], dict[str, list[str]]]:
        assert self._bag is not None
        topics = {name: topic.type_name for name, topic in self._bag.topics.items() if topic.count}
        joints = {
            name: self._joints_by_travel(name)
            for name, kind in topics.items()
            if kind == "sensor_msgs/msg/JointState"
        }
        return topics, joints

    def _joints_by_travel(self, topic: str) -> list[str]:
        """Return the joints of a topic, the one that moves most first."""
        assert self._bag is not None
        reach: dict[str, tuple[float, float]] = {}
        for _, message, _, _ in self._bag.messages([topic]):
            for name, position in zip(message.name, message.position, strict=False):
                low, high = reach.get(name, (position, position))
                reach[name] = min(low, position), max(high, position)
        return sorted(reach, key=lambda name: reach[name][0] - reach[name][1])
