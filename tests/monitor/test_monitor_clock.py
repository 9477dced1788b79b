# SPDX-License-Identifier: Apache-2.0
"""The monitor of the library when the clock of its telemetry goes back."""

import time
from collections.abc import Sequence
from dataclasses import replace

import pytest

from ema_core.levels import ERROR, OK, STALE
from ema_monitor import Monitor, MonitorSettings, Outlook
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit
from ema_sim import simulate

from ..prognosis.made_tests import UNIT, hiding, made_test

MINUTE_NS = 60 * 10**9
PAST_NS = 1_700_000_000 * 10**9


def outlooks(monitor: Monitor, tests: Sequence[tuple[int, float]]) -> list[Outlook]:
    """Feed tests, given by start [ns] and friction; return the outlooks."""
    made = []
    for number, (start_ns, friction) in enumerate(tests):
        telemetry = simulate({"friction": friction}, seed=number, current_noise=0.02)
        telemetry = replace(telemetry, stamp_ns=start_ns + telemetry.stamp_ns)
        made += [event for event in monitor.feed(telemetry) if isinstance(event, Outlook)]
    return made


def course(start_ns: int, back_ns: int) -> list[tuple[int, float]]:
    """Return three healthy tests, a step of the clock, and three tests of a worn unit."""
    healthy = [(start_ns + i * MINUTE_NS, 0.0) for i in range(3)]
    return healthy + [(start_ns + i * MINUTE_NS - back_ns, 0.8) for i in range(3, 6)]


@pytest.mark.parametrize("back_min", [5, 60, 1440])
def test_after_a_backward_step_of_the_clock_the_level_is_unknown(back_min):
    made = outlooks(Monitor(), course(PAST_NS, back_min * MINUTE_NS))
    assert [outlook.health.level for outlook in made] == [OK] * 3 + [STALE] * 3
    assert "the order of the tests is unknown" in made[-1].health.reason
    assert "has_clock = false" in made[-1].health.reason


def test_without_a_clock_the_order_of_feeding_counts():
    settings = MonitorSettings(prognosis=PrognosisSettings(has_clock=False))
    made = outlooks(Monitor(settings=settings), course(PAST_NS, 60 * MINUTE_NS))
    assert [outlook.health.level for outlook in made[:3]] == [OK] * 3
    assert made[-1].health.level == ERROR


def test_tests_are_ordered_by_reception_if_this_computer_goes_back_too(monkeypatch):
    start_ns = time.time_ns() - 10 * MINUTE_NS
    received_ns = start_ns - 50 * MINUTE_NS
    monkeypatch.setattr(time, "time_ns", lambda: received_ns)
    made = outlooks(Monitor(), course(start_ns, 60 * MINUTE_NS))
    assert [outlook.health.level for outlook in made[:3]] == [OK] * 3
    assert made[-1].health.level == ERROR


def test_older_recording_does_not_replace_the_level_of_a_worn_unit():
    """This holds even after a later test of the unit that is unusable or failed."""
    monitor = Monitor()
    worn = outlooks(monitor, [(PAST_NS + i * MINUTE_NS, 0.8) for i in range(3)])
    assert worn[-1].health.level == ERROR
    older_ns = PAST_NS - 1440 * MINUTE_NS
    telemetry = simulate({}, seed=9, current_noise=0.02, causes={"open_phase_a": 1.0})
    telemetry = replace(telemetry, stamp_ns=older_ns + telemetry.stamp_ns)
    list(monitor.feed(telemetry))
    made = outlooks(monitor, [(older_ns + i * MINUTE_NS, 0.0) for i in range(1, 5)])
    assert OK not in [outlook.health.level for outlook in made]


def test_fault_shown_before_a_step_of_the_clock_is_not_recent():
    settings = PrognosisSettings(good_for_s=30.0)
    unit = Unit(History(*UNIT), settings)
    outlook = unit.update(made_test(0), None, settings)
    assert outlook is not None
    assert outlook.health.level == OK
    unit.mark_clock_step()
    outlook = unit.update(hiding(made_test(1), {"backlash"}), None, settings)
    assert outlook is not None
    assert outlook.health.level == STALE
    assert "backlash" in outlook.health.reason
    outlook = unit.update(made_test(2), None, settings)
    assert outlook is not None
    assert outlook.health.level == OK
