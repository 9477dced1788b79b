"""What a life that is not given yet waits for."""

import numpy as np
import pytest

from ema_monitor.prognosis.growth.settings import TrackerSettings
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth.waiting import beyond_horizon, growth_not_certain
from ema_sim.growth import Growth

from .tracked_lives import feed

SETTINGS = TrackerSettings(horizon_factor=10.0)


def test_tests_until_growth_is_certain_are_told_by_the_evidence_of_a_test_so_far():
    # From 0.5 to 0.05 in ten tests, a factor of 10; 1e-4 is 500 times less still: 27 tests.
    words = growth_not_certain(0.05, 10)
    assert words == "growth is not certain yet: its probability is 0.950 (about 27 more tests)"
    assert growth_not_certain(1e-5, 3).endswith("(about 2 more tests)")
    assert growth_not_certain(0.49, 100).endswith("0.510")
    assert growth_not_certain(0.6, 10) == "no significant growth"


@pytest.mark.parametrize(
    ("median", "words"),
    [
        (900.0, ""),
        (2000.0, "limit not within the horizon of 1000 h (about 10 more tests)"),
        (1e5, "limit not within the horizon of 1000 h"),
    ],
)
def test_tests_until_a_life_is_within_the_horizon_are_told(median: float, words: str):
    # 100 h in 11 tests, ten times as far ahead: in 91 h more, 1,909 h are left and looked ahead.
    # Tests are ten hours apart.
    assert beyond_horizon(median, 100.0, 11, SETTINGS) == words


def test_what_is_waited_for_comes_in_about_as_many_tests_as_told():
    tracker = Tracker(settings=TrackerSettings(horizon_factor=1.0))
    told: dict[int, int] = {}
    number = 0
    level, rate = 0.05, 5e-4
    for number in range(1, 90):
        before = 10.0 * (number - 1)
        faults = {"friction": level + rate * before}
        rng = np.random.default_rng(number)
        feed(tracker, {"friction": Growth("linear", rate)}, before + 10, rng, faults, after=before)
        reason = tracker.predict().components["friction"].reason
        if not reason:
            break
        if "horizon" in reason:
            told[number] = int(reason.split("about ")[1].split()[0])
    assert told, "never beyond the horizon"
    first = min(told)
    assert number - first <= 2 * told[first] + 2
