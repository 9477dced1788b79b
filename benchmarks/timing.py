"""How long an estimate takes, and how many evaluations, in this process on all cores."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import cases
import numpy as np
from exactness import Healthy, Sizes, noisy_window
from rich.progress import Progress
from trials import ACTUATOR
from yardstick import seconds_per_window

from ema_core.faults import ECCENTRICITY_PHASE, fault_vector, healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.diagnosis import identify
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.windows.window import Window

GROWTH: Final = 1.015
"""Distance of the faults from healthy, over what it was in the previous window [-]."""

GENERATIONS: Final = 200
"""Generations of the thesis's particle swarm, of 50 particles each."""

_CONCLUSION_EVALUATIONS = 1000
_TURNS = 20


@dataclass(frozen=True)
class AllGenerations:
    """Stop after so many generations and not before.

    What the conclusion of an estimate evaluates comes on top of them.
    """

    generations: int = GENERATIONS
    budget: int = GENERATIONS * 50 + _CONCLUSION_EVALUATIONS

    def reached(self, best_costs: Sequence[float]) -> bool:
        """Return whether all generations are done."""
        return len(best_costs) >= self.generations


def measure(progress: Progress, healthy: Healthy, sizes: Sizes) -> dict[str, Any]:
    """Return times of cold and warm estimates, of the thesis's swarm and of its cases.

    Each time is also given in windows of the yardstick, run just before it. Half of the windows
    have faults by the thesis's law and half have wide ones; all are noisy.
    """
    half = sizes.timed // 2
    chosen = cases.by_the_law(half) + cases.wide(half)
    windows = [noisy_window(case) for case in progress.track(chosen, description="windows to time")]
    calibration = healthy.noisy
    identify(windows[0], ACTUATOR, calibration)

    def cold(number: int) -> Estimate:
        return identify(windows[number], ACTUATOR, calibration)

    def warm(number: int) -> Estimate:
        return identify(
            windows[number], ACTUATOR, calibration, previous=_before(chosen[number].faults)
        )

    def swarm(number: int) -> Estimate:
        settings = SearchSettings(algorithm="pso", stop_rule=AllGenerations())
        return identify(windows[number], ACTUATOR, calibration, settings)

    track = progress.track
    return {
        "cold": _timed(track(range(2 * half), description="cold estimates"), cold),
        "warm": _timed(track(range(2 * half), description="warm estimates"), warm),
        "swarm": _timed(track(range(min(_TURNS, 2 * half)), description="particle swarm"), swarm),
        "thesis_cases_s": {
            name: _case_seconds(case.window(case.telemetry(), noisy=False), healthy.shipped)
            for name, case in track(cases.first_cycles().items(), description="thesis's cases")
        },
    }


def _timed(numbers, estimate: Callable[[int], Estimate]) -> dict[str, float]:
    seconds, units, evaluations = [], [], []
    for number in numbers:
        units.append(seconds_per_window())
        start = time.perf_counter()
        found = estimate(number)
        seconds.append(time.perf_counter() - start)
        evaluations.append(found.evaluations)
    in_units = np.array(seconds) / np.array(units)
    return {
        "estimates": len(seconds),
        "seconds_median": float(np.median(seconds)),
        "seconds_p95": float(np.quantile(seconds, 0.95)),
        "yardstick_windows_median": float(np.median(in_units)),
        "yardstick_windows_p95": float(np.quantile(in_units, 0.95)),
        "evaluations_median": float(np.median(evaluations)),
    }


def _before(faults: tuple[float, ...]) -> np.ndarray:
    """Return the faults of the window before: a little less of everything."""
    k = fault_vector(faults)
    before = healthy_faults() + (k - healthy_faults()) / GROWTH
    before[ECCENTRICITY_PHASE] = k[ECCENTRICITY_PHASE]
    return before


def _case_seconds(window: Window, calibration: Calibration) -> float:
    times = []
    for _ in range(_TURNS):
        start = time.perf_counter()
        identify(window, ACTUATOR, calibration)
        times.append(time.perf_counter() - start)
    return float(np.median(times))
