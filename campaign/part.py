"""What a part of the campaign is: numbered cases, each repeated by its seed and number."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

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
    steps
        How many steps it has; None for as many as are usual. Fewer are the first of these.
    counts
        How often what happened, by name; summed over all cases.
    worst
        Largest values by name, with their units in the name; the maximum over all cases.
    failures
        What did not hold, in words.
    """

    seed: int
    number: int
    folder: Path
    steps: int | None = None
    counts: Counter[str] = field(default_factory=Counter)
    worst: dict[str, float] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)

    def rng(self, *more: int) -> np.random.Generator:
        """Return a generator of its own for each sequence of further numbers."""
        return np.random.default_rng([self.seed, self.number, *more])

    def count(self, what: str, times: int = 1) -> None:
        """Add to a count."""
        self.counts[what] += times

    def measure(self, what: str, value: float) -> None:
        """Keep the largest of the values of a name."""
        self.worst[what] = max(value, self.worst.get(what, value))

    def fail(self, what: str) -> None:
        """Note what did not hold; the case goes on."""
        self.failures.append(what)

    def require(self, holds: bool, what: str) -> None:
        """Note what does not hold."""
        if not holds:
            self.fail(what)

    def result(self) -> dict[str, Any]:
        """Return what was found, as plain values."""
        return {"counts": dict(self.counts), "worst": self.worst, "failures": self.failures}


@dataclass(frozen=True)
class Goal:
    """How much of something is asked of a campaign, and how much was done.

    Attributes
    ----------
    what
        Its name, in the plural.
    asked, done
        Its numbers.
    otherwise
        What is said where less was done than was asked.
    """

    what: str
    asked: int
    done: int
    otherwise: str = "not reached"

    def __str__(self) -> str:
        words = f"{self.done:,} of {self.asked:,} {self.what}"
        return words if self.done >= self.asked else f"{words}: {self.otherwise}"


@dataclass(frozen=True)
class Part:
    """A part of the campaign.

    Attributes
    ----------
    name
        That of its module.
    summary
        What holds, in one line.
    run
        Does a case; what it raises is a failure.
    usual_s
        About how long a case takes on an idle machine [s]: one that does not fit into what is left
        of the time is not begun.
    limit_s
        Time after which a case is killed, with all processes of its group, and has failed [s].
    share
        Of the time, relative to the other parts.
    slots
        How many of the cases that run at once it takes the place of: one that measures times, or
        starts many processes, takes two.
    most_cases
        How many cases there are; None for any number.
    judge
        Returns what does not hold in the counts over all cases, in words.
    goals
        Returns what is asked of all cases, and what the counts say was done.
    """

    name: str
    summary: str
    run: Callable[[Case], None]
    usual_s: float
    limit_s: float
    share: float = 1.0
    slots: int = 1
    most_cases: int | None = None
    judge: Callable[[Mapping[str, int]], list[str]] = lambda _: []
    goals: Callable[[Mapping[str, int]], list[Goal]] = lambda _: []
