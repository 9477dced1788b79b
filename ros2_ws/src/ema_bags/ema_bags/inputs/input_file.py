# SPDX-License-Identifier: Apache-2.0
"""Interface of third-party files: a table or a bag as mapped series."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Self

from ema_bags.inputs.guess import Guess, refine
from ema_bags.inputs.importing import primary_stamps
from ema_bags.inputs.mapping import Clock, ColumnMapping
from ema_bags.inputs.series import Series, join_topics
from ema_core.description import ActuatorDescription

MOST_LISTED = 40
"""Largest number of columns or topics that ``contents`` lists."""


class InputFile(ABC):
    """A third-party file with one or several series.

    Attributes
    ----------
    path
        Path of the file, or folder of the bag or data set.
    """

    path: Path

    @property
    @abstractmethod
    def remarks(self) -> list[str]:
        """Remarks on problems encountered while reading."""

    @abstractmethod
    def series(self, mapping: ColumnMapping) -> Mapping[str, Series]:
        """Return the mapped series by topic; a table has the topic ``""``.

        Raises
        ------
        ValueError
            If a mapped column or topic is missing, or the mapping is for a different kind of file.
        """

    @abstractmethod
    def parts(self, columns: Sequence[str]) -> Iterator[tuple[list[str], Self]]:
        """Yield the values of the given columns, and the rows, of each part with constant values.

        Raises
        ------
        ValueError
            If the file is not a table, or a column is missing.
        """

    @abstractmethod
    def contents(self) -> list[str]:
        """Return lines on the content of the file, one for each of the first columns or topics."""

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the columns or topics."""

    @abstractmethod
    def recognised(
        self, description: ActuatorDescription, clock: Clock | None = None
    ) -> list[tuple[Guess, Mapping[str, Series]]]:
        """Recognise the sources of each joint, before their units and signs are compared.

        Return the mapping of each joint with its mapped series by topic. Arguments and errors
        are the same as in ``guess``.
        """

    def guess(self, description: ActuatorDescription, clock: Clock | None = None) -> Guess:
        """Recognise the mapping of one joint: the first of a table, or the most mobile of a bag.

        Parameters
        ----------
        description
            Description of the actuator.
        clock
            Known clock of a table; None to recognise it.

        Raises
        ------
        ValueError
            If no column or topic looks like the position, or like a command that the drive
            requires.
        """
        first, series = self.recognised(description, clock)[0]
        stamps, _ = primary_stamps(series[first.mapping.position.topic], first.mapping)
        return refine(first, join_topics(series, first.mapping, stamps), stamps, description)
