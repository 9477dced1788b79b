# SPDX-License-Identifier: Apache-2.0
"""A new baseline is not a repair: faults that it hides stay in the history."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from ema_core.event_kinds import EventKind
from ema_core.levels import ERROR, OK, WARN
from ema_monitor.prognosis.event_texts import text_of
from ema_monitor.prognosis.events import UnitEvent
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit

from .made_tests import UNIT, made_test

HOURS = PrognosisSettings(service=Service(hours_per_cycle=10.0))


def follow(unit: Unit, first: int, frictions: Sequence[float], baseline: str) -> list[UnitEvent]:
    """Return the events of tests that are identified with a calibration."""
    events = list[UnitEvent]()
    for number, friction in enumerate(frictions, first):
        test = replace(made_test(number, seed=5, friction=friction), calibration_id=baseline)
        outlook = unit.update(test, None, HOURS)
        assert outlook is not None
        events += outlook.events
    return events


@pytest.mark.parametrize("worn", [0.4, 0.15])
def test_level_that_falls_with_a_new_baseline_is_not_a_repair(worn: float):
    unit = Unit(History(*UNIT), HOURS)
    follow(unit, 0, [worn] * 8, "first")
    events = follow(unit, 8, [0.0] * 8, "second")
    assert not [event for event in events if event.kind in ("repair", "step")]
    changes = [text_of(event.occurrence) for event in events if event.kind is EventKind.CALIBRATION]
    assert changes[0] == "second instead of first"
    assert any("the baseline changed" in text and "friction fell from" in text for text in changes)


@pytest.mark.parametrize("change", [0, 1])
def test_repair_with_an_unchanged_baseline_is_a_repair(change: int):
    unit = Unit(History(*UNIT), HOURS)
    follow(unit, 0, [0.4] * 8, "first")
    # The baseline was changed well before, to a similar one.
    baseline = "second" if change else "first"
    follow(unit, 8, [0.4] * 8, baseline)
    events = follow(unit, 16, [0.0] * 4, baseline)
    assert [event.kind for event in events if event.kind in ("repair", "calibration")] == ["repair"]


def test_alarm_names_its_cause_until_it_ends(tmp_path: Path):
    unit = Unit(History(*UNIT, tmp_path / "unit.sqlite"), HOURS)
    assert unit.alarm(None, HOURS) == ""
    follow(unit, 0, [0.02] * 4, "first")
    assert unit.alarm(None, HOURS) == ""
    follow(unit, 4, [0.4] * 4, "first")
    assert unit.alarm(None, HOURS).startswith("friction 0.4")
    unit.history.close()
    again = Unit(History(*UNIT, tmp_path / "unit.sqlite"), HOURS)
    assert again.alarm(None, HOURS).startswith("friction 0.4")
    # A refused test ends an OK, but not an alarm.
    again.update(made_test(8, valid=False), None, HOURS)
    assert again.alarm(None, HOURS)
    again.update(made_test(9, valid=False, failed=True), None, HOURS)
    assert again.alarm(None, HOURS) == "a phase is open"
    again.history.close()


def test_changed_baseline_stays_in_the_history_with_author_and_earlier_values(tmp_path: Path):
    path = tmp_path / "unit.sqlite"
    unit = Unit(History(*UNIT, path), HOURS)
    assert not unit.change_baseline("Ada", "second", is_forced=True)
    follow(unit, 0, [0.4] * 5, "first")
    assert unit.change_baseline("Ada", "second", is_forced=True)
    outlook = unit.resume(None, HOURS)
    assert outlook is not None
    [event] = outlook.events
    assert (event.kind, outlook.health.level) == (EventKind.CALIBRATION, WARN)
    assert text_of(event.occurrence).startswith(
        "baseline changed by Ada, forced: second instead of first, which showed friction 0.39"
    ) or text_of(event.occurrence).startswith(
        "baseline changed by Ada, forced: second instead of first, which showed friction 0.40"
    )
    assert math.isfinite(event.flight_hours)
    follow(unit, 5, [0.0] * 30, "second")
    unit.history.close()
    again = Unit(History(*UNIT, path), HOURS)
    tests, _ = again.latest_tests(100)
    kept = [item for test in tests if test.assessment for item in test.assessment.events]
    assert event in kept
    assert not [item for item in kept if item.kind == "repair"]
    assert tests[-1].assessment is not None
    assert tests[-1].assessment.level == OK
    # The OK is shown together with the change of the baseline, also after a restart.
    now = again.resume(None, HOURS)
    assert now is not None
    assert now.health.level == OK
    assert text_of(event.occurrence) in now.health.reason
    assert ERROR not in [test.assessment.level for test in tests if test.assessment]


def test_baseline_of_a_healthy_state_is_not_named_next_to_the_level():
    unit = Unit(History(*UNIT), HOURS)
    follow(unit, 0, [0.0] * 5, "first")
    assert unit.change_baseline("Ada", "second")
    unit.resume(None, HOURS)
    follow(unit, 5, [0.0] * 5, "second")
    outlook = unit.resume(None, HOURS)
    assert outlook is not None
    assert outlook.health.level == OK
    assert "Ada" not in outlook.health.reason
