# SPDX-License-Identifier: Apache-2.0
"""Units whose friction and backlash grow over their tests."""

import math
from collections.abc import Iterable
from dataclasses import asdict, replace
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
    """Return friction that grows exponentially, and reaches its limit of 0.5 in test 80."""
    return 0.05 * math.expm1(0.003 * 10.0 * number)


def backlash(number: int) -> float:
    return 0.006 * number


def lived(
    n: int,
    settings: PrognosisSettings = TEN_HOURS,
    path: Path | None = None,
    missing: tuple[int, ...] = (),
    recorded: int = 0,
) -> tuple[Unit, list[Outlook]]:
    """Return a unit with growing friction and backlash after n tests, and its outlooks.

    The first ``recorded`` tests are in the history from the start.

    Its requirements, which take long to compute, are computed only at the latest test.
    """
    tests = [worn(number, valid=number not in missing).estimate for number in range(n)]
    prognostics, outlooks = Unit(history_of(tests[:recorded], path), settings), []
    for estimate in tests[recorded:]:
        parameters = PARAMETERS if estimate is tests[-1] else None
        outlook = prognostics.update(estimate, parameters, settings)
        assert outlook is not None
        assert (outlook.health.level == STALE) == (not estimate.valid)
        outlooks += [outlook] if estimate.valid else []
    return prognostics, outlooks


def plain(outlook: Outlook) -> str:
    """Return the content of an outlook without the events, with all digits."""
    return repr(asdict(replace(outlook, events=())))


class Cycle(NamedTuple):
    """A test cycle: its estimate, and the count before it; NaN without a count."""

    estimate: Estimate
    counted_hours: float = math.nan


def drawn_count(rng: np.random.Generator, number: int) -> float:
    """Return the counted hours at a test: NaN, the right ones (8 per test), or wrong ones."""
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
    """Return the outlook after each cycle, without requirements."""
    outlooks = []
    for estimate, hours in cycles:
        count = None if math.isnan(hours) else Count(estimate.start_ns, hours, 0)
        outlooks.append(prognostics.update(estimate, None, settings, count))
    return outlooks
