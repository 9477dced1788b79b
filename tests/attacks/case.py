# SPDX-License-Identifier: Apache-2.0
"""A case of an attack: it is repeated by its seed and number."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np


@dataclass
class Case:
    """One case: what it is made of, and what was found in it.

    Attributes
    ----------
    seed, number
        All that is random in a case follows from these: it is repeated by them.
    folder
        An empty folder of its own, which is kept where the case fails.
    counts
        How often what happened, by name; summed over all cases.
    failures
        What did not hold, in words.
    """

    seed: int
    number: int
    folder: Path
    counts: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)

    def rng(self) -> np.random.Generator:
        """Return its generator, from the start."""
        return np.random.default_rng([self.seed, self.number])

    def count(self, what: str, times: int = 1) -> None:
        """Add to a count."""
        self.counts[what] += times

    def fail(self, what: str) -> None:
        """Note what did not hold; the case goes on."""
        self.failures.append(what)

    def require(self, holds: bool, what: str) -> None:
        """Note what does not hold."""
        if not holds:
            self.fail(what)
