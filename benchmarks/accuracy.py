# SPDX-License-Identifier: Apache-2.0
"""Accuracy of the fault estimator compared with the thesis, and calibration of its covariance.

    python benchmarks/accuracy.py [--json FILE] [--quick]

Every window comes from the high-fidelity simulation, which the estimator never runs. No part of
the estimator was tuned on these seeds. Prints tables and writes JSON. Needs g++ for the yardstick
that serves as the unit of time.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Final

import cases
import numpy as np
from cases import DETECTABLE, THESIS_FAULTS, Case
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, at_most, grid, percent, untargeted
from trials import (
    ACTUATOR,
    HEALTHY_WINDOWS,
    Trial,
    Variant,
    before,
    calibration_on,
    median,
    noisy_window,
    trials,
)
from yardstick import seconds_per_window

from ema_core.faults import ECCENTRICITY_PHASE, FAULT_NAMES, healthy_faults
from ema_core.levels import ERROR, WARN
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.diagnosis import identify
from ema_monitor.health import HealthLimits, assess
from ema_monitor.identification.estimate import Estimate
from ema_study.cases import ALGORITHMS, CASES, MULTIPLE
from ema_study.printed import printed_runs
from ema_study.sources import counted

MEAN_LOW_PERCENT: Final = 0.71
"""Mean error of the thesis's best algorithm, particle swarm, over the five small faults [%]."""
MEAN_HIGH_PERCENT: Final = 1.76
"""Mean error of particle swarm over the five large faults [%]."""
FASTEST_TIME_S: Final = 97.0
"""Mean time of the thesis's fastest study, the multiple case by particle swarm [s]."""
LONGEST_TIME_S: Final = 2900.0
"""Mean time of the thesis's slowest study, the multiple case by grey wolves [s]."""
FLOOR_PERCENT: Final = 0.2
"""Smallest target of a single fault [%]; above it, half of the thesis's best mean error."""
MULTIPLE_PERCENT: Final = 0.3
SINGLE: Final = ("friction", "backlash", "short circuit", "eccentricity", "gain")
DETECTED_SIGMA: Final = 2.0
"""Deviation from healthy above which a small fault counts as detected [sigma].

Healthy windows may exceed it at the rate ``MOST_ALARMS``.
"""
MOST_ALARMS: Final = 0.01
POWER: Final = 0.9
STEPS_PERCENT: Final = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
"""Sizes of a fault, tried in ascending order [% of the range]."""

_PRECISION_STUDY: Final = "stall_stop"
_HEALTHY_WINDOWS_OFF: Final = 12


def measure(
    pool: Workers,
    repetitions: int,
    random_each: int,
    plants: int,
    plays: int,
    healthy: int,
    steps: int,
    timed: int,
) -> Figures:
    """Measure accuracy, coverage, detection and times of the fault estimator."""
    calibration = calibration_on(cases.healthy(HEALTHY_WINDOWS, "calibration"))
    ideal, noisy = Variant(Calibration.builtin()), Variant(calibration, noisy=True)
    law, wide = cases.by_the_law(random_each), cases.wide(random_each)
    random, random_noisy = trials(pool, "random faults", law + wide, [ideal, noisy])
    [play] = trials(pool, "unknown play", cases.without_approach(plays), [noisy])
    return {
        "thesis_cases": _thesis_cases(pool, ideal, repetitions),
        "errors": {
            "random": random.summary(),
            "noisy": random_noisy.summary(),
            "plants": _off_nominal(pool, law + wide, plants).summary(),
            "play": play.summary(),
        },
        "covariance": _covariance(random_noisy.select(slice(len(law), None))),
        "detection": _detection(pool, noisy, healthy, steps),
        "timing": _timing(pool, calibration, timed),
    }


def _thesis_cases(pool: Workers, ideal: Variant, repetitions: int) -> Figures:
    repeated, results = cases.thesis_faults(repetitions), {}
    for name, first in cases.first_cycles().items():
        [trial] = trials(pool, name, [first, *repeated[name]], [ideal])
        errors = trial.errors_percent.tolist()
        results[name] = {
            "truth": first.faults,
            "first": errors[0],
            "thesis": float(np.mean(errors[1:])),
            "each": errors[1:],
            "evaluations": trial.estimates[0].evaluations,
        }
    return results


def _off_nominal(pool: Workers, faulty: list[Case], count: int) -> Trial:
    plants = cases.plants(faulty, count, _HEALTHY_WINDOWS_OFF)
    calibrations = pool.map("plants, healthy", calibration_on, [plant.healthy for plant in plants])
    truth, estimates = [], []
    for plant, calibration in zip(plants, calibrations, strict=True):
        variant = Variant(calibration, noisy=True)
        [trial] = trials(pool, "plants, faulty", plant.faulty, [variant])
        truth += [*trial.truth]
        estimates += trial.estimates
    return Trial.of(truth, estimates)


def _covariance(trial: Trial) -> Figures:
    """Return the numbers of intervals and of unobservable components, and the coverage.

    Coverage and half-width are also given by component.
    """
    has_interval, coverage = trial.known, trial.coverage_by_component()
    half, wide = trial.coverage_by_component(0.5), trial.quantiles[4] - trial.quantiles[0]
    return {
        "intervals": int(np.sum(has_interval)),
        "unobservable": int(np.sum(trial.judged & ~has_interval)),
        "coverage": trial.coverage(),
        "by_component": {
            name: {
                "coverage": coverage[name],
                "coverage_of_half": half[name],
                "half_width_percent": 50.0 * median(wide[has_interval[:, n], n]),
            }
            for n, name in enumerate(FAULT_NAMES)
        },
    }


def _detection(pool: Workers, noisy: Variant, windows: int, steps: int) -> Figures:
    """Return the alarms on healthy windows, and the smallest detected size of each fault.

    Sizes are in percent of the range; inf if no size of ``STEPS_PERCENT`` is detected.
    """
    [trial] = trials(pool, "healthy windows, alarms", cases.healthy(windows), [noisy])
    levels = Counter(
        assess(estimate, HealthLimits()).level if estimate.valid else "not valid"
        for estimate in trial.estimates
    )
    deviations = _deviations(trial)
    smallest = dict.fromkeys(DETECTABLE, float("inf"))
    for step in STEPS_PERCENT:
        for fault in [component for component in DETECTABLE if smallest[component] == float("inf")]:
            tried = cases.step(fault, step / 100.0, steps)
            [trial] = trials(pool, f"{FAULT_NAMES[fault]} of {step:g} %", tried, [noisy])
            if np.mean(_deviations(trial)[:, fault] > DETECTED_SIGMA) >= POWER:
                smallest[fault] = step
    return {
        "windows": windows,
        "warnings": levels[WARN],
        "errors": levels[ERROR],
        "not_valid": levels["not valid"],
        "largest_deviation_sigma": float(np.max(deviations)),
        "alarms": int(np.sum(np.any(deviations > DETECTED_SIGMA, axis=1))),
        "smallest_percent": {FAULT_NAMES[fault]: size for fault, size in smallest.items()},
    }


def _deviations(trial: Trial) -> np.ndarray:
    """Return the distance of each fault from healthy in standard deviations, ``(n, 8)``.

    It is 0 for unobservable components and for the direction of eccentricity.
    """
    away = np.nan_to_num(np.abs(trial.faults - healthy_faults()) / trial.sigma)
    away[:, ECCENTRICITY_PHASE] = 0.0
    return away


def _timing(pool: Workers, calibration: Calibration, count: int) -> Figures:
    """Return the times of cold and warm estimates.

    Times are in seconds, and in multiples of a window of the yardstick, which is timed just before
    each estimate. Half of the windows have faults drawn by the thesis's law and half have wide
    faults. All have sensor noise.
    """
    chosen = cases.by_the_law(count // 2) + cases.wide(count // 2)
    windows = [noisy_window(case) for case in pool.track("windows to time", chosen)]
    identify(windows[0], ACTUATOR, calibration)

    def cold(number: int) -> Estimate:
        return identify(windows[number], ACTUATOR, calibration)

    def warm(number: int) -> Estimate:
        previous = before(chosen[number].faults)
        return identify(windows[number], ACTUATOR, calibration, previous=previous)

    numbers = range(len(chosen))
    return {
        "cold": _timed(pool, "cold estimates", numbers, cold),
        "warm": _timed(pool, "warm estimates", numbers, warm),
    }


def _timed(
    pool: Workers, what: str, numbers: Sequence[int], estimate: Callable[[int], Estimate]
) -> Figures:
    units, seconds = [], []
    for number in pool.track(what, numbers):
        units.append(seconds_per_window())
        start = time.perf_counter()
        estimate(number)
        seconds.append(time.perf_counter() - start)
    in_units = np.array(seconds) / np.array(units)
    return {
        "seconds_median": median(seconds),
        "seconds_p95": float(np.quantile(seconds, 0.95)),
        "yardstick_windows_median": median(in_units),
        "yardstick_windows_p95": float(np.quantile(in_units, 0.95)),
    }


def published_percent() -> dict[str, dict[str, float]]:
    """Return the published mean error of each algorithm's ten runs [%], by case and algorithm.

    For the multiple case the runs are from the thesis's study of precision.
    """
    runs = counted(printed_runs())
    results: dict[str, dict[str, float]] = {}
    for name, case in CASES.items():
        level = _PRECISION_STUDY if name == MULTIPLE else case.level
        of_case = runs[(runs["fault"] == case.fault) & (runs["level"] == level)]
        means = of_case.groupby("algorithm")["error_percent"].mean()
        results[name] = {algorithm: float(means[algorithm]) for algorithm in ALGORITHMS}
    return results


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    yield from _thesis_rows(figures["thesis_cases"])
    errors = figures["errors"]
    for name, what, limits in (
        ("random", "random faults", (0.5, 1.2, 5.0)),
        ("noisy", "the same with noisy sensors", (0.8,)),
        ("plants", "the same, noisy, plant 5 % off", (1.5,)),
        ("play", "wide, noisy, unknown play", ()),
    ):
        error = errors[name]
        labels = (f"{what}, median [%]", "  90th percentile [%]", "  largest [%]")
        if name in ("random", "play"):
            labels = (f"{error['cases']} {labels[0]}", *labels[1:])
        for n, key in enumerate(("median", "p90", "max")):
            if n < len(limits):
                yield at_most(labels[n], error[key], limits[n])
            else:
                yield untargeted(labels[n], f"{error[key]:.2f}")
        words = f"{error['crps']:.3f}; {error['log_score']:.2f}"
        yield untargeted("  CRPS [%]; log score [nat], mean over components", words)
    timing = figures["timing"]
    studies = f"{FASTEST_TIME_S:.0f} to {LONGEST_TIME_S:.0f} s"
    for name, label, limit, published in (
        ("cold", "cold estimate", 0.25, studies),
        ("warm", "warm estimate", 0.05, ""),
    ):
        times = timing[name]
        seconds = f"{times['seconds_median']:.3f} ({times['seconds_p95']:.3f})"
        yield at_most(
            f"{label}, median (95 %) [s]", times["seconds_median"], limit, seconds, published
        )
        units = f"{times['yardstick_windows_median']:.0f} ({times['yardstick_windows_p95']:.0f})"
        yield untargeted("  in yardstick windows", units)
    evaluations = errors["random"]["evaluations_median"]
    yield at_most("evaluations, median", evaluations, 300, f"{evaluations:.0f}", "10,000")
    share = figures["covariance"]["coverage"]
    what = "90 % interval covers, wide noisy [%]"
    yield Row(what, "85 to 95", f"{100.0 * share:.1f}", 0.85 <= share <= 0.95)
    yield from _detection_rows(figures["detection"])


def _target_percent(by_algorithm: dict[str, float], name: str) -> float:
    """Return the target of a case: the largest mean error allowed [%]."""
    if name == "multiple":
        return MULTIPLE_PERCENT
    return max(min(by_algorithm.values()) / 2.0, FLOOR_PERCENT)


def _thesis_rows(of_cases: Figures) -> Iterator[Row]:
    published = published_percent()
    for kind, label in (("thesis", ""), ("first", ", first cycle")):
        errors = {name: case[kind] for name, case in of_cases.items()}
        for level, limit, best in (
            ("low", 0.25, MEAN_LOW_PERCENT),
            ("high", 0.5, MEAN_HIGH_PERCENT),
        ):
            value = float(np.mean([errors[f"{fault} {level}"] for fault in SINGLE]))
            what = f"single faults {level}, mean{label} [%]"
            yield at_most(what, value, limit, beside=f"{best:.2f}")
        shares = {
            name: error / _target_percent(published[name], name)
            for name, error in errors.items()
            if name != "multiple"
        }
        worst = max(shares, key=lambda name: shares[name])
        held = sum(share <= 1.0 for share in shares.values())
        yield Row(
            f"each single fault{label} [%]",
            "<= half, 0.2",
            f"{held} of {len(shares)}; {worst} {errors[worst]:.2f}",
            shares[worst] <= 1.0,
            f"{min(published[worst].values()):.2f}",
        )
        best = f"{min(published['multiple'].values()):.2f}"
        what = f"multiple fault{label} [%]"
        yield at_most(what, errors["multiple"], MULTIPLE_PERCENT, beside=best)


def _detection_rows(entry: Figures) -> Iterator[Row]:
    alarms = f"{entry['warnings']} WARN, {entry['errors']} ERROR, {entry['not_valid']} invalid"
    yield Row(
        f"false alarms in {entry['windows']} healthy noisy windows",
        "0",
        alarms,
        not entry["warnings"] + entry["errors"] + entry["not_valid"],
    )
    yield Row(
        f"  windows with a fault beyond {DETECTED_SIGMA:g} sigma",
        f"<= {100.0 * MOST_ALARMS:g} %",
        f"{entry['alarms']} (largest {entry['largest_deviation_sigma']:.2f})",
        entry["alarms"] <= MOST_ALARMS * entry["windows"],
    )
    smallest = entry["smallest_percent"]
    worst = max(smallest, key=lambda name: smallest[name])
    measured = f"{smallest[worst]:g} ({worst.replace('_', ' ')})"
    yield at_most("  smallest fault so detected, power 90 % [%]", smallest[worst], 1.0, measured)


def tables(figures: Figures) -> Iterator[Table | str]:
    """Yield the tables to print below the targets."""
    covariance = figures["covariance"]
    judged = covariance["intervals"] + covariance["unobservable"]
    yield (
        "Single faults: mean over several realisations of the modulation; first cycle: the first "
        "of the simulation, which is always the same. Noisy sensors: 0.05 A, resolution 0.005 A, "
        "1e-6 rad, 0.05 rad/s. "
        f"{covariance['unobservable']} of {judged} components called unobservable.\n"
    )
    smallest = figures["detection"]["smallest_percent"]
    headings = ("component", "90 % interval\ncovers %", "50 %\none", "median half-\nwidth of 90 %")
    yield grid(
        "by component, noisy sensors",
        (*headings, f"smallest at\n{DETECTED_SIGMA:g} sigma %"),
        (
            # The direction of eccentricity alone is not a fault.
            (
                name,
                percent(component["coverage"]),
                percent(component["coverage_of_half"]),
                component["half_width_percent"],
                smallest.get(name, ""),
            )
            for name, component in covariance["by_component"].items()
        ),
    )
    yield _case_table(figures["thesis_cases"])


def _case_table(of_cases: Figures) -> Table:
    published, table = published_percent(), []
    for name, case in of_cases.items():
        values = list(THESIS_FAULTS[name].values())
        table.append(
            (
                name,
                f"{values[0]:.3f}" if len(values) == 1 else "",
                *(case["first"], case["thesis"], max(case["each"])),
                _target_percent(published[name], name),
                case["evaluations"],
                *published[name].values(),
            )
        )
    headings = ("fault", "true k", "first\ncycle %", "mean\n%", "worst\n%", "target\n%")
    algorithms = (f"{name.upper()}\n%" for name in ALGORITHMS)
    title = "the thesis's cases, beside the mean error of its ten runs"
    return grid(title, (*headings, "evalua-\ntions", *algorithms), table)


main = command(
    measure,
    "accuracy",
    rows,
    tables,
    width=120,
    beside="thesis",
    quick={
        **{"repetitions": 1, "random_each": 10, "plants": 2, "plays": 4},
        **{"healthy": 100, "steps": 8, "timed": 6},
    },
    repetitions=5,
    random_each=100,
    plants=10,
    plays=40,
    healthy=1000,
    steps=40,
    timed=40,
)

if __name__ == "__main__":
    main()
