"""How the real estimator errs along lives, measured once for the benchmark of prognosis.

    python -m prognosis.estimator_errors [--windows N] [--spoiled N]

Simulates tests drawn from lives other than those that are scored, identifies the faults in their
noisy windows with the shipped settings, and writes truth, estimate and uncertainty of each to
estimator_errors.jsonl beside this file, one window a line. A share has 1 A of noise on the current.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cases
import click
import numpy as np
from cases import Case
from exactness import HEALTHY_WINDOWS, noisy_window
from rich.console import Console
from rich.progress import Progress
from trials import ACTUATOR, workers

from ema_core.faults import N_FAULTS, TYPICAL
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.identification.estimate import Estimate
from ema_sim.lives import constant_life, run_to_failure
from prognosis.lives import LIMITS, estimate_of

FILE: Final = Path(__file__).with_name("estimator_errors.jsonl")
SEED: Final = 20_185
"""Root of the seeds; lives of other roots are scored."""

_UPPER: Final = np.triu_indices(N_FAULTS, 1)


@dataclass(frozen=True, eq=False)
class Sample:
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
        return {
            "spoiled": self.spoiled,
            "truth": rounded(self.case.faults),
            **figures_of(estimate),
        }


def rounded(values: Any, digits: int = 5) -> list[float | None]:
    """Return numbers with so many digits, None for those that are not finite."""
    return [float(f"{value:.{digits}g}") if np.isfinite(value) else None for value in values]


def figures_of(estimate: Estimate) -> dict[str, Any]:
    """Return what an estimate says: faults, sigmas, correlations of the upper triangle."""
    sigma = estimate.sigma
    correlation = np.nan_to_num(estimate.covariance / np.outer(sigma, sigma))[_UPPER]
    return {
        "valid": estimate.valid,
        "faults": rounded(estimate.faults),
        "sigma": rounded(np.where(estimate.unobservable, np.nan, sigma), 3),
        "correlation": [round(float(value), 2) for value in correlation],
        "insignificant": np.flatnonzero(estimate.insignificant).tolist(),
    }


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


@click.command()
@click.option("--windows", default=300, show_default=True, type=click.IntRange(20))
@click.option("--spoiled", default=40, show_default=True, type=click.IntRange(5))
def main(windows: int, spoiled: int) -> None:
    """Measure and write the file."""
    tests = drawn_tests(windows + spoiled)
    with Progress(console=Console(stderr=True)) as progress, workers(progress) as pool:
        healthy = pool.map(
            "healthy windows", noisy_window, cases.healthy(HEALTHY_WINDOWS, "calibration")
        )
        calibration = calibrate_model(healthy, ACTUATOR)
        samples = [Sample(case, i >= windows, calibration) for i, case in enumerate(tests)]
        records = pool.map("tests of lives", Sample.record, samples)
    lines = [json.dumps(record, separators=(",", ":")) for record in records]
    FILE.write_text("".join(f"{line}\n" for line in lines))
    valid = sum(record["valid"] for record in records[windows:])
    click.echo(f"{FILE.name}: {windows} windows, {spoiled} spoiled ones of which {valid} are valid")


if __name__ == "__main__":
    main()
