# SPDX-License-Identifier: Apache-2.0
"""Random walks through the states of something, by hypothesis."""

from typing import Any, cast

import hypothesis
from hypothesis.stateful import RuleBasedStateMachine, invariant, run_state_machine_as_test


class Walk(RuleBasedStateMachine):
    """A walk, which counts its steps; a subclass has rules."""

    def __init__(self) -> None:
        super().__init__()
        self._steps = 0

    @invariant()
    def step(self) -> None:
        """Count a step."""
        self._steps += 1


def walk(kind: type[Walk], seed: int, walks: int, steps: int) -> None:
    """Do a number of walks, each of so many steps; a failing one is shortened and told."""
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
