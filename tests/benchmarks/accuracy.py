"""Accuracy of the fault estimator beside the thesis's, and how far its covariance is honest.

    python tests/benchmarks/accuracy.py [--json FILE] [--quick] [--no-ablation]

Every window comes from the high-fidelity simulation, which the estimator never runs, with seeds
that nothing was tuned on. Prints tables and writes JSON. Needs g++ for the unit of time.
"""

import json
import time
from pathlib import Path
from typing import Any

import ablation
import bounds
import detection
import exactness
import numpy as np
import thesis
import timing
from bounds import Spectrum
from cases import THESIS_FAULTS
from click import Path as PathType
from click import command, option
from exactness import Healthy, Sizes, Trial, pooled
from intervals import coverage
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from targets import case_target_percent, rows
from trials import Workers, workers


def measure(progress: Progress, sizes: Sizes, *, with_ablation: bool) -> dict[str, Any]:
    """Return all figures."""
    with workers(progress) as pool:
        healthy = exactness.healthy_unit(pool, sizes)
        trials = exactness.measure(pool, healthy, sizes)
        figures = _figures(trials, healthy, pool)
        figures["detection"] = detection.measure(pool, healthy, sizes)
        if with_ablation:
            figures["ablation"] = ablation.measure(pool, sizes)
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


def show(console: Console, figures: dict[str, Any]) -> None:
    """Print the tables."""
    table = Table("what", "target", "measured", "met", "thesis", title="accuracy")
    for column in table.columns:
        column.no_wrap = True
    for row in rows(figures):
        met = {None: "", True: "[green]yes[/]", False: "[bold red]no[/]"}[row.met]
        table.add_row(row.what, row.target, row.measured, met, row.thesis)
    console.print(table)
    covariance = figures["covariance"]
    console.print(
        "Single faults: mean over several realisations of the modulation; first cycle: the first "
        "of the simulation, which is always the same. Noisy sensors: 0.05 A, resolution 0.005 A, "
        "1e-6 rad, 0.05 rad/s. Their bound: half-width "
        f"{covariance['bound_half_width_percent']:.2f} % by current and ripple, "
        f"{covariance['bound_current_and_speed']['bound_half_width_percent']:.2f} % with the "
        f"speed as well, {covariance['bound_sensors_alone']['bound_half_width_percent']:.2f} % if "
        f"there were only the sensors' noise in the current; {covariance['unobservable']} of "
        f"{covariance['intervals'] + covariance['unobservable']} components called unobservable.\n"
    )
    console.print(_case_table(figures))
    console.print(
        "Mean error of the thesis's ten runs; bound: rms error of an unbiased estimate of all "
        "eight components from the current (Cramer-Rao). An estimate that keeps to the few faults "
        "it sees, and hears the speed, can be below it.\n"
    )
    if "ablation" in figures:
        console.print(_ablation_table(figures["ablation"]))


def _case_table(figures: dict[str, Any]) -> Table:
    published = thesis.results()
    table = Table(
        "fault",
        "true k",
        "first\ncycle %",
        "mean\n%",
        "worst\n%",
        "target\n%",
        "bound\n%",
        "evalua-\ntions",
        "time\ns",
        *(f"{name.upper()}\n%" for name in thesis.ALGORITHMS),
        title="the thesis's cases",
    )
    table.columns[0].no_wrap = True
    for column in table.columns[1:]:
        column.justify = "right"
    for name, one in figures["thesis_cases"].items():
        by_algorithm = published[name]
        is_multiple = name == "multiple"
        target = 0.3 if is_multiple else case_target_percent(by_algorithm)
        [value] = THESIS_FAULTS[name].values() if not is_multiple else [None]
        table.add_row(
            name,
            "" if value is None else f"{value:.3f}",
            f"{one['first']:.2f}",
            f"{one['thesis']:.2f}",
            f"{max(one['each']):.2f}",
            f"{target:.2f}",
            f"{one['bound_current_percent']:.2f}",
            str(one["evaluations"]),
            f"{figures['timing']['thesis_cases_s'][name]:.3f}",
            *(f"{by_algorithm[a].error_percent:.2f}" for a in thesis.ALGORITHMS),
        )
    return table


def _ablation_table(results: dict[str, Any]) -> Table:
    columns = (f"{unit}\n{what} %" for unit in ("nominal", "5 % off") for what in _SHOWN)
    table = Table("random faults, noisy sensors", *columns, title="what each step is worth")
    for column in table.columns[1:]:
        column.justify = "right"
    for name, by_unit in results.items():
        table.add_row(name, *(f"{one[w]:.2f}" for one in by_unit.values() for w in _SHOWN))
    return table


_SHOWN = ("median", "p90", "max")


@command()
@option("--json", "output", type=PathType(path_type=Path, dir_okay=False), help="File to write.")
@option("--quick", is_flag=True, help="A tenth of everything.")
@option("--ablation/--no-ablation", "with_ablation", default=True, show_default=True)
def main(output: Path | None, quick: bool, with_ablation: bool) -> None:
    """Print the tables and write the JSON file."""
    started = time.perf_counter()
    sizes = Sizes.quick() if quick else Sizes()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True)) as progress:
        figures = measure(progress, sizes, with_ablation=with_ablation)
    figures["duration_s"] = time.perf_counter() - started
    console = Console(width=120)
    show(console, figures)
    console.print(f"{figures['duration_s']:.0f} s in all")
    if output:
        output.write_text(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
