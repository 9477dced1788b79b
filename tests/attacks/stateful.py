# SPDX-License-Identifier: Apache-2.0
"""Random walks through the states of an object, by hypothesis."""

from typing import Any, cast

import hypothesis
from hypothesis.stateful import RuleBasedStateMachine, invariant, run_state_machine_as_test


class Walk(RuleBasedStateMachine):
    """A walk that counts its steps. Subclasses define the rules."""

    def __init__(self) -> None:
        super().__init__()
        self._steps = 0

    @invariant()
    def step(self) -> None:
        """Count a step of the walk."""
        self._steps += 1


def walk(kind: type[Walk], seed: int, walks: int, steps: int) -> None:
    """Run random walks of a number of steps. hypothesis shortens and prints a failing walk."""
    settings = hypothesis.settings(
        max_examples=walks,
        stateful_step_count=steps,
        deadline=None,
        database=None,
        print_blob=False,
        suppress_health_check=cast(list[hypothesis.HealthCheck], list(hypothesis.HealthCheck)),
    )
    seeded: Any = hypothesis.seed(seed)(type(kind.__name__, (kind,), {}))
    run_state_machine_as_test(seeded, settings=settings)
