# SPDX-License-Identifier: Apache-2.0
"""A case of an attack, reproducible from its seed and number."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np


@dataclass
class Case:
    """One case of an attack, its counts and its failures.

    Attributes
    ----------
    seed, number
        All random choices of a case follow from these.
    folder
        A folder for the files of the case.
    counts
        Numbers of events by name.
    failures
        Descriptions of the requirements that failed.
    """

    seed: int
    number: int
    folder: Path
    counts: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)

    def rng(self) -> np.random.Generator:
        """Return a new random generator of the case, in its initial state."""
        return np.random.default_rng([self.seed, self.number])

    def count(self, what: str, times: int = 1) -> None:
        """Add to the count of an event."""
        self.counts[what] += times

    def fail(self, what: str) -> None:
        """Record a failure; the case continues."""
        self.failures.append(what)

    def require(self, holds: bool, what: str) -> None:
        """Record a failure if a requirement does not hold."""
        if not holds:
            self.fail(what)
