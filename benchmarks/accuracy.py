"""Accuracy of the fault estimator beside the thesis's, and how far its covariance is honest.

    python benchmarks/accuracy.py [--json FILE] [--quick]

Every window comes from the high-fidelity simulation, which the estimator never runs, with seeds
that nothing was tuned on. Prints tables and writes JSON. Needs g++ for the unit of time.
"""

from dataclasses import asdict
from typing import Any

import bounds
import detection
import exactness
import numpy as np
import timing
from bounds import Spectrum
from cases import THESIS_FAULTS
from exactness import Healthy, Sizes, Trial, pooled
from intervals import coverage
from rich.progress import Progress
from tables import show
from trials import Workers, command, workers


def measure(progress: Progress, **options: int) -> dict[str, Any]:
    """Print accuracy, coverage, detection and times, with so many cases of each set."""
    sizes = Sizes(**options)
    with workers(progress) as pool:
        healthy = exactness.healthy_unit(pool, sizes)
        trials = exactness.measure(pool, healthy, sizes)
        figures = _figures(trials, healthy, pool)
        figures["detection"] = detection.measure(pool, healthy, sizes)
    figures["timing"] = timing.measure(progress, healthy, sizes)
    return figures


def _figures(trials: dict[str, Trial], healthy: Healthy, pool: Workers) -> dict[str, Any]:
    clean, noisy = Spectrum(healthy.windows), Spectrum(healthy.noisy_windows)
    found: dict[str, Any] = {}
    for name in THESIS_FAULTS:
        first, repeated = trials[f"first {name}"], trials[f"thesis {name}"]
        case = first.cases[0]
        window = case.window(case.telemetry(), noisy=False)
        jacobian = bounds.jacobian(window, healthy.shipped, case.faults)
        found[name] = {
            "truth": case.faults,
            "first": float(first.errors_percent[0]),
            "thesis": float(np.mean(repeated.errors_percent)),
            "each": repeated.errors_percent.tolist(),
            "evaluations": first.estimates[0].evaluations,
            "bound_current_percent": bounds.bound(
                clean.information(jacobian), case.faults
            ).error_percent,
        }
    wide = trials["wide noisy"]
    windows = pool.map("wide windows for the bound", exactness.noisy_window, wide.cases)
    of_cases = [
        bounds.bound(
            noisy.information(bounds.jacobian(window, healthy.noisy, case.faults)), case.faults
        )
        for window, case in zip(windows, wide.cases, strict=True)
    ]
    sets = {
        "random": pooled(trials["law"], trials["wide"]),
        "noisy": pooled(trials["law noisy"], trials["wide noisy"]),
        **trials,
    }
    return {
        "thesis_cases": found,
        "errors": {name: trial.summary() for name, trial in sets.items()},
        "covariance": coverage(wide, of_cases),
    }


main = command(measure, show, 120, quick=asdict(Sizes.quick()), **asdict(Sizes()))

if __name__ == "__main__":
    main()
