# SPDX-License-Identifier: Apache-2.0
"""Order of tests if stamps do not show which is the newest, and the resulting level."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema_core.levels import ERROR, OK, STALE, WARN
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import StampedTest, unordered
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.reason_texts import text_of
from ema_monitor.unit import Unit

from .lived_units import plain
from .made_tests import FIRST_NS, PERIOD_NS, UNIT, made_test

S = 10**9
LIVE = PrognosisSettings(service=Service(hours_per_cycle=10.0), good_for_s=30.0)
NO_CLOCK = replace(LIVE, has_clock=False)


def stamped(end_ns: int, number: int = 0, *, friction: float) -> Estimate:
    return replace(
        made_test(number, seed=3, friction=friction), start_ns=end_ns - S // 2, end_ns=end_ns
    )


def level_at(outlook: Outlook | None, now_ns: int) -> int:
    assert outlook is not None
    return outlook.at(now_ns).health.level


def healthy(path: Path | None = None) -> Unit:
    unit = Unit(History(*UNIT, path), LIVE)
    for number in range(3):
        test = made_test(number, seed=3, friction=0.02)
        assert level_at(unit.update(test, None, LIVE, received_ns=test.end_ns + 1), 0) == STALE
    return unit


def test_after_a_backward_step_of_the_clock_the_order_of_reception_counts():
    unit = healthy()
    back_ns = FIRST_NS + 3 * PERIOD_NS - 3600 * S
    levels = []
    for number in range(3):
        now_ns = back_ns + number * PERIOD_NS
        test = stamped(now_ns - S, number + 3, friction=0.8)
        outlook = unit.update(test, None, LIVE, received_ns=now_ns)
        assert outlook is not None
        # Messages have the stamps of the telemetry.
        assert (outlook.stamp_ns, outlook.claim.tested_ns) == (test.end_ns, test.end_ns)
        assert outlook.claim.good_until_ns == test.end_ns + 30 * S
        levels.append(level_at(outlook, now_ns + S))
    assert levels == [WARN, ERROR, ERROR]
    assert [entry.cycles for entry in unit.history.entries] == [1, 2, 3, 4, 5, 6]
    assert unit.growth.tests == 6


@pytest.mark.parametrize("test", ["friction", "failed"])
def test_history_ahead_of_the_clock_is_not_ok(tmp_path: Path, test: str):
    path = tmp_path / "flap+SIM-0001.sqlite"
    healthy(path).history.close()
    now_ns = FIRST_NS - 3000 * S
    unit = Unit(History(*UNIT, path), LIVE)
    outlook = unit.resume(None, LIVE)
    assert level_at(outlook, now_ns) == STALE
    assert outlook is not None
    assert "3020 s ahead of the clock" in outlook.at(now_ns).health.reason
    end_ns = now_ns + 10 * S
    new = stamped(end_ns, friction=0.8)
    if test == "failed":
        new = replace(made_test(0, valid=False, failed=True), start_ns=end_ns - S, end_ns=end_ns)
    outlook = unit.update(new, None, LIVE, received_ns=end_ns + S)
    expected = ERROR if test == "failed" else WARN
    assert level_at(outlook, end_ns + 2 * S) == expected
    unit.history.close()
    again = Unit(History(*UNIT, path), LIVE)
    assert not again.history.problem
    assert level_at(again.resume(None, LIVE), end_ns + 2 * S) == expected


@pytest.mark.parametrize("received", [True, False])
def test_different_test_with_a_known_stamp_makes_the_level_unknown(received: bool, tmp_path: Path):
    path = tmp_path / "flap+SIM-0001.sqlite"
    unit = Unit(History(*UNIT, path), LIVE)
    tests = [stamped(100 * S, 0, friction=f) for f in (0.02, 0.8, 0.8)]
    levels, reasons = [], []
    for number, test in enumerate(tests):
        now_ns = FIRST_NS + number * PERIOD_NS
        outlook = unit.update(test, None, LIVE, received_ns=received * now_ns)
        assert outlook is not None
        levels.append(outlook.health.level)
        reasons.append(outlook.health.reason)
    assert levels == [OK, STALE, STALE]
    assert "the order of the tests is unknown" in reasons[1]
    assert "has_clock = false" in reasons[1]
    unit.history.close()
    resumed = Unit(History(*UNIT, path), LIVE).resume(None, LIVE)
    assert resumed is not None
    assert resumed.health.level == STALE


def test_repeated_test_does_not_renew_a_level():
    unit = Unit(History(*UNIT), LIVE)
    test = stamped(100 * S, friction=0.02)
    first = unit.update(test, None, LIVE, received_ns=FIRST_NS)
    again = unit.update(test, None, LIVE, received_ns=FIRST_NS + 40 * S)
    assert first is not None
    assert again is not None
    assert again.claim == first.claim
    assert level_at(again, FIRST_NS + 40 * S) == STALE


@pytest.mark.parametrize("spread_s", [0.0, 1.0, 50.0])
def test_without_a_clock_the_order_of_reception_counts(spread_s: float):
    """Stamps restart at each power-on, with a test per day."""
    rng = np.random.default_rng(1)
    settings = replace(NO_CLOCK, good_for_s=3 * 86_400.0)
    unit = Unit(History(*UNIT), settings)
    levels = []
    for number in range(30):
        now_ns = FIRST_NS + number * 86_400 * S
        end_ns = round((100.0 + spread_s * rng.uniform(-1.0, 1.0)) * S)
        test = stamped(end_ns, number, friction=0.02 if number < 10 else 0.8)
        outlook = unit.update(test, None, settings, received_ns=now_ns)
        assert outlook is not None
        assert outlook.claim.tested_ns == end_ns
        levels.append(level_at(outlook, now_ns + S))
    assert levels == [OK] * 10 + [WARN] + [ERROR] * 19
    assert unit.growth.service.usage == pytest.approx(10.0)


@pytest.mark.parametrize("late_s", [3.0, 1800.0])
def test_live_test_older_than_the_newest_one_makes_the_level_unknown(late_s: float):
    unit = healthy()
    end_ns = FIRST_NS + 2 * PERIOD_NS - round(late_s * S)
    now_ns = FIRST_NS + 2 * PERIOD_NS + 5 * S
    outlook = unit.update(stamped(end_ns, friction=0.02), None, LIVE, received_ns=now_ns)
    assert level_at(outlook, now_ns) == STALE
    assert outlook is not None
    assert f"{late_s:g} s before the newest stamp" in outlook.health.reason
    test = made_test(3, seed=3, friction=0.02)
    assert level_at(unit.update(test, None, LIVE, received_ns=test.end_ns), test.end_ns) == OK


def test_tests_after_simulated_time_went_back_repeat_the_first_pass():
    unit, tests = (
        Unit(History(*UNIT), LIVE),
        [made_test(n, seed=3, friction=0.02) for n in range(4)],
    )
    first = [unit.update(test, None, LIVE, received_ns=test.end_ns) for test in tests]
    unit.rewind(tests[1].end_ns)
    assert len(unit.history.entries) == 2
    again = [unit.update(test, None, LIVE, received_ns=test.end_ns) for test in tests[2:]]
    assert [plain(outlook) for outlook in again if outlook] == [
        plain(outlook) for outlook in first[2:] if outlook
    ]


def test_stamps_that_go_back_within_a_bag_are_detected():
    stamps = [(10, 20), (30, 40), (0, 5)]
    tests = [StampedTest(*stamp, "a", stamp) for stamp in stamps]
    assert "went back" in text_of(unordered(tests)["a"])
    # A recording of a looped bag, and bags given in any order.
    assert unordered([*tests[:2], *tests[:2]]) == {}
    assert unordered([StampedTest(*stamp, str(stamp), stamp) for stamp in stamps]) == {}


@pytest.mark.parametrize(
    ("first_ns", "advises"), [(0, True), (5 * 86_400 * S, True), (FIRST_NS, False)]
)
def test_undated_tests_at_the_same_time_suggest_giving_the_date(first_ns, advises):
    tests = [StampedTest(first_ns, first_ns + 20 * S, bag, bag) for bag in ("a", "b")]
    reasons = unordered(tests)
    assert set(reasons) == {"a", "b"}
    assert all(
        ("specify the time of records with its date" in text_of(reason)) == advises
        for reason in reasons.values()
    )
