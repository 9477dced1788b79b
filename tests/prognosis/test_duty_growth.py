# SPDX-License-Identifier: Apache-2.0
"""Growth by damage: growth follows the duty flown, and lives follow the expected duty."""

import math
from collections.abc import Callable
from dataclasses import replace
from statistics import mean

import numpy as np
import pytest

from ema_monitor.prognosis.duty.course import REFERENCE_TESTS, DutyCourse, duty_changes
from ema_monitor.prognosis.duty.damage import CLASS_KELVIN, LEAST_RISE, DamageSettings, FlownDuty
from ema_monitor.prognosis.duty.scenario import NotComparableError, Scenario
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Entry
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit

from .lived_units import plain
from .made_tests import UNIT, made_test
from .tracked_lives import of

INTERVAL_H = 10.0
BY_DAMAGE = PrognosisSettings(service=Service(hours_per_cycle=INTERVAL_H))
BY_HOURS = replace(BY_DAMAGE, damage=DamageSettings(growth_per="hours"))

Duty = Callable[[int], FlownDuty]
"""Duty in the hours before each test, by the number of the test."""


def flown(travel: float, load: float = 0.25, rise: float | None = None) -> FlownDuty:
    """Return ten hours of duty: travel [rad/h] at one load [-], and the winding rise [K]."""
    duty = FlownDuty(INTERVAL_H)
    duty.travel[:, min(int(10 * load), 9)] = INTERVAL_H * travel * np.array([1.0, load])
    if rise is not None:
        number = int((rise - LEAST_RISE) / CLASS_KELVIN)
        duty.winding[:, number] = INTERVAL_H * np.array([1.0, rise])
    return duty


def harder_from(number: int, times: float = 3.0, seed: int = 0) -> Duty:
    """Return travel that scatters by a fifth, and is multiplied by ``times`` from a test on."""

    def duty(test: int) -> FlownDuty:
        rng = np.random.default_rng([seed, test])
        scatter = math.exp(0.2 * rng.standard_normal())
        return flown(50.0 * scatter * (times if test >= number else 1.0))

    return duty


def travelled(duty: Duty, tests: int) -> np.ndarray:
    """Return the travel until each test [rad]."""
    return np.cumsum([duty(number).travel[0].sum() for number in range(tests)])


def flies(
    tests: int,
    duty: Duty,
    friction: Callable[[int], float],
    settings: PrognosisSettings = BY_DAMAGE,
    seed: int = 3,
    recorded: int = 0,
) -> tuple[Unit, list[Outlook]]:
    """Follow a unit over its tests; the first ``recorded`` are in its history from the start."""
    history = History(*UNIT)
    for number in range(recorded):
        estimate = made_test(number, seed=seed, friction=friction(number))
        hours = INTERVAL_H * (number + 1)
        history.append(Entry(estimate, hours, number + 1, flown=duty(number)))
    prognostics, outlooks = Unit(history, settings), []
    for number in range(recorded, tests):
        estimate = made_test(number, seed=seed, friction=friction(number))
        outlook = prognostics.update(estimate, None, settings, flown=duty(number))
        assert outlook is not None
        outlooks.append(outlook)
    return prognostics, outlooks


NUMBER_OF = {"friction": 0, "backlash": 1, "short_circuit_a": 2, "eccentricity": 5, "gain": 6}


@pytest.mark.slow
def test_unit_flown_harder_from_half_of_its_life_on_is_predicted_better_by_damage():
    """From the second test after the change on; errors of the median, over the hours left."""
    errors: dict[str, list[float]] = {"damage": [], "hours": []}
    covered = []
    for seed in range(2):
        duty = harder_from(45, seed=seed)
        # Friction in proportion to the travel: at its limit after 90 tests as in the first.
        share = travelled(duty, 200) / (90 * INTERVAL_H * 50.0)
        end = int(np.searchsorted(share, 1.0))
        friction = (0.5 * share).tolist().__getitem__
        for name, settings in (("damage", BY_DAMAGE), ("hours", BY_HOURS)):
            _, outlooks = flies(end, duty, friction, settings, seed=seed, recorded=46)
            for number, outlook in enumerate(outlooks[:-1], 46):
                life, left = outlook.rul, (end - number - 0.5) * INTERVAL_H
                error = abs(life.hours_50 - left) / left if life.known else 1.0
                errors[name].append(min(error, 1.0))
                if name == "damage":
                    covered.append(life.known and life.hours_05 <= left <= life.hours_95)
    assert mean(errors["damage"]) < 0.8 * mean(errors["hours"])
    assert mean(covered) > 0.7


def test_growth_is_by_hours_if_telemetry_covers_only_the_tests():
    """A test of one second every ten hours shows nothing about the duty between the tests."""

    def friction(number: int) -> float:
        return 0.01 * number

    def reported(_: int) -> FlownDuty:
        return replace(flown(50.0), hours=1.0 / 3600.0)

    with_telemetry, outlooks = flies(15, reported, friction)
    assert with_telemetry.growth.duty is None
    _, without = flies(15, harder_from(5), friction, BY_HOURS)
    assert plain(outlooks[-1]) == plain(without[-1])


def test_hours_of_growth_refer_to_the_mean_duty_of_the_first_tests():
    def friction(number: int) -> float:
        return 0.005 * number

    prognostics, _ = flies(31, lambda n: flown(50.0 if n <= 15 else 100.0), friction)
    course = prognostics.growth.duty
    assert course is not None
    own_hours = course.own_hours
    assert own_hours[15] == pytest.approx(np.full(7, 160.0))
    # Twice the travel at the same load gives twice the wear; the other faults grow by hours.
    assert own_hours[30, NUMBER_OF["friction"]] == pytest.approx(160.0 + 2.0 * 150.0)
    assert own_hours[30, NUMBER_OF["backlash"]] == pytest.approx(160.0 + 2.0 * 150.0)
    for name in ("short_circuit_a", "eccentricity", "gain"):
        assert own_hours[30, NUMBER_OF[name]] == 310.0
    trend = of(prognostics.growth.tracker, "friction").trend
    assert trend == pytest.approx(0.005 / INTERVAL_H, rel=0.6)


def test_wear_depends_on_the_power_of_the_load_and_ageing_on_the_temperature():
    cubic = DamageSettings(wear_exponent=3.0)
    gentle, hard = (cubic.damage(flown(50.0, load)) for load in (0.25, 0.5))
    assert hard[2] == pytest.approx(8.0 * gentle[2])
    assert gentle[:2] == pytest.approx([INTERVAL_H, 50.0 * INTERVAL_H])
    # Montsinger's rule of ten kelvin, equivalent to an activation energy of 1 eV at 130 degC.
    cool, hot = (DamageSettings().damage(flown(50.0, rise=rise)) for rise in (105.0, 115.0))
    assert hot[4] == pytest.approx(2.0 * cool[4], rel=0.03)
    assert hot[2:4] == pytest.approx([0.25 * 50.0 * INTERVAL_H, INTERVAL_H])


def course(*relative: float) -> DutyCourse:
    """Return ten hours at each of these relative wears, after ten hours at 1 for the reference."""
    wear = np.array([1.0] * REFERENCE_TESTS + list(relative))
    hours = np.arange(wear.size + 1) * np.float64(INTERVAL_H)
    hourly = np.stack([wear, np.full(wear.size, np.nan), 4.0 * wear])
    return DutyCourse(DamageSettings(), hours, hourly)


def test_interval_with_unknown_duty_repeats_the_one_before():
    own_hours = course(2.0, np.nan, np.nan, 1.0).own_hours[:, NUMBER_OF["friction"]]
    assert own_hours[-5:] == pytest.approx([100.0, 120.0, 140.0, 160.0, 170.0])


def test_future_duty_is_drawn_from_the_past_and_widens_the_life():
    """The lives have 400 h of growth without scatter, so that all scatter comes from the duty."""
    own_hours = np.full((7, 2000), 400.0)
    steady = course(*[1.0] * 30).as_flown(1.0).hours_of(own_hours)[0]
    rng = np.random.default_rng(1)
    varied = course(*np.exp(0.8 * rng.standard_normal(40))).as_flown(1.0)
    hours = varied.hours_of(own_hours)
    assert steady == pytest.approx(400.0)
    assert np.ptp(np.quantile(hours[0], [0.05, 0.95])) > 100.0
    assert np.quantile(hours[0], [0.05, 0.95]).mean() == pytest.approx(
        400.0 / np.mean(varied.present[0]), rel=0.2
    )
    assert hours[NUMBER_OF["gain"]] == pytest.approx(400.0)


def test_hours_of_service_and_hours_of_growth_are_inverse_functions():
    future = course(*np.random.default_rng(2).uniform(0.2, 3.0, 40)).as_flown(1.7)
    hours = np.array([1.0, 50.0, 400.0, 1e4, 1e5])
    own_hours = future.own_hours(hours, 200)
    assert own_hours.shape == (5, 7, 200)
    for service_hours, grown in zip(hours, own_hours, strict=True):
        assert future.hours_of(grown) == pytest.approx(np.full((7, 200), service_hours))
    assert future.hours_of(np.array([[0.0, np.inf]] * 7)).tolist() == [[0.0, np.inf]] * 7


def test_future_duty_begins_as_after_the_latest_change():
    recent = course(*[1.0] * 40, *[3.0] * 5, *[2.0] * 2)
    future = recent.as_flown(1.0)
    soon, late = np.mean(future.own_hours(np.array([5.0, 2000.0]), 100)[:, 0], axis=-1)
    assert soon == pytest.approx(5.0 * 2.0, rel=0.05)
    # The duty changed twice in 570 h. It lasts as long on average, and then equals the whole past.
    lasts = 570.0 * (1.0 - math.exp(-2000.0 / 570.0))
    assert late == pytest.approx(
        lasts * 2.0 + (2000.0 - lasts) * (50.0 + 15.0 + 4.0) / 57.0, rel=0.1
    )
    assert recent.present[0] == pytest.approx(2.0)
    assert recent.lately(recent.hourly)[2] == pytest.approx(8.0)
    expected = "future duty as flown since 550 h, and changing as often as it did (2 times)"
    assert str(future) == expected
    steady = course(*[1.0] * 40)
    assert str(steady.as_flown(1.0)) == "future duty as flown since 0 h"
    # A single change may last.
    harder = course(*[1.0] * 20, *[2.0] * 10).as_flown(1.0)
    assert str(harder) == "future duty as flown since 300 h"
    assert harder.present[0] == pytest.approx(2.0)


def test_changes_of_a_duty_are_detected_even_if_it_returns():
    missions = np.repeat([1.0, 3.0, 1.0, 3.0], 20)
    noise = np.exp(0.1 * np.random.default_rng(0).standard_normal(80))
    change_positions = [duty_changes(missions[:n] * noise[:n]).tolist() for n in (20, 40, 60, 80)]
    assert change_positions == [[], [20], [20, 40], [20, 40, 60]]


def test_scatter_is_not_mistaken_for_a_change_of_duty():
    """Of a thousand duties with a hundred intervals of random scatter, few seem to change."""
    rng = np.random.default_rng(3)
    changes = sum(duty_changes(np.exp(rng.standard_normal(100))).size > 0 for _ in range(1000))
    assert changes <= 10


def worn(settings: PrognosisSettings) -> Unit:
    return flies(40, lambda _: flown(50.0, rise=80.0), lambda n: 0.008 * n, settings)[0]


@pytest.fixture(scope="module")
def by_damage() -> Unit:
    return worn(BY_DAMAGE)


def test_scenarios_give_the_life_at_their_duty(by_damage):
    """Friction ends life; half of its travel doubles the life, and temperature changes nothing."""
    prognostics = by_damage
    asked = {
        "as flown": Scenario("as flown"),
        "idle": Scenario("idle", travel_per_hour=25.0, hours_per_day=5.0),
        "loads": Scenario("loads", loads={0.5: 0.5, 0.25: 0.5}),
        "hot": Scenario("hot", winding={120.0: 1.0}),
        "twice": Scenario("twice", duty=2.0, hours_per_cycle=5.0),
    }
    now = prognostics.outlook(None, BY_DAMAGE)
    reported = {
        name: prognostics.under(scenario, None, BY_DAMAGE) for name, scenario in asked.items()
    }
    assert plain(reported["as flown"]) == plain(now)
    expected = {"idle": 2.0, "loads": 1.0 / 1.5, "hot": 1.0, "twice": 0.5}
    for name, ratio in expected.items():
        assert reported[name].rul.known
        assert reported[name].dominant_fault == "friction"
        assert reported[name].rul.hours_50 == pytest.approx(ratio * now.rul.hours_50, rel=0.02), (
            name
        )
    assert reported["idle"].removal.days == pytest.approx(reported["idle"].removal.hours / 5.0)
    assert reported["twice"].removal.cycles == pytest.approx(reported["twice"].removal.hours / 5.0)
    assert "travel_per_hour = 25" in reported["idle"].assumption
    assert plain(prognostics.outlook(None, BY_DAMAGE)) == plain(now)


def test_scenario_without_a_known_reference_has_an_unknown_life():
    by_hours = worn(BY_HOURS)
    reported = by_hours.under(Scenario("idle", travel_per_hour=25.0), None, BY_HOURS)
    assert not reported.rul.known
    assert "its duty so far is unknown" in reported.rul.reason
    with pytest.raises(NotComparableError, match="the temperature of its winding so far"):
        Scenario("hot", winding={120.0: 1.0}).future(course(1.0), 1.0)
    twice = by_hours.under(Scenario("twice", duty=2.0), None, BY_HOURS)
    assert twice.rul.known


def test_restart_gives_the_same_growth(by_damage, path):
    kept = History(*UNIT, path)
    for entry in by_damage.history.entries:
        kept.append(entry)
    kept.close()
    again = Unit(History(*UNIT, path), BY_DAMAGE)
    assert plain(again.outlook(None, BY_DAMAGE)) == plain(by_damage.outlook(None, BY_DAMAGE))
