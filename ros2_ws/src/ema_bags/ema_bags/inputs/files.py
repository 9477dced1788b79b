"""Reading of third-party files and bags."""

from collections.abc import Iterator, Sequence
from collections.abc import Mapping as ByTopic
from copy import copy
from pathlib import Path
from typing import Self

import numpy as np

from ema_bags.inputs.bags import AnyBag, bag_series, is_bag, joints_by_travel, open_bag
from ema_bags.inputs.guess import JOINT_STATE, Guess, guess_columns, guess_topics, refine
from ema_bags.inputs.importing import primary_stamps
from ema_bags.inputs.mapping import Clock, Mapping
from ema_bags.inputs.series import Series, join_topics
from ema_bags.inputs.tables import TableColumns, read_columns, table_series
from ema_core.description import ActuatorDescription

_MOST_LISTED = 40


class InputFile:
    """A CSV or Parquet file, or a bag.

    Parameters
    ----------
    path
        Path of the file or of the bag folder.
    mapping
        Mapping that defines the CSV format; None to detect it.

    Raises
    ------
    ValueError
        If the file cannot be read.
    OSError
        If the file cannot be opened.
    """

    def __init__(self, path: Path, mapping: Mapping | None = None) -> None:
        self.path = path
        self._problem = ""
        if not path.exists():
            raise FileNotFoundError(2, "no such file", str(path))
        self._held: TableColumns | AnyBag
        if is_bag(path):
            self._held = open_bag(path)
        else:
            self._held = read_columns(path, mapping.table if mapping else None)

    @property
    def remarks(self) -> list[str]:
        """Remarks on problems encountered while reading."""
        damage = [] if isinstance(self._held, TableColumns) else self._held.remarks
        return [remark for remark in ("; ".join(damage), self._problem) if remark]

    def series(self, mapping: Mapping) -> ByTopic[str, Series]:
        """Return the mapped series by topic; a table has the topic ``""``.

        Raises
        ------
        ValueError
            If a mapped column or topic is missing, or the mapping is for a different kind of file.
        """
        if isinstance(self._held, TableColumns):
            if mapping.is_table:
                clock = mapping.clock
                names = [clock.source, *(text for _, text, _ in mapping.wanted())]
                notes = self._held.notes_of(names)
                if self._held.is_newest_first(clock):
                    notes.append(
                        f"{clock.source!r} decreases from row to row: the rows are read in reverse"
                    )
                self._problem = "; ".join(notes)
                return {"": table_series(self._held, mapping)}
            raise ValueError(
                f"{self.path} is a table, but position has topic {mapping.position.topic!r}: "
                "expected a mapping of columns"
            )
        if mapping.is_table:
            raise ValueError(
                f"{self.path} is a bag, but position has no topic: expected a mapping of topics"
            )
        series, self._problem = bag_series(self._held, mapping)
        return series

    def parts(self, columns: Sequence[str]) -> Iterator[tuple[list[str], Self]]:
        """Split a table where the given columns change; yield their values and the rows.

        Raises
        ------
        ValueError
            If the file is not a table, or a column is missing.
        """
        if not isinstance(self._held, TableColumns):
            raise ValueError(f"{self.path} is a bag: expected a table")
        for values, rows in self._held.parts(columns):
            part = copy(self)
            part._held = rows
            yield values, part

    def guess(self, description: ActuatorDescription, clock: Clock | None = None) -> Guess:
        """Guess a mapping from the content of the file.

        Parameters
        ----------
        description
            Description of the actuator.
        clock
            Known clock of a table; None to guess it.

        Raises
        ------
        ValueError
            If no column or topic looks like the position, or like a command that the drive
            requires.
        """
        held, needs_command = self._held, description.drive != "unknown"
        if isinstance(held, TableColumns):
            first = guess_columns(held, clock, needs_command=needs_command)
        else:
            topics = {name: topic.type_name for name, topic in held.topics.items() if topic.count}
            states = [name for name, kind in topics.items() if kind == JOINT_STATE]
            joints = {name: joints_by_travel(held, name) for name in states}
            first = guess_topics(topics, joints, needs_command=needs_command)
        series = self.series(first.mapping)
        stamps, _ = primary_stamps(series[first.mapping.position.topic], first.mapping)
        return refine(first, join_topics(series, first.mapping, stamps), stamps, description)

    def contents(self) -> list[str]:
        """Describe the content of the file, one line per column or topic."""
        if not isinstance(self._held, TableColumns):
            topics = list(self._held.topics.items())[:_MOST_LISTED]
            return [f"topic {name}: {topic.count} of {topic.type_name}" for name, topic in topics]
        lines = []
        for name, values in list(self._held.values.items())[:_MOST_LISTED]:
            finite = values[np.isfinite(values)]
            reach = f"{finite.min():.6g} to {finite.max():.6g}" if len(finite) else "no numbers"
            unit = self._held.units.get(name, "")
            line = f"column {name!r}{f' [{unit}]' if unit else ''}: {reach}"
            if empty := len(values) - len(finite):
                line += f", {empty} of {len(values)} empty"
            lines.append(line)
        return lines
