# SPDX-License-Identifier: Apache-2.0
"""Units whose friction and backlash grow over their tests."""

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ema_core.levels import STALE
from ema_core.parameters import ActuatorParameters
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.history_entry import Count
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit

from .made_tests import history_of, made_test

PARAMETERS = ActuatorParameters()
TEN_HOURS = PrognosisSettings(service=Service(hours_per_cycle=10.0))
COUNTED = PrognosisSettings()


def friction(number: int) -> float:
    """Exponential growth, at its limit of 0.5 in test 80."""
    return 0.05 * math.expm1(0.003 * 10.0 * number)


def backlash(number: int) -> float:
    return 0.006 * number


def lived(
    n: int,
    settings: PrognosisSettings = TEN_HOURS,
    path: Path | None = None,
    missing: tuple[int, ...] = (),
    known: int = 0,
) -> tuple[Unit, list[Outlook]]:
    """A unit whose friction and backlash have grown over n tests, of which some were known.

    Its requirements, which take long, are known at the latest test.
    """
    tests = [worn(number, valid=number not in missing).estimate for number in range(n)]
    prognostics, outlooks = Unit(history_of(tests[:known], path), settings), []
    for estimate in tests[known:]:
        parameters = PARAMETERS if estimate is tests[-1] else None
        outlook = prognostics.update(estimate, parameters, settings)
        assert outlook is not None
        assert (outlook.health.level == STALE) == (not estimate.valid)
        outlooks += [outlook] if estimate.valid else []
    return prognostics, outlooks


def plain(outlook: Outlook) -> str:
    """Everything in it but the events, each figure to its last digit."""
    return repr(replace(outlook, events=()))


class Cycle(NamedTuple):
    """A test cycle: its estimate, and what was counted before it; NaN when nothing was."""

    estimate: Estimate
    counted_hours: float = math.nan


def drawn_count(rng: np.random.Generator, number: int) -> float:
    """Hours counted at a test of a number: none, the right ones of 8 a test, or wrong ones."""
    kind = rng.choice(["none", "right", "high", "low"], p=[0.3, 0.5, 0.1, 0.1])
    right = 8.0 * number
    return {"none": math.nan, "right": right, "high": 9.0 * right, "low": right / 4}[kind]


def worn(number: int, counted_hours: float = math.nan, *, valid: bool = True) -> Cycle:
    estimate = made_test(
        number, seed=3, valid=valid, friction=friction(number), backlash=backlash(number)
    )
    return Cycle(estimate, counted_hours)


def follow(
    prognostics: Unit, cycles: Iterable[Cycle], settings: PrognosisSettings = COUNTED
) -> list[Outlook | None]:
    """What is said after each of the cycles, without requirements."""
    outlooks = []
    for estimate, hours in cycles:
        count = None if math.isnan(hours) else Count(estimate.start_ns, hours, 0)
        outlooks.append(prognostics.update(estimate, None, settings, count))
    return outlooks
