# SPDX-License-Identifier: Apache-2.0
"""Measure the errors of the real estimator along lives, for the benchmarks of prognosis.

    python -m prognosis.estimator_errors [--windows N] [--spoiled N]

Simulates tests of lives that are not scored, and identifies the faults in their noisy windows with
the default settings. Writes truth, estimate and uncertainty to estimator_errors.jsonl in this
folder, one line per window. --spoiled windows have a noise of 1 A on the current.
"""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

import cases
import numpy as np
from cases import Case
from rich.table import Table
from script import Figures, Workers, command
from targets import grid
from trials import ACTUATOR, HEALTHY_WINDOWS, noisy_window

from ema_core.faults import N_FAULTS, TYPICAL
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_sim.lives import constant_life, run_to_failure
from prognosis.lives import LIMITS, estimate_of

FILE: Final = Path(__file__).with_name("estimator_errors.jsonl")
SEED: Final = 20_185
"""Root of the seeds; scored lives have other roots."""

_UPPER: Final = np.triu_indices(N_FAULTS, 1)


class Sample(NamedTuple):
    """A test to simulate and identify."""

    case: Case
    spoiled: bool
    calibration: Calibration

    def record(self) -> dict[str, Any]:
        """Simulate the test and identify its faults. Return its line of the file."""
        window = "noisy" if self.spoiled else "good"
        estimate = estimate_of(self.case, window, self.calibration)
        if estimate is None:
            raise RuntimeError(f"{self.case}: no window")
        sigma = estimate.sigma
        correlation = np.nan_to_num(estimate.covariance / np.outer(sigma, sigma))
        return {
            "spoiled": self.spoiled,
            "truth": rounded(self.case.faults),
            "valid": estimate.valid,
            "faults": rounded(estimate.faults),
            "sigma": rounded(np.where(estimate.unobservable, np.nan, sigma), 3),
            # Upper triangle.
            "correlation": [round(float(entry), 2) for entry in correlation[_UPPER]],
        }


def rounded(values: Iterable[float], digits: int = 5) -> list[float | None]:
    """Return values rounded to ``digits`` significant digits; None for values not finite."""
    return [float(f"{value:.{digits}g}") if np.isfinite(value) else None for value in values]


def drawn_tests(count: int) -> list[Case]:
    """Return random tests of lives, equally many of each kind of fault and of constant lives."""
    kinds = [*TYPICAL, None]
    drawn = []
    for number in range(count):
        rng = np.random.default_rng([SEED, number])
        kind = kinds[number % len(kinds)]
        life = run_to_failure(LIMITS, rng, kind) if kind else constant_life(LIMITS, rng)
        # Late tests are more frequent, because faults grow fastest then.
        at = int((1.0 - rng.random() ** 2) * len(life.hours))
        drawn.append(Case(tuple(life.faults[at].tolist()), (SEED, number)))
    return drawn


def measure(pool: Workers, windows: int, spoiled: int) -> Figures:
    """Measure the errors of the estimator and write them to the file."""
    tests = drawn_tests(windows + spoiled)
    healthy = cases.healthy(HEALTHY_WINDOWS, "calibration")
    calibration = calibrate_model(pool.map("healthy windows", noisy_window, healthy), ACTUATOR)
    samples = [Sample(case, i >= windows, calibration) for i, case in enumerate(tests)]
    records = pool.map("tests of lives", Sample.record, samples)
    lines = [json.dumps(record, separators=(",", ":")) for record in records]
    FILE.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    valid = sum(record["valid"] for record in records[windows:])
    return {"windows": windows, "spoiled": spoiled, "of them valid": valid}


def tables(figures: Figures) -> Iterator[Table]:
    """Yield the tables to print."""
    yield grid(FILE.name, figures, [figures.values()])


main = command(measure, "errors of the estimator", tables=tables, windows=300, spoiled=40)

if __name__ == "__main__":
    main()
