"""Random walks through the states of something, by hypothesis, with counts of the states."""

from collections.abc import Mapping
from typing import Any, Final

import hypothesis
from hypothesis.stateful import RuleBasedStateMachine, run_state_machine_as_test

from .case import Case

LEAST_SHARE: Final = 0.01
"""Of the walks that are to reach each state [-]."""

# A walk may be long and slow.
_UNCHECKED: Final[Any] = list(hypothesis.HealthCheck)

LEAST_WALKS: Final = 40
"""Number of walks below which no share is judged: those of one case of the slowest walk.

A state that a tenth of the walks reach is missed by so many with a probability of 1.5 %.
"""


class Walk(RuleBasedStateMachine):
    """A walk; a subclass has rules, and names the states that it reaches.

    Attributes
    ----------
    STATES
        Names of the states that walks are to reach.
    """

    STATES: tuple[str, ...] = ()
    case: Case

    def __init__(self) -> None:
        super().__init__()
        self._reached: set[str] = set()
        self._steps = 0

    @classmethod
    def machine(cls) -> str:
        """Return its name."""
        return cls.__name__.lower()

    def step(self) -> None:
        """Count a step: a rule, whatever it does."""
        self._steps += 1

    def reach(self, state: str, *, when: bool = True) -> None:
        """Note a state that the walk is in, or has been in."""
        if state not in self.STATES:
            raise KeyError(state)
        if when:
            self._reached.add(state)

    def teardown(self) -> None:
        """Count what was reached."""
        name = self.machine()
        self.case.count(f"{name}: walks")
        self.case.count(f"{name}: steps", self._steps)
        for state in self._reached:
            self.case.count(f"{name}: {state}")


def walk(case: Case, kind: type[Walk], walks: int, steps: int) -> None:
    """Do a number of walks, each of so many steps; a failing one is shortened and told."""
    seeded: Any = hypothesis.seed(case.seed * 1_000_003 + case.number)(
        type(kind.__name__, (kind,), {"case": case})
    )
    settings = hypothesis.settings(
        max_examples=walks,
        stateful_step_count=steps,
        deadline=None,
        database=None,
        print_blob=False,
        suppress_health_check=_UNCHECKED,
    )
    try:
        run_state_machine_as_test(seeded, settings=settings)
    except Exception as error:
        told = "\n    ".join(getattr(error, "__notes__", []))
        case.fail(f"{kind.machine()}: {error!r}\n    {told}"[:4000])


def unreached(counts: Mapping[str, int], kind: type[Walk]) -> list[str]:
    """Return the states that too few walks have reached, in words."""
    walks = counts.get(f"{kind.machine()}: walks", 0)
    if walks < LEAST_WALKS:
        return []
    return [
        f"{kind.machine()}: {counts.get(f'{kind.machine()}: {state}', 0)} of {walks} walks reach "
        f"{state!r}, expected {LEAST_SHARE:.0%} of them"
        for state in kind.STATES
        if counts.get(f"{kind.machine()}: {state}", 0) < LEAST_SHARE * walks
    ]
