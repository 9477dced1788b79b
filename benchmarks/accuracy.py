"""Accuracy of the fault estimator beside the thesis's, and how far its covariance is honest.

    python benchmarks/accuracy.py [--json FILE] [--quick]

Every window comes from the high-fidelity simulation, which the estimator never runs, with seeds
that nothing was tuned on. Prints tables and writes JSON. Needs g++ for the unit of time.
"""

from pathlib import Path
from typing import Any

import bounds
import detection
import exactness
import numpy as np
import timing
from bounds import Spectrum
from cases import THESIS_FAULTS
from click import Path as PathType
from click import command, option
from exactness import Healthy, Sizes, Trial, pooled
from intervals import coverage
from rich.progress import Progress
from tables import show
from trials import Workers, run_benchmark, workers


def measure(progress: Progress, sizes: Sizes) -> dict[str, Any]:
    """Return all figures."""
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
            **_bounds(jacobian, clean, case.faults),
        }
    wide = trials["wide noisy"]
    windows = pool.map("wide windows for the bound", exactness.noisy_window, wide.cases)
    by_kind: dict[str, list[bounds.Bound]] = {}
    for window, case in zip(windows, wide.cases, strict=True):
        jacobian = bounds.jacobian(window, healthy.noisy, case.faults)
        for kind, information in {
            "current": noisy.information(jacobian),
            "current_and_speed": noisy.information(jacobian, with_speed=True),
            "sensors_alone": bounds.sensor_information(jacobian),
        }.items():
            by_kind.setdefault(kind, []).append(bounds.bound(information, case.faults))
    covariance = coverage(wide, by_kind["current"])
    for kind, of_cases in by_kind.items():
        other = coverage(wide, of_cases)
        covariance[f"bound_{kind}"] = {
            "error_percent_median": float(np.median([one.error_percent for one in of_cases])),
            **{name: other[name] for name in ("bound_half_width_percent", "width_over_bound")},
        }
    sets = {
        "random": pooled(trials["law"], trials["wide"]),
        "noisy": pooled(trials["law noisy"], trials["wide noisy"]),
        **trials,
    }
    return {
        "thesis_cases": found,
        "errors": {name: trial.summary() for name, trial in sets.items()},
        "covariance": covariance,
        "records": {name: trial.records() for name, trial in trials.items()},
    }


def _bounds(
    jacobian: np.ndarray, spectrum: Spectrum, faults: tuple[float, ...]
) -> dict[str, float]:
    return {
        f"bound_{name}_percent": bounds.bound(information, faults).error_percent
        for name, information in {
            "current": spectrum.information(jacobian),
            "current_and_speed": spectrum.information(jacobian, with_speed=True),
            "sensors_alone": bounds.sensor_information(jacobian),
        }.items()
    }


@command()
@option("--json", "output", type=PathType(path_type=Path, dir_okay=False), help="File to write.")
@option("--quick", is_flag=True, help="A tenth of everything.")
def main(output: Path | None, quick: bool) -> None:
    """Print the tables and write the JSON file."""
    sizes = Sizes.quick() if quick else Sizes()
    run_benchmark(lambda progress: measure(progress, sizes), show, output, 120)


if __name__ == "__main__":
    main()
