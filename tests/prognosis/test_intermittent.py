# SPDX-License-Identifier: Apache-2.0
"""An intermittent fault warns until a person acknowledges it."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema_core.event_kinds import EventKind
from ema_core.levels import ERROR, OK, WARN
from ema_monitor.prognosis.event_texts import text_of
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.sentences import cause_of_level
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit

from .made_tests import FIRST_NS, PERIOD_NS, UNIT, made_test

SETTINGS = [
    PrognosisSettings(good_for_s=30.0),
    PrognosisSettings(service=Service(hours_per_cycle=10.0), good_for_s=30.0),
]


def outlooks(
    frictions: Sequence[float],
    settings: PrognosisSettings,
    unit: Unit | None = None,
    first: int = 0,
) -> tuple[Unit, list[Outlook]]:
    unit = unit or Unit(History(*UNIT), settings)
    made = []
    for number, friction in enumerate(frictions, first):
        outlook = unit.update(made_test(number, seed=3, friction=friction), None, settings)
        assert outlook is not None
        made.append(outlook)
    return unit, made


def levels(made: Sequence[Outlook]) -> list[int]:
    return [outlook.health.level for outlook in made]


@pytest.mark.parametrize("settings", SETTINGS, ids=["no hours", "hours"])
@pytest.mark.parametrize("every", [2, 3, 5, 10])
def test_fault_that_recurs_in_every_nth_test_is_never_ok_again(
    settings: PrognosisSettings, every: int
):
    course = [0.02] * 10 + [0.8 if i % every == every - 1 else 0.02 for i in range(3 * every)]
    made = outlooks(course, settings)[1]
    again = 10 + 2 * every - 1
    # From its first occurrence on.
    assert min(levels(made[again - every :])) >= WARN
    # A test that shows the fault reports it.
    assert made[again].health.level == ERROR
    assert made[-1].health.level == ERROR
    assert max(item.health.health_index for item in made[again:]) == 0.0
    assert "friction is intermittent: beyond its limit in" in cause_of_level(made[-1])
    events = [
        event
        for item in made
        for event in item.events
        if "is intermittent" in text_of(event.occurrence)
    ]
    assert (events[0].kind, events[0].stamp_ns) == (EventKind.FAULT, FIRST_NS + again * PERIOD_NS)


@pytest.mark.parametrize("settings", SETTINGS, ids=["no hours", "hours"])
def test_single_occurrence_and_a_lasting_fault_are_not_intermittent(settings: PrognosisSettings):
    for course in (
        [0.02] * 5 + [0.8] + [0.02] * 10,
        [0.02] * 5 + [0.8] * 5 + [0.02] * 10,  # a repair
        [0.02] * 5 + [0.8] + [0.02] * 25 + [0.8],  # more than 20 tests apart
    ):
        made = outlooks(course, settings)[1]
        assert not any("intermittent" in cause_of_level(outlook) for outlook in made)


@pytest.mark.parametrize("settings", SETTINGS, ids=["no hours", "hours"])
def test_single_occurrence_warns_until_fourteen_tests_are_without_it(settings: PrognosisSettings):
    made = outlooks([0.02] * 5 + [0.8] + [0.02] * 20, settings)[1]
    assert min(levels(made[5:19])) >= WARN
    assert max(levels(made[7:19])) == WARN
    # The level falls after one more test, like each level.
    assert levels(made[20:]) == [OK] * 6
    assert made[6].health.health_index == 0.0
    words = "friction was beyond its limit in one of the latest 4 tests: 11 more tests without it"
    assert words in cause_of_level(made[8])
    [event] = [
        event for item in made for event in item.events if "was beyond" in text_of(event.occurrence)
    ]
    assert (event.kind, event.stamp_ns) == (EventKind.FAULT, FIRST_NS + 6 * PERIOD_NS)


@pytest.mark.parametrize(
    "course",
    [
        [0.02] * 5 + [0.3, 0.45, 0.52] + [0.02] * 5,  # wear and a repair
        [0.02] * 5 + [0.8, 0.8] + [0.02] * 5,  # a failure and a repair
        [0.02] * 5 + [0.51] + [0.02] * 5,  # less than 5 sigma beyond the limit
        [0.8] + [0.02] * 5,
    ],
)
def test_repair_and_a_doubtful_exceedance_are_not_single_occurrences(course: list[float]):
    made = outlooks(course, SETTINGS[1])[1]
    assert made[-1].health.level == OK


@pytest.mark.parametrize("after", [0, 1, 4])
def test_person_acknowledges_a_single_occurrence(tmp_path: Path, after: int):
    settings, path = SETTINGS[1], tmp_path / "unit.sqlite"
    course = [0.02] * 5 + [0.8] + [0.02] * after
    unit, _ = outlooks(course, settings, Unit(History(*UNIT, path), settings))
    unit.note("Ada", "connector replaced", FIRST_NS + 5 * PERIOD_NS)
    made = outlooks([0.02] * 2, settings, unit, first=len(course))[1]
    assert made[-1].health.level == OK
    unit.history.close()
    again = Unit(History(*UNIT, path), settings)
    outlook = again.resume(None, settings)
    assert outlook is not None
    assert outlook.health.level == OK
    again.history.close()


def test_noise_around_the_limit_is_not_intermittent():
    rng = np.random.default_rng(4)
    course = (0.5 + 0.004 * rng.standard_normal(40)).tolist()
    made = outlooks(course, SETTINGS[1])[1]
    assert not any("intermittent" in cause_of_level(outlook) for outlook in made)


def test_person_acknowledges_an_intermittent_fault_by_a_note_also_after_a_restart(tmp_path: Path):
    settings, path = SETTINGS[1], tmp_path / "unit.sqlite"
    course = [0.02] * 5 + [0.8, 0.02, 0.8] + [0.02] * 5
    unit, made = outlooks(course, settings, Unit(History(*UNIT, path), settings))
    assert made[-1].health.level == WARN
    unit.note("Ada", "a bag was changed")  # the stamp of the newest test, not of the event
    outlook = unit.resume(None, settings)
    assert outlook is not None
    assert outlook.health.level == WARN
    unit.note("Ada", "connector replaced", FIRST_NS + 7 * PERIOD_NS)
    made = outlooks([0.02] * 3, settings, unit, first=len(course))[1]
    assert made[-1].health.level == OK
    unit.history.close()
    again = Unit(History(*UNIT, path), settings)
    outlook = again.resume(None, settings)
    assert outlook is not None
    assert outlook.health.level == OK
    # The fault returns: two more occurrences count from zero.
    made = outlooks([0.8, 0.02, 0.8, 0.02], settings, again, first=len(course) + 3)[1]
    assert made[-1].health.level >= WARN
    assert "in 2 of the latest 12 tests" in cause_of_level(made[-1])
    again.history.close()


def test_tests_that_hide_the_fault_report_nothing_about_it():
    settings = SETTINGS[0]
    unit, outlook = Unit(History(*UNIT), settings), None
    for number, friction in enumerate([0.8, 0.0, 0.8, 0.0, 0.8]):
        test = made_test(number, friction=friction)
        if not friction:
            hidden = test.unobservable.copy()
            hidden[0] = True
            test = replace(test, unobservable=hidden)
        outlook = unit.update(test, None, settings)
    assert outlook is not None
    assert outlook.health.level == ERROR
    assert "intermittent" not in cause_of_level(outlook)


def failing(course: str, settings: PrognosisSettings, unit: Unit, first: int = 0) -> list[Outlook]:
    """Return the outlooks after tests that failed (f) or were healthy (.)."""
    made = []
    for number, letter in enumerate(course, first):
        test = made_test(number, valid=letter == ".", failed=letter == "f", friction=0.02)
        outlook = unit.update(test, None, settings)
        assert outlook is not None
        made.append(outlook)
    return made


@pytest.mark.parametrize("settings", SETTINGS, ids=["no hours", "hours"])
@pytest.mark.parametrize("every", [2, 3, 4, 9])
def test_intermittent_failure_is_never_ok_again(settings: PrognosisSettings, every: int):
    course = "." * 5 + ("." * (every - 1) + "f") * 3 + "." * 4
    made = failing(course, settings, Unit(History(*UNIT), settings))
    again = 5 + 2 * every - 1
    assert made[again].health.level == ERROR
    assert min(levels(made[again:])) >= WARN
    assert max(outlook.health.health_index for outlook in made[again:]) < 1.0
    words = cause_of_level(made[-1])
    assert "an intermittent failure: " in words
    assert "the latest by a phase is open; a person's note on its event" in words


def test_failure_ends_after_as_many_tests_as_a_level_needs_to_fall():
    settings = SETTINGS[1]
    for confirmations in (1, 2, 4):
        of = replace(settings, level_confirmations=confirmations)
        made = failing("....f......", of, Unit(History(*UNIT), of))
        expected = [OK] * 4 + [ERROR] + [WARN] * (confirmations - 1) + [OK] * (7 - confirmations)
        assert levels(made) == expected
        if confirmations > 1:
            words = "a phase is open, in an earlier test: the next test must confirm"
            assert words in cause_of_level(made[5])
            assert made[5].health.health_index < 1.0


def test_person_acknowledges_an_intermittent_failure_also_after_a_restart(tmp_path: Path):
    settings, path = SETTINGS[1], tmp_path / "unit.sqlite"
    unit = Unit(History(*UNIT, path), settings)
    made = failing("...f.f..", settings, unit)
    assert made[-1].health.level == WARN
    unit.history.close()
    unit = Unit(History(*UNIT, path), settings)
    outlook = unit.resume(None, settings)
    assert outlook is not None
    assert outlook.health.level == WARN
    unit.note("Ada", "connector replaced", FIRST_NS + 5 * PERIOD_NS)
    assert failing("..", settings, unit, first=8)[-1].health.level == OK
    unit.history.close()
    again = Unit(History(*UNIT, path), settings)
    assert failing("..", settings, again, first=10)[-1].health.level == OK
    assert failing("f.f...", settings, again, first=12)[-1].health.level == WARN
    again.history.close()


def test_acknowledged_failure_stays_acknowledged_after_an_immediate_restart(tmp_path: Path):
    settings, path = SETTINGS[1], tmp_path / "unit.sqlite"
    unit = Unit(History(*UNIT, path), settings)
    failing("...f.f", settings, unit)
    unit.note("Ada", "connector replaced", FIRST_NS + 5 * PERIOD_NS)
    assert failing("...", settings, unit, first=6)[-1].health.level == OK
    unit.history.close()
    again = Unit(History(*UNIT, path), settings)
    assert failing(".", settings, again, first=9)[-1].health.level == OK
    again.history.close()


def test_looped_replay_counts_a_failure_once():
    settings = SETTINGS[1]
    unit = Unit(History(*UNIT), settings)
    made = failing("....f", settings, unit)
    for _ in range(3):
        unit.rewind(FIRST_NS + 3 * PERIOD_NS)
        made = failing("f.....", settings, unit, first=4)
    assert made[-1].health.level == OK


@pytest.mark.parametrize("is_read_again", [False, True])
def test_failure_with_a_valid_second_attempt_counts_as_a_valid_test(tmp_path, is_read_again):
    settings, path = SETTINGS[1], tmp_path / "unit.sqlite"
    unit = Unit(History(*UNIT, path), settings)
    failing("...f", settings, unit)
    outlook = failing(".", settings, unit, first=3)[0]
    assert outlook.health.level == OK
    if is_read_again:
        unit.history.close()
        unit = Unit(History(*UNIT, path), settings)
    # A single failure of another window is not intermittent.
    made = failing(".f..", settings, unit, first=4)
    assert made[-1].health.level == OK
    assert "intermittent" not in cause_of_level(made[-2])
    unit.history.close()


@pytest.mark.parametrize("settings", SETTINGS, ids=["no hours", "hours"])
def test_text_after_twenty_tests_without_the_fault_counts_no_occurrence(
    settings: PrognosisSettings,
):
    made = outlooks([0.02] * 3 + [0.8, 0.02, 0.8] + [0.02] * 21, settings)[1]
    assert made[-1].health.level == WARN
    words = "beyond its limit repeatedly, but not in the latest 20 tests; a person's note"
    assert words in cause_of_level(made[-1])
    made = failing("...f.f" + "." * 21, settings, Unit(History(*UNIT), settings))
    words = "tests failed repeatedly, but none of the latest 20 tests; a person's note"
    assert words in cause_of_level(made[-1])


def test_unit_that_has_just_failed_is_in_alarm():
    settings = SETTINGS[1]
    unit = Unit(History(*UNIT), settings)
    failing("....f", settings, unit)
    assert "a phase is open" in unit.alarm(None, settings)
    unit.update(made_test(5, valid=False), None, settings)
    assert unit.alarm(None, settings)
