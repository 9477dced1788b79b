# SPDX-License-Identifier: Apache-2.0
"""Growth laws defined by a user, from the public interface to a unit and its history."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from ema_archive.settings import ArchiveSettings
from ema_core.arrays import Array
from ema_monitor import GrowthLaw, KnownLaw, Tracker, TrackerSettings, Unit, track
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings

from .made_tests import UNIT, made_test

SCALE_H, EXPONENT, LIMIT = 1500.0, 1.6, 0.5
HOURS = np.arange(20.0, 700.0, 20.0)
TESTS = [
    made_test(number, seed=3, friction=(hour / SCALE_H) ** EXPONENT)
    for number, hour in enumerate(HOURS)
]


@dataclass(frozen=True)
class PowerOfAge:
    """x = (a u)^p."""

    hours_factor: float = 1.0

    def increment(self, x: Array, rate: Array, shape: Array, hours: Array) -> Array:
        return (x ** (1.0 / shape) + rate * hours) ** shape - x

    def hours_until(self, x: Array, rate: Array, shape: Array, limit: Array) -> Array:
        return self.hours_factor * (limit ** (1.0 / shape) - x ** (1.0 / shape)) / rate


OWN = KnownLaw(PowerOfAge(), 1.0 / SCALE_H, shape=EXPONENT)
SHIPPED = KnownLaw("power", SCALE_H, shape=EXPONENT)


def settings_of(law: KnownLaw) -> TrackerSettings:
    return TrackerSettings(laws={"friction": law, "backlash": law})


def test_law_of_a_user_predicts_like_the_same_law_of_the_package():
    assert isinstance(OWN.law, GrowthLaw)
    trackers = [track(TESTS, HOURS, settings=settings_of(law)) for law in (OWN, SHIPPED)]
    (value, sigma, trend), expected = (
        next(
            (component.value, component.sigma, component.trend)
            for component in tracker.components()
        )
        for tracker in trackers
    )
    np.testing.assert_allclose((value, sigma, trend), expected, rtol=1e-6)
    ours, shipped = (tracker.predict() for tracker in trackers)
    # Rates between the points of the grid are drawn upwards by one law and downwards by the other.
    levels = [0.05, 0.5, 0.95]
    np.testing.assert_allclose(
        np.quantile(ours.samples, levels), np.quantile(shipped.samples, levels), rtol=0.02
    )
    left = SCALE_H * LIMIT ** (1.0 / EXPONENT) - HOURS[-1]
    assert ours.dominant_fault == "friction"
    assert ours.overall.hours_05 < left < ours.overall.hours_95
    assert ours.overall.hours_50 == pytest.approx(left, rel=0.1)


def test_law_of_a_user_draws_futures_and_fans():
    tracker = track(TESTS, HOURS, settings=settings_of(OWN))
    fan = tracker.fan([0.0, 100.0])
    expected = ((HOURS[-1] + np.array([0.0, 100.0])) / SCALE_H) ** EXPONENT
    np.testing.assert_allclose(fan.values["friction"][1], expected, rtol=0.05)


def test_unit_and_its_history_use_the_law_of_a_user(tmp_path):
    settings = PrognosisSettings(
        tracker=replace(settings_of(OWN), samples=400), service=Service(hours_per_cycle=20.0)
    )
    unit = Unit(History(*UNIT), settings)
    outlooks = [unit.update(test, None, settings) for test in TESTS]
    last = outlooks[-1]
    assert last is not None
    assert last.rul_faults.known
    # Growth learned with other code of the law is not used: all tests are replayed.
    stored = unit.growth.state()
    entries = unit.history.entries
    again = type(unit.growth)(settings.limits, settings.tracker, entries, stored)
    assert again.kept_tests == 0
    np.testing.assert_array_equal(
        again.tracker.predict().samples, unit.growth.tracker.predict().samples
    )


class Backwards(PowerOfAge):
    def increment(self, x: Array, rate: Array, shape: Array, hours: Array) -> Array:
        return -super().increment(x, rate, shape, hours)


class InTimeScales(PowerOfAge):
    def hours_until(self, x: Array, rate: Array, shape: Array, limit: Array) -> Array:
        return (limit - x) * rate


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (Backwards(), "increment from 0 within the hours until 0.5 is not 0.5"),
        (PowerOfAge(1.01), "increment from 0 within the hours until 0.5 is not 0.5"),
        (PowerOfAge(-1.0), r"hours_until gives \[-.* expected more than 0"),
        (PowerOfAge(np.inf), r"hours_until gives \[inf\] h from 0 to 0.5"),
        (InTimeScales(), "hours_until at rate 2 is not half"),
    ],
)
def test_law_that_contradicts_itself_is_refused(law, words):
    settings = TrackerSettings(laws={"friction": KnownLaw(law, 1e-3, shape=EXPONENT)})
    with pytest.raises(ValueError, match=rf"of friction, shape 1.6: {words}"):
        Tracker(settings=settings)


class Unhashable(list[float]):
    increment, hours_until = PowerOfAge.increment, PowerOfAge.hours_until


@pytest.mark.parametrize("law", [None, 3.0, object(), PowerOfAge, [PowerOfAge()], Unhashable()])
def test_object_that_is_not_a_law_is_refused(law):
    with pytest.raises(ValueError, match=r"law = .*expected one of linear, .*GrowthLaw"):
        KnownLaw(law)


def test_archive_refuses_a_law_that_it_cannot_store():
    settings = ArchiveSettings(prognosis=PrognosisSettings(tracker=settings_of(OWN)))
    with pytest.raises(ValueError, match=r"law PowerOfAge.* of friction: an archive stores laws"):
        settings.as_mapping()
