"""Units whose friction wears by load and travel, and whose winding ages by its temperature."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ema_monitor.prognosis.duty.damage import DamageSettings
from ema_monitor.prognosis.duty.flown import CLASS_KELVIN, LEAST_RISE, FlownDuty
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit

from .made_tests import made_test

INTERVAL_H = 10.0
UNIT = ("flap", "SIM-0001")
BY_DAMAGE = PrognosisSettings(service=Service(hours_per_cycle=INTERVAL_H))
BY_HOURS = replace(BY_DAMAGE, damage=DamageSettings(growth_per="hours"))

Duty = Callable[[int], FlownDuty]
"""Duty in the hours before each test, by its number."""


def flown(travel: float, load: float = 0.25, rise: float | None = None) -> FlownDuty:
    """Ten hours with some travel an hour [rad/h], all of it at one load and rise of the winding."""
    one = FlownDuty(INTERVAL_H)
    one.travel[:, min(int(10 * load), 9)] = INTERVAL_H * travel * np.array([1.0, load])
    if rise is not None:
        number = int((rise - LEAST_RISE) / CLASS_KELVIN)
        one.winding[:, number] = INTERVAL_H * np.array([1.0, rise])
    return one


def harder_from(number: int, times: float = 3.0, seed: int = 0) -> Duty:
    """Travel that scatters by a fifth, and from some test on is as many times as much."""

    def duty(test: int) -> FlownDuty:
        rng = np.random.default_rng([seed, test])
        scatter = math.exp(0.2 * rng.standard_normal())
        return flown(50.0 * scatter * (times if test >= number else 1.0))

    return duty


def travelled(duty: Duty, tests: int) -> np.ndarray:
    """Travel until each test [rad]."""
    return np.cumsum([duty(number).travel[0].sum() for number in range(tests)])


def flies(
    tests: int,
    duty: Duty,
    friction: Callable[[int], float],
    settings: PrognosisSettings = BY_DAMAGE,
    seed: int = 3,
    told: Duty | None = None,
) -> tuple[Unit, list[Outlook]]:
    """Follow a unit over its tests; what is told of the duty may differ from what is flown."""
    prognostics = Unit(History(*UNIT), settings)
    outlooks = []
    for number in range(tests):
        estimate = made_test(number, seed=seed, friction=friction(number))
        one = (told or duty)(number)
        outlook = prognostics.update(estimate, None, settings, flown=one)
        assert outlook is not None
        outlooks.append(outlook)
    return prognostics, outlooks
