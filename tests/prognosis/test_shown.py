# SPDX-License-Identifier: Apache-2.0
"""A level needs every fault, and each fault counts only while the test that showed it is recent."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ema_core.faults import COMPONENTS, FAULT_NAMES
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_core.parameters import ActuatorParameters
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit

from .lived_units import PARAMETERS
from .made_tests import FIRST_NS, PERIOD_NS, UNIT, hiding, made_test

S = 10**9
# Tests are 10 s apart; a level holds for 30 s.
LIVE = PrognosisSettings(good_for_s=30.0)
COMMAND = PrognosisSettings()
HOURS = Service(hours_per_cycle=10.0)


def outlook_after(
    course: Sequence[Collection[str]],
    settings: PrognosisSettings,
    parameters: ActuatorParameters | None = None,
    **faults: float,
) -> Outlook:
    """Return the outlook after tests that each hide some of the faults of a unit."""
    unit, outlook = Unit(History(*UNIT), settings), None
    for number, hidden in enumerate(course):
        seen: dict[str, Any] = {name: value for name, value in faults.items() if name not in hidden}
        test = hiding(made_test(number, **seen), hidden)
        outlook = unit.update(test, parameters, settings, received_ns=test.end_ns + S)
    assert outlook is not None
    return outlook.at(FIRST_NS + (len(course) - 1) * PERIOD_NS + 2 * S)


@pytest.mark.parametrize("service", [Service(), HOURS], ids=["no hours", "hours"])
@pytest.mark.parametrize("settings", [LIVE, COMMAND], ids=["live", "command"])
@pytest.mark.parametrize("name", COMPONENTS)
def test_fault_that_tests_no_longer_show_ends_ok(
    name: str, settings: PrognosisSettings, service: Service
):
    settings = replace(settings, service=service)
    unit = Unit(History(*UNIT), settings)
    for number in range(9):
        hiding_tests = number - 4
        test = hiding(made_test(number), (name,) if hiding_tests > 0 else ())
        outlook = unit.update(test, None, settings, received_ns=test.end_ns + S)
        assert outlook is not None
        outlook = outlook.at(test.end_ns + 2 * S)
        if hiding_tests < 3:
            assert outlook.health.level == OK
            # Service hours combined from several tests are slightly above 0.
            assert outlook.health.health_index == pytest.approx(1.0, abs=1e-3)
            continue
        assert outlook.health.level == STALE
        assert outlook.health.confidence < 1.0
        # From the next test on, the reason names the fault and a motion that shows it.
        if not settings.good_for_s or hiding_tests > 3:
            assert np.isnan(outlook.health.health_index)
            assert "no recent test has shown" in outlook.health.reason


def test_motions_that_show_each_fault_in_turn_stay_ok():
    first, second = COMPONENTS[:4], COMPONENTS[4:]
    for settings in (LIVE, COMMAND, replace(LIVE, service=HOURS)):
        outlook = outlook_after([first, second] * 4, settings)
        assert (outlook.health.level, outlook.health.health_index) == (OK, 1.0)
        assert outlook.health.reason.startswith("not observable in this window: short_circuit")


def test_first_test_that_hides_a_fault_is_not_ok():
    outlook = outlook_after([("backlash",)], LIVE, PARAMETERS)
    assert outlook.health.level == STALE
    assert "backlash (shown by motion that reverses)" in outlook.health.reason
    assert all(
        requirement.level != OK
        for requirement in outlook.health.requirements
        if requirement.name == "free_play"
    )


def test_ok_ends_with_the_oldest_needed_test_and_not_with_the_newest():
    settings = replace(LIVE, service=HOURS)
    unit, outlook = Unit(History(*UNIT), settings), None
    for number, hidden in enumerate([(), ("backlash",), ("backlash",)]):
        test = hiding(made_test(number), hidden)
        outlook = unit.update(test, None, settings, received_ns=test.end_ns)
    assert outlook is not None
    assert outlook.health.level == OK
    assert outlook.claim.good_until_ns == FIRST_NS + 30 * S
    late = outlook.at(FIRST_NS + 31 * S)
    assert late.health.level == STALE
    assert "no test has shown every fault for more than 30 s" in late.health.reason


@pytest.mark.parametrize(("value", "level"), [(0.3, WARN), (0.8, ERROR)])
@pytest.mark.parametrize("service", [Service(), HOURS], ids=["no hours", "hours"])
def test_alarm_of_a_fault_stays_when_tests_stop_showing_it(
    value: float, level: int, service: Service
):
    course = [()] * 4 + [("backlash",)] * 6
    for settings in (LIVE, COMMAND):
        outlook = outlook_after(course, replace(settings, service=service), backlash=value)
        assert outlook.health.level == level


def test_fault_that_needs_many_weak_tests_is_not_shown_by_the_latest():
    """Its tracked sigma is small, but none of the latest tests would show a sudden fault."""
    settings = replace(LIVE, service=HOURS)
    unit = Unit(History(*UNIT), settings)
    outlook = None
    for number in range(12):
        test = made_test(number)
        if number > 5:
            wide = np.where(np.eye(len(FAULT_NAMES), dtype=bool), 0.2**2, 0.0)
            test = replace(test, covariance=np.where(np.isnan(test.covariance), np.nan, wide))
        outlook = unit.update(test, None, settings)
    assert outlook is not None
    assert outlook.health.level == STALE
    assert "short circuit A, short circuit B, short circuit C" in outlook.health.reason


@pytest.mark.parametrize("has_clock", [True, False])
@pytest.mark.parametrize("refused", [True, False])
def test_fault_shown_before_the_clock_went_back_is_not_recent(has_clock: bool, refused: bool):
    """The age of the test is unknown: the tests after the step are moved behind it."""
    settings = replace(LIVE, has_clock=has_clock)
    unit, first = Unit(History(*UNIT), settings), made_test(0)
    unit.update(first, None, settings, received_ns=first.end_ns)
    levels = []
    for number, hidden in enumerate([("backlash",), ("backlash",), ()]):
        now_ns = FIRST_NS + (10 * number - 3600) * S
        if refused:
            test = replace(made_test(0, valid=False), start_ns=now_ns - 2 * S, end_ns=now_ns - S)
            unit.update(test, None, settings, received_ns=now_ns - S)
        test = replace(hiding(made_test(number), hidden), start_ns=now_ns - S // 2, end_ns=now_ns)
        outlook = unit.update(test, None, settings, received_ns=now_ns)
        assert outlook is not None
        levels.append(outlook.at(now_ns + S).health.level)
    assert levels == [STALE, STALE, OK]
