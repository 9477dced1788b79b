# SPDX-License-Identifier: Apache-2.0
"""Health and growth of a unit whose records are compared with a baseline."""

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest
from tests.monitor.comparisons import (
    END_NS,
    FRICTION_UP,
    HEALTHY,
    HEAVIER,
    NOTHING,
    changed,
    compared,
    comparison,
    not_judged,
)

from ema_core.event_kinds import EventKind
from ema_core.levels import OK, STALE, WARN
from ema_monitor.health import HealthLimits
from ema_monitor.identification.estimate import Estimate
from ema_monitor.joint.comparison import Comparison
from ema_monitor.prognosis.event_texts import text_of
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import UnusedCycle
from ema_monitor.prognosis.outlook import Outlook, outlook_of_one, unknown_outlook
from ema_monitor.prognosis.requirements.requirements import WITHOUT_MODEL, RequirementLimits
from ema_monitor.prognosis.sentences import cause_of_level, reason_of
from ema_monitor.quantities import FRICTION
from ema_monitor.unit import Unit

from .lived_units import TEN_HOURS, plain
from .made_tests import UNIT

NO_FRICTION = comparison(not_judged(FRICTION))
GROWTH = 0.03


def record(number: int, of: Comparison) -> Estimate:
    return compared(of, END_NS + number * 100_000_000_000)


def grown(number: int) -> Comparison:
    """Return friction that rises by 3 % per record, and departs from the third record on."""
    return comparison(changed(FRICTION, GROWTH * number)) if number > 1 else HEALTHY


def followed(of: Iterable[Comparison], path: Path | None = None) -> tuple[Unit, list[Outlook]]:
    unit = Unit(History(*UNIT, path), TEN_HOURS)
    outlooks = [unit.update(record(n, item), None, TEN_HOURS) for n, item in enumerate(of)]
    assert None not in outlooks
    return unit, [item for item in outlooks if item is not None]


def test_growth_of_friction_is_tracked_like_a_fault():
    *_, last = followed(grown(number) for number in range(14))[1]
    # The ratio of friction is 1 + 2 k, with a record every 10 h.
    assert last.trends["friction"] == pytest.approx(GROWTH / 2.0 / 10.0, rel=0.2)
    assert last.rul.known
    assert last.dominant_fault == "friction"
    assert last.health.faults[0].value == pytest.approx(GROWTH * 13 / 2.0, abs=0.02)


def test_life_of_a_joint_mentions_requirements_only_if_they_were_requested():
    """The drive has no model, and usually no requirements."""
    wanted = replace(TEN_HOURS, requirements=RequirementLimits(bandwidth=10.0))
    for settings, are_wanted in ((TEN_HOURS, False), (wanted, True)):
        unit = Unit(History(*UNIT, None), settings)
        last = unit.update(record(0, HEALTHY), None, settings)
        assert last is not None
        assert not last.rul.known
        for reason in (last.rul.reason, last.rul_requirements.reason, last.health.reason):
            assert ("requirements" in reason) <= are_wanted
        assert (WITHOUT_MODEL.reason in last.rul.reason) == are_wanted


def test_departure_warns_before_the_fault_does():
    last = followed([HEALTHY, HEALTHY, FRICTION_UP])[1][-1]
    assert (last.health.level, last.health.faults[0].level) == (WARN, OK)
    assert last.health.health_index < 1.0
    words = "Coulomb friction rose 15.2 % (90 % interval 11.2 to 19.2 %)"
    assert cause_of_level(last) == words
    assert [
        text_of(event.occurrence) for event in last.events if event.kind is EventKind.DEPARTURE
    ] == [words]


def test_record_without_a_judgement_leaves_neither_level_nor_index(tmp_path: Path):
    unit, outlooks = followed([HEALTHY, HEALTHY, NOTHING], tmp_path / "unit.db")
    last = outlooks[-1]
    assert (last.health.level, last.health.confidence) == (STALE, 0.0)
    assert math.isnan(last.health.health_index)
    assert "no excitation: the motor stands still" in reason_of(last)
    unit.history.close()
    again = Unit(History(*UNIT, tmp_path / "unit.db"), TEN_HOURS).resume(None, TEN_HOURS)
    assert again is not None
    assert plain(again) == plain(last)


def test_level_returns_with_the_next_record_that_judges_friction():
    levels = [
        outlook.health.level for outlook in followed([HEALTHY, NO_FRICTION, NOTHING, HEALTHY])[1]
    ]
    assert levels == [OK, STALE, STALE, OK]


def test_unknown_level_names_the_last_known_one():
    for before in (HEALTHY, FRICTION_UP):
        first, *later = followed([before, NO_FRICTION, NO_FRICTION, NOTHING])[1]
        assert {outlook.health.level for outlook in later} == {STALE}
        assert {outlook.known_level for outlook in later} == {first.health.level}


def test_first_record_without_a_judgement_has_no_index():
    refused = UnusedCycle.of(record(0, NOTHING))
    health = unknown_outlook("no valid test so far").after_refusal(refused).health
    assert health.level == STALE
    assert math.isnan(health.health_index)


def test_records_without_friction_do_not_disturb_its_growth():
    plain_growth = followed(grown(number) for number in range(6))[1][-1]
    of = [item for number in range(6) for item in (grown(number), NO_FRICTION)][:-1]
    last = followed(of)[1][-1]
    assert last.health.faults[0].value == pytest.approx(
        plain_growth.health.faults[0].value, abs=0.01
    )


@pytest.mark.parametrize(
    ("of", "level"), [(HEALTHY, OK), (FRICTION_UP, WARN), (HEAVIER, WARN), (NO_FRICTION, STALE)]
)
def test_level_of_a_single_record_is_the_level_of_the_unit(of: Comparison, level: int):
    alone = outlook_of_one(record(0, of), HealthLimits(), "no history")
    assert alone.health.level == level == followed([of])[1][-1].health.level


def test_assessment_without_an_index_survives_storage(tmp_path: Path):
    unit, _ = followed([HEALTHY, NO_FRICTION], tmp_path / "unit.db")
    unit.history.close()
    history = History(*UNIT, tmp_path / "unit.db")
    assert history.problem == ""
    newest = history.assessments[history.entries[-1].stamp_ns]
    assert newest.level == STALE
    assert math.isnan(newest.health_index)


def levels_of(*of: Comparison, confirmations: int = 2) -> list[int]:
    settings = replace(TEN_HOURS, level_confirmations=confirmations)
    unit = Unit(History(*UNIT), settings)
    outlooks = [unit.update(record(n, item), None, settings) for n, item in enumerate(of)]
    return [item.health.level for item in outlooks if item is not None]


def test_warning_of_a_departure_rises_at_once_and_ends_with_the_second_healthy_record():
    of = (HEALTHY, FRICTION_UP, HEALTHY, HEALTHY, FRICTION_UP)
    assert levels_of(*of) == [OK, WARN, WARN, OK, WARN]
    assert levels_of(*of, confirmations=1) == [OK, WARN, OK, OK, WARN]
    assert levels_of(*of, confirmations=3) == [OK, WARN, WARN, WARN, WARN]


def test_record_without_friction_confirms_nothing():
    of = (FRICTION_UP, HEALTHY, NO_FRICTION, HEALTHY)
    assert levels_of(*of) == [WARN, WARN, STALE, OK]
    assert levels_of(FRICTION_UP, NO_FRICTION, HEALTHY, HEALTHY) == [WARN, STALE, WARN, OK]


def test_held_warning_states_what_the_next_record_has_to_show():
    last = followed([HEALTHY, FRICTION_UP, HEALTHY])[1][-1]
    assert cause_of_level(last) == (
        "Coulomb friction rose 15.2 % (90 % interval 11.2 to 19.2 %), in an earlier record: the "
        "next record must confirm that it has ended"
    )
    assert last.health.health_index <= 0.99


def test_level_is_the_same_after_a_restart(tmp_path: Path):
    unit, outlooks = followed([FRICTION_UP, HEALTHY], tmp_path / "unit.db")
    unit.history.close()
    again = Unit(History(*UNIT, tmp_path / "unit.db"), TEN_HOURS).resume(None, TEN_HOURS)
    assert again is not None
    assert again.health.level == outlooks[-1].health.level == WARN
