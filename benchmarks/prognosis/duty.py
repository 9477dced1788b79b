# SPDX-License-Identifier: Apache-2.0
"""Accuracy of the remaining life by damage and by hours, for friction under changing duty.

    python -m prognosis.duty [--lives N] [--every N] [--json FILE]

Friction is proportional to the wear, with the process noise of 0.3 of ``ema_sim.lives``. Tests are
ten hours apart and their telemetry covers all hours. The tracker does not know the growth law.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from script import Figures, Workers, command
from targets import grid
from trials import mean

from ema_core.faults import FAULT_NAMES, N_FAULTS, fault_vector
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.duty.damage import LOAD_CLASSES, DamageSettings, FlownDuty
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit
from prognosis.whole import estimate_of_measurement

SEED: Final = 18_022
INTERVAL_H: Final = 10.0
LIMIT: Final = 0.5
LIFE_TESTS: Final = 90
TRAVEL: Final = 50.0
SIGMA: Final = 0.003
_SCORED_FROM: Final = LIFE_TESTS // 2 + 2


def _changed(rng: np.random.Generator, n: NDArray[np.intp], times: float) -> NDArray[np.float64]:
    steady = np.exp(0.2 * rng.standard_normal(n.size))
    return steady * np.where(n < LIFE_TESTS // 2, 1.0, times)


KINDS: Final[dict[str, Callable[[np.random.Generator, NDArray[np.intp]], NDArray[np.float64]]]] = {
    "steady": lambda rng, n: np.exp(0.2 * rng.standard_normal(n.size)),
    "scattering": lambda rng, n: np.exp(0.8 * rng.standard_normal(n.size) - 0.32),
    "three times as hard from half of life on": lambda rng, n: _changed(rng, n, 3.0),
    "a third as hard from half of life on": lambda rng, n: _changed(rng, n, 1.0 / 3.0),
    "missions of some 20 tests": lambda rng, n: np.repeat(
        rng.choice([0.4, 1.0, 2.0], n.size // 20 + 1), 20
    )[: n.size],
}
"""Duty of each test relative to the usual duty, by kind: functions of a generator and numbers."""


def estimate_of(number: int, friction: float, rng: np.random.Generator) -> Estimate:
    """Return the estimate of a test, with a random error in friction."""
    measured = float(np.clip(friction + SIGMA * rng.standard_normal(), 0, 0.99))
    hidden = np.array([name == "eccentricity_phase" for name in FAULT_NAMES])
    covariance = np.where(np.outer(hidden, hidden), np.nan, SIGMA**2 * np.eye(N_FAULTS))
    # ``estimate_of_measurement`` adds an hour to the stamp.
    hours = (number + 1) * INTERVAL_H - 1.0
    measurement = Measurement(hours, fault_vector({"friction": measured}), covariance, hidden)
    return estimate_of_measurement(measurement, Calibration.builtin())


def scores(task: tuple[str, str, int], every: int) -> tuple[list[float], list[bool]]:
    """Return relative accuracies and coverage flags of tests in the second half of a life.

    ``task`` is kind of duty, quantity of growth ("damage" or "hours") and seed. Every ``every``-th
    test is scored. A test without a predicted life has accuracy 0 and no flag.
    """
    kind, growth_per, seed = task
    rng = np.random.default_rng([SEED, seed])
    duty = KINDS[kind](rng, np.arange(4 * LIFE_TESTS))
    noise = np.exp(0.3 * rng.standard_normal(duty.size) - 0.045)
    friction = np.cumsum(duty * noise) * LIMIT / LIFE_TESTS
    end = int(np.searchsorted(friction, LIMIT))
    into = (LIMIT - friction[end - 1]) / (friction[end] - friction[end - 1])
    settings = PrognosisSettings(service=Service(hours_per_cycle=INTERVAL_H))
    settings = replace(settings, damage=DamageSettings(growth_per=growth_per))
    prognostics = Unit(History("flap", str(seed)), settings)
    accuracy, covered = [], []
    for number in range(end):
        travel = np.zeros((2, LOAD_CLASSES))
        travel[:, 2] = INTERVAL_H * TRAVEL * duty[number] * np.array([1.0, 0.25])
        flown = FlownDuty(INTERVAL_H, travel)
        estimate = estimate_of(number, friction[number], rng)
        outlook = prognostics.update(estimate, None, settings, flown=flown)
        if outlook is None or number < _SCORED_FROM or number % every:
            continue
        life, left = outlook.rul, (end - 1 - number + into) * INTERVAL_H
        accuracy.append(max(1.0 - abs(life.hours_50 - left) / left, 0.0) if life.known else 0.0)
        if life.known:
            covered.append(life.hours_05 <= left <= life.hours_95)
    return accuracy, covered


def measure(pool: Workers, lives: int, every: int) -> Figures:
    """Score lives of each kind of duty, by hours and by damage."""
    figures: Figures = {kind: {} for kind in KINDS}
    for kind, by in product(KINDS, ("hours", "damage")):
        tasks = [(kind, by, seed) for seed in range(lives)]
        each = pool.map(f"{kind}, by {by}", partial(scores, every=every), tasks)
        figures[kind][f"accuracy by {by}"] = mean([mean(scored) for scored, _ in each])
        figures[kind][f"coverage by {by}"] = mean([flag for _, flags in each for flag in flags])
    return figures


def tables(figures: Figures) -> Iterator[Table]:
    """Yield the tables to print."""
    columns = [f"{what} by {by}" for what in ("accuracy", "coverage") for by in ("hours", "damage")]
    cells = ((kind, *(entry[name] for name in columns)) for kind, entry in figures.items())
    yield grid("friction that wears by duty", ("duty", *columns), cells, digits=3)


main = command(measure, "duty", tables=tables, lives=8, every=3)

if __name__ == "__main__":
    main()
