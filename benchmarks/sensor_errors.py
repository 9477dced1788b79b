# SPDX-License-Identifier: Apache-2.0
"""Estimates under a sensor error: gain, offset or delay of current, speed or position.

    python benchmarks/sensor_errors.py [--json FILE] [--quick | --full] [--step PERCENT] [--seed N]

Each error varies from -30 to 30 % in steps of 4 %, or 1 % with ``--full``. The percentage refers to
the column for a gain, to its largest value for an offset, and to 10 ms for a delay (a negative
delay makes the column early). Seed 0 has the four fault vectors of development, any other seed has
four random ones. Windows are identified by the library, without earlier tests.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from cases import CURRENT_NOISE, RESOLUTIONS, wide_faults
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, grid, none_of
from trials import Trial, median

from ema_core.faults import FAULT_NAMES, INDICES, fault_vector, healthy_faults, random_faults
from ema_core.levels import ERROR, OK, WARN
from ema_core.telemetry import Telemetry
from ema_monitor.api import HealthLimits, Window, assess, find_windows, identify
from ema_monitor.identification.estimate import Verdict
from ema_sim.api import simulate

COLUMNS: Final = ("current", "speed", "position")
ERRORS: Final = ("gain", "offset", "delay")
LARGEST_PERCENT: Final = 30
"""Largest error of a sensor [%]."""
DELAY_S: Final = 0.01
"""Delay that corresponds to 100 % [s]."""
WRONG_SIGMA: Final = 5.0
"""Error above which an estimate is wrong [standard deviations]."""

_DEVELOPMENT: Final[tuple[Mapping[str, float], ...]] = (
    {"friction": 0.22},
    {"friction": 0.62, "short_circuit_b": 0.12},
    {"backlash": 0.3, "gain": 0.6, "short_circuit_a": 0.3},
    {"eccentricity": 0.4, "eccentricity_phase": 0.3, "friction": 0.05},
)
_ROOT: Final = 31_207
# A level is due when a fault exceeds its limit by this share.
_MARGIN: Final = 0.1


class Case(NamedTuple):
    """Faults, ``(8,)``, and the error of a sensor."""

    faults: tuple[float, ...]
    seed: int
    column: str
    error: str
    percent: int

    @property
    def kind(self) -> str:
        """Sensor and kind of its error."""
        return f"{self.column} {self.error}"

    def windows(self) -> list[Window]:
        """Return the simulated window; empty if the wrong column hides the start of the test."""
        telemetry = simulate(
            self.faults, current_noise=CURRENT_NOISE, resolutions=RESOLUTIONS, seed=self.seed
        )
        return find_windows(self.misread(telemetry))

    def misread(self, telemetry: Telemetry) -> Telemetry:
        """Return telemetry with the sensor error applied."""
        column, share = getattr(telemetry, self.column), self.percent / 100.0
        if self.error == "gain":
            column = (1.0 + share) * column
        elif self.error == "offset":
            column = column + share * np.max(np.abs(column))
        else:
            at = np.arange(len(column)) * telemetry.sample_period
            column = np.interp(at - share * DELAY_S, at, column)
        return replace(telemetry, **{self.column: column})


def cases(step: int, seed: int) -> list[Case]:
    """Return the cases, with errors in steps of ``step`` percent."""
    sizes = [size for size in range(-LARGEST_PERCENT, LARGEST_PERCENT + 1, step) if size]
    return [
        Case(faults, 10 * seed + number, column, error, size)
        for number, faults in enumerate(fault_vectors(seed))
        for column, error in product(COLUMNS, ERRORS)
        for size in sizes
    ]


def fault_vectors(seed: int) -> list[tuple[float, ...]]:
    """Return four fault vectors, ``(8,)``: fixed for seed 0, else random."""
    if seed == 0:
        return [tuple(fault_vector(faults).tolist()) for faults in _DEVELOPMENT]
    rng = np.random.default_rng([_ROOT, seed])
    single, double = healthy_faults(), healthy_faults()
    for faults, numbers in ((single, rng.choice(INDICES, 1)), (double, rng.choice(INDICES, 2))):
        for number in numbers:
            faults[number] += rng.uniform(0.05, 0.35)
    return [
        tuple(faults.tolist()) for faults in (single, double, random_faults(rng), wide_faults(rng))
    ]


def work(case: Case) -> Figures:
    """Return verdict, error and level that the library reports for a case."""
    windows = case.windows()
    estimate = identify(windows[0]) if windows else None
    result: Figures = {
        "kind": case.kind,
        "percent": case.percent,
        "truth": case.faults,
        "verdict": Verdict.REFUSED if estimate is None else estimate.verdict,
        "seconds": float("nan") if estimate is None else estimate.computing_time,
    }
    if estimate is None or not estimate.valid:
        return result | {"sigmas": 0.0, "component": "", "error": 0.0, "is_too_low": False}
    health = assess(estimate, HealthLimits())
    trial = Trial.of([case.faults], [estimate])
    sigmas = np.where(trial.known, trial.away / trial.sigma, 0.0)[0]
    worst = int(np.argmax(sigmas))
    return result | {
        "sigmas": float(sigmas[worst]),
        "component": FAULT_NAMES[worst],
        "error": float(trial.away[0, worst]),
        "level": health.level,
        "due": (due := due_level(case.faults)),
        "is_too_low": health.level < due,
        "estimate": list(estimate.faults),
        "sigma": list(estimate.sigma),
        "causes": [str(cause) for cause in estimate.causes],
        "reason": estimate.reason,
        "goodness": estimate.goodness_of_fit,
    }


def due_level(faults: tuple[float, ...]) -> int:
    """Return the level that the true faults, ``(8,)``, require."""
    limits, away = HealthLimits(), np.abs(np.array(faults) - healthy_faults())
    share = max(float(away[n]) / limits.of(FAULT_NAMES[n]) for n in INDICES) / (1.0 + _MARGIN)
    return ERROR if share > 1.0 else WARN if share > limits.warn_share else OK


def measure(pool: Workers, step: int, seed: int) -> Figures:
    """Measure the accuracy of estimates under an error of a sensor."""
    results = pool.map("windows", work, cases(step, seed))
    kinds = [f"{column} {error}" for column, error in product(COLUMNS, ERRORS)]
    return {
        "faults": fault_vectors(seed),
        "kinds": {
            kind: summary([result for result in results if result["kind"] == kind])
            for kind in kinds
        },
        "windows": results,
    }


def summary(results: list[Figures]) -> Figures:
    """Return counts, and the worst error, of the windows with a kind of sensor error."""
    verdicts = [result["verdict"] for result in results]
    wrong = [result for result in results if result["sigmas"] > WRONG_SIGMA]
    worst = max(results, key=lambda entry: entry["sigmas"])
    return {
        "windows": len(results),
        "valid": verdicts.count("valid"),
        "degraded": verdicts.count("degraded"),
        "refused": len(results) - verdicts.count("valid") - verdicts.count("degraded"),
        "wrong": len(wrong),
        "too_low": sum(result["is_too_low"] for result in results),
        "wrong_ok": sum(result["is_too_low"] and result["level"] == OK for result in results),
        "worst": (
            f"{worst['percent']:+d} %: {worst['component']} off by {worst['error']:.3f}, "
            f"{worst['sigmas']:.1f} sigma"
        ),
        "seconds": median([result["seconds"] for result in results if result["seconds"] > 0.0]),
    }


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    kinds, windows = figures["kinds"].values(), len(figures["windows"])
    for what, key in (
        (f"estimates wrong by more than {WRONG_SIGMA:g} sigma", "wrong"),
        ("levels too low", "too_low"),
        ("  of these OK", "wrong_ok"),
    ):
        count = sum(kind[key] for kind in kinds)
        yield none_of(what, count, f"{count} of {windows}")


def tables(figures: Figures) -> Iterator[Table]:
    """Yield the tables to print below the targets."""
    yield grid(
        "faults beside an error of a sensor",
        (
            *("error", "win-\ndows", "valid", "degra-\nded", "re-\nfused", "wrong"),
            *("level\ntoo low", "OK", "time\ns", "worst"),
        ),
        (
            (
                kind,
                *(counts[key] for key in ("windows", "valid", "degraded", "refused", "wrong")),
                *(counts["too_low"], counts["wrong_ok"], counts["seconds"], counts["worst"]),
            )
            for kind, counts in figures["kinds"].items()
        ),
    )


main = command(
    measure, "sensor errors", rows, tables, quick={"step": 15}, full={"step": 1}, step=4, seed=0
)

if __name__ == "__main__":
    main()
