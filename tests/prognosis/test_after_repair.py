# SPDX-License-Identifier: Apache-2.0
"""Remaining life and removal after a repair, and next to the level OK."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ema_core.levels import ERROR, OK, WARN
from ema_monitor.health import Health
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.forecaster import warned_if_due
from ema_monitor.prognosis.growth.prediction import LEAST_TESTS
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.outlook import Outlook, Removal
from ema_monitor.prognosis.sentences import removal_text
from ema_monitor.unit import Unit

from .lived_units import TEN_HOURS
from .made_tests import UNIT, made_test

LAWS = {
    "all grow": (0.05, 1.5e-3, 1.2e-3),
    "one falls far, two by little": (0.03, 7e-4, 4e-4),
    "one grows": (0.06, 0.0, 0.0),
}


def worn_test(
    number: int, hours: float, law: tuple[float, float, float], rng: np.random.Generator
) -> Estimate:
    """Return a test: friction grows exponentially, backlash and a short circuit grow linearly."""
    shape, backlash, short_circuit = law
    return made_test(
        number,
        rng=rng,
        friction=min(shape * math.expm1(8.5e-3 * hours), 0.9),
        backlash=backlash * hours,
        short_circuit_a=short_circuit * max(0.0, hours - 100.0),
    )


def repaired(law: tuple[float, float, float], seed: int, later: int) -> tuple[Unit, list[Outlook]]:
    """Return a unit that fails, is repaired completely and wears again, and its later outlooks."""
    rng, unit, number = np.random.default_rng(seed), Unit(History(*UNIT), TEN_HOURS), 0
    outlook = None
    while outlook is None or outlook.health.level != ERROR:
        outlook = unit.update(worn_test(number, 10.0 * number, law, rng), None, TEN_HOURS)
        number += 1
    made = []
    for after in range(later):
        test = worn_test(number + after, 10.0 * after, law, rng)
        made.append(unit.update(test, None, TEN_HOURS))
    return unit, [item for item in made if item is not None]


@pytest.mark.parametrize("law", LAWS.values(), ids=list(LAWS))
@pytest.mark.parametrize("seed", [1, 2])
def test_no_life_is_reported_before_five_tests_after_a_repair(law, seed):
    unit, made = repaired(law, seed, later=12)
    kinds = [[event.kind for event in outlook.events] for outlook in made]
    last = max(number for number, some in enumerate(kinds) if "repair" in some)
    soon = made[last : last + LEAST_TESTS - 1]
    assert OK in {outlook.health.level for outlook in soon}
    for number, outlook in enumerate(soon, start=1):
        begin = f"the repair or new baseline at {made[last].flight_hours:,.0f} h"
        assert f"fewer than 5 tests since {begin}" in outlook.rul.reason
        assert f"about {LEAST_TESTS - number} more test" in outlook.rul.reason
        assert not any(life.known for life in outlook.lives.values())
        assert math.isnan(outlook.removal.hours)
        assert not outlook.lifetimes.size
        assert removal_text(outlook).startswith("No removal date yet: fewer than 5 tests")
    assert "repair" not in made[last + LEAST_TESTS].rul.reason
    # Replaying the tests gives the same outlooks.
    again = Unit(unit.history, TEN_HOURS).resume(None, TEN_HOURS)
    assert again is not None
    assert repr(again.rul) == repr(made[-1].rul)


def test_state_of_the_tracker_includes_the_repair():
    unit, _ = repaired(LAWS["all grow"], 1, later=3)
    tracker = unit.growth.tracker
    assert tracker.unsupported
    kept = unit.growth.state()
    unit.history.growth = kept
    restored = Unit(unit.history, TEN_HOURS).growth
    assert restored.kept_tests == unit.growth.tests
    assert restored.tracker.unsupported == tracker.unsupported


def test_removal_that_is_due_is_never_next_to_ok():
    healthy = Health(OK, 0.9, 0, 1.0, "", reason="a remark")
    health = warned_if_due(healthy, Removal(0.05, 0.0))
    assert (health.level, health.severity) == (WARN, 1)
    assert health.reason == "removal is due: 5 % risk of failure in 0 h; a remark"
    for removal in (Removal(0.05, 38.0), Removal()):
        assert warned_if_due(healthy, removal) == healthy
    failed = replace(healthy, level=ERROR)
    assert warned_if_due(failed, Removal(0.05, 0.0)) == failed
