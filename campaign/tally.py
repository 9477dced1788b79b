"""What a campaign has found so far, in a file from which it is resumed."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final, Self

from ema_core.files import complete_file

_FORMAT: Final = 1


@dataclass
class PartTally:
    """What was found in a part.

    Attributes
    ----------
    done
        Numbers of the cases that were done.
    failures
        What did not hold, by the number of its case.
    spent_s
        Time of all cases, of those that ran at once as well [s].
    worst_s, worst_mb
        Longest case [s], and most memory that a process of a case had [MB].
    counts, worst
        As of `part.Case`, over all cases.
    """

    done: list[int] = field(default_factory=list)
    failures: dict[str, list[str]] = field(default_factory=dict)
    spent_s: float = 0.0
    worst_s: float = 0.0
    worst_mb: float = 0.0
    counts: dict[str, int] = field(default_factory=dict)
    worst: dict[str, float] = field(default_factory=dict)

    def next_number(self, running: set[int]) -> int:
        """Return the first case that is neither done nor running."""
        known = {*self.done, *running}
        return next(number for number in range(len(known) + 1) if number not in known)

    def add(self, number: int, took_s: float, memory_mb: float, result: dict[str, Any]) -> None:
        """Add what was found in a case."""
        self.done = sorted((*self.done, number))
        self.spent_s += took_s
        self.worst_s, self.worst_mb = max(self.worst_s, took_s), max(self.worst_mb, memory_mb)
        for name, count in result["counts"].items():
            self.counts[name] = self.counts.get(name, 0) + count
        for name, value in result["worst"].items():
            self.worst[name] = max(value, self.worst.get(name, value))
        if result["failures"]:
            self.failures[str(number)] = result["failures"]


@dataclass
class Tally:
    """What was found, by part; seed, and the time that was used of the budget [s]."""

    seed: int
    budget_s: float
    used_s: float = 0.0
    parts: dict[str, PartTally] = field(default_factory=dict)

    def of(self, name: str) -> PartTally:
        """Return what was found in a part."""
        return self.parts.setdefault(name, PartTally())

    def save(self, path: Path, **more: Any) -> None:
        """Write all of it, and more entries."""
        with complete_file(path) as partial:
            partial.write_text(json.dumps({"format": _FORMAT, **asdict(self), **more}, indent=1))

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what ``save`` wrote.

        Raises
        ------
        ValueError
            When the file is none of it.
        OSError
            When it cannot be read.
        """
        try:
            content = json.loads(path.read_text())
            if content["format"] != _FORMAT:
                raise ValueError(f"format = {content['format']!r}: expected {_FORMAT}")
            parts = {name: PartTally(**found) for name, found in content["parts"].items()}
            return cls(content["seed"], content["budget_s"], content["used_s"], parts)
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path} is not the state of a campaign: {error!r}") from error
