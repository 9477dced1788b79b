# SPDX-License-Identifier: Apache-2.0
"""How the real estimator errs along lives, measured once for the benchmark of prognosis.

    python -m prognosis.estimator_errors [--windows N] [--spoiled N]

Simulates tests drawn from lives other than those that are scored, identifies the faults in their
noisy windows with the shipped settings, and writes truth, estimate and uncertainty of each to
estimator_errors.jsonl beside this file, one window a line. A share has 1 A of noise on the current.
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
"""Root of the seeds; lives of other roots are scored."""

_UPPER: Final = np.triu_indices(N_FAULTS, 1)


class Sample(NamedTuple):
    """A test to look at."""

    case: Case
    spoiled: bool
    calibration: Calibration

    def record(self) -> dict[str, Any]:
        """Simulate and identify; return the line of the file."""
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
            # Of the upper triangle.
            "correlation": [round(float(entry), 2) for entry in correlation[_UPPER]],
        }


def rounded(values: Iterable[float], digits: int = 5) -> list[float | None]:
    """Return numbers with so many digits, None for those that are not finite."""
    return [float(f"{value:.{digits}g}") if np.isfinite(value) else None for value in values]


def drawn_tests(count: int) -> list[Case]:
    """Return tests of lives, as many of each kind of fault, at any age."""
    kinds = [*TYPICAL, None]
    drawn = []
    for number in range(count):
        rng = np.random.default_rng([SEED, number])
        kind = kinds[number % len(kinds)]
        life = run_to_failure(LIMITS, rng, kind) if kind else constant_life(LIMITS, rng)
        # The last third of a life sees as many levels as the rest.
        at = int((1.0 - rng.random() ** 2) * len(life.hours))
        drawn.append(Case(tuple(life.faults[at].tolist()), (SEED, number)))
    return drawn


def measure(pool: Workers, windows: int, spoiled: int) -> Figures:
    """Measure and write the file."""
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
    """Return what is printed."""
    yield grid(FILE.name, figures, [figures.values()])


main = command(measure, "errors of the estimator", tables=tables, windows=300, spoiled=40)

if __name__ == "__main__":
    main()
