# SPDX-License-Identifier: Apache-2.0
"""A health level rises at once, and falls after several consecutive tests with a lower level."""

import math
from dataclasses import asdict

import pytest

from ema_core.levels import ERROR, OK, WARN
from ema_monitor.prognosis.confirmation import confirmed
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit

from .made_tests import UNIT, made_test

FRICTION = {OK: 0.02, WARN: 0.3, ERROR: 0.8}


@pytest.mark.parametrize(
    ("levels", "confirmations", "shown"),
    [
        ([WARN], 2, [WARN]),
        ([OK, WARN, OK, WARN, OK], 2, [OK, WARN, WARN, WARN, WARN]),
        ([OK, WARN, WARN, OK, OK], 2, [OK, WARN, WARN, WARN, OK]),
        ([OK, WARN, ERROR], 2, [OK, WARN, ERROR]),
        # Of the lower levels, the last one is used.
        ([ERROR, OK, WARN, OK, OK], 2, [ERROR, ERROR, WARN, WARN, OK]),
        ([OK, ERROR, ERROR, OK], 1, [OK, ERROR, ERROR, OK]),
        ([ERROR, OK, OK, OK], 3, [ERROR, ERROR, ERROR, OK]),
    ],
)
def test_level_rises_at_once_and_falls_when_confirmed(
    levels: list[int], confirmations: int, shown: list[int]
):
    settings = PrognosisSettings(level_confirmations=confirmations)
    unit = Unit(History(*UNIT), settings)
    for number, (level, expected) in enumerate(zip(levels, shown, strict=True)):
        outlook = unit.update(made_test(number, friction=FRICTION[level]), None, settings)
        assert outlook is not None
        health = outlook.health
        [friction] = [fault for fault in health.faults if fault.name == "friction"]
        assert (health.level, friction.level) == (expected, expected)
        assert friction.unconfirmed == (level if level < expected else None)
        assert (health.health_index < 1.0) == (outlook.dominant_fault != "") or health.level == OK
        if health.level != OK:
            assert health.health_index <= 0.99
            assert (outlook.dominant_fault, health.dominant_fault) == ("friction", "friction")
        # A restart changes nothing.
        again = Unit(unit.history, settings).resume(None, settings)
        assert again is not None
        # Health contains NaN, which does not equal itself.
        assert repr(asdict(again.health)) == repr(asdict(health))


def test_outlook_without_an_earlier_higher_level_is_unchanged():
    """In Python 3.13, a fault with a NaN is unequal to its copy."""
    outlook = Unit(History(*UNIT)).update(made_test(0), None, PrognosisSettings())
    assert outlook is not None
    assert any(math.isnan(item.held) for item in outlook.health.faults)
    assert confirmed(outlook, []) is outlook


def test_fault_held_by_the_tracker_needs_no_additional_tests():
    """The tracker holds back the first lower value until a second test agrees.

    The held test counts as a confirmation: the level falls with the second test.
    """
    settings = PrognosisSettings(service=Service(hours_per_cycle=10.0))
    unit = Unit(History(*UNIT), settings)
    levels = []
    for number in range(16):
        test = made_test(number, seed=3, friction=0.8 if 8 <= number < 12 else 0.02)
        outlook = unit.update(test, None, settings)
        assert outlook is not None
        levels.append(outlook.health.level)
    assert levels[:8] == [OK] * 8
    assert levels[8:12] == [WARN, ERROR, ERROR, ERROR]
    assert levels[12:] == [ERROR, OK, OK, OK]
