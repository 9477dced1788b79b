# SPDX-License-Identifier: Apache-2.0
"""A table as mapped series."""

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from pathlib import Path
from typing import Self

import numpy as np

from ema_bags.inputs.guess import Guess
from ema_bags.inputs.input_file import MOST_LISTED, InputFile
from ema_bags.inputs.mapping import Clock, ColumnMapping
from ema_bags.inputs.series import Series
from ema_bags.inputs.table_joints import TableJoints
from ema_bags.inputs.table_series import table_series
from ema_bags.inputs.tables import read_columns
from ema_core.description import ActuatorDescription


class InputTable(InputFile):
    """A table: CSV, Parquet, a NumPy archive, or a LeRobot data set.

    Parameters
    ----------
    path
        Path of the file, or folder of the data set.
    mapping
        Mapping that defines the CSV format; None to detect it.

    Raises
    ------
    ValueError
        If the file cannot be read.
    OSError
        If the file cannot be opened.
    """

    def __init__(self, path: Path, mapping: ColumnMapping | None = None) -> None:
        self.path = path
        self._problem = ""
        self._columns = read_columns(path, mapping.table if mapping else None)

    @property
    def remarks(self) -> list[str]:
        """Remarks on problems encountered while reading."""
        return [self._problem] if self._problem else []

    def series(self, mapping: ColumnMapping) -> Mapping[str, Series]:
        """Return the mapped series, of the topic ``""``."""
        if not mapping.is_table:
            raise ValueError(
                f"{self.path} is a table, but position has topic {mapping.position.topic!r}: "
                "expected a mapping of columns"
            )
        clock = mapping.clock
        names = [clock.source, *(text for _, text, _ in mapping.wanted())]
        notes = self._columns.notes_of(names)
        if self._columns.is_newest_first(clock):
            notes.append(
                f"{clock.source!r} decreases from row to row: the rows are read in reverse"
            )
        self._problem = "; ".join(notes)
        return {"": table_series(self._columns, mapping)}

    def parts(self, columns: Sequence[str]) -> Iterator[tuple[list[str], Self]]:
        """Yield the given columns' values, and the rows, of each part with constant values."""
        for values, rows in self._columns.parts(columns):
            part = copy(self)
            part._columns = rows
            yield values, part

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return *self._columns.values, *self._columns.texts

    def recognised(
        self, description: ActuatorDescription, clock: Clock | None = None
    ) -> list[tuple[Guess, Mapping[str, Series]]]:
        """Recognise the columns of each joint, from the motion and from their names."""
        guesses = TableJoints(self._columns, clock, description).guesses()
        return [(guess, self.series(guess.mapping)) for guess in guesses]

    def contents(self) -> list[str]:
        """Return a line with name, unit and range of each of the first 40 columns."""
        lines = []
        for name, values in list(self._columns.values.items())[:MOST_LISTED]:
            finite = values[np.isfinite(values)]
            reach = f"{finite.min():.6g} to {finite.max():.6g}" if len(finite) else "no numbers"
            unit = self._columns.units.get(name, "")
            line = f"column {name!r}{f' [{unit}]' if unit else ''}: {reach}"
            if empty := len(values) - len(finite):
                line += f", {empty} of {len(values)} empty"
            lines.append(line)
        return lines
