"""``ema estimate``: the faults in a bag."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from ema_cli.bags.source_options import USE_OPTIONS, Source, source_options
from ema_cli.bags.windows import BagWindows, RecordedWindow, read_windows, require_windows
from ema_cli.errors import REFUSED, one_clear_line
from ema_cli.identification_options import IdentificationOptions, identification_options
from ema_cli.show.progress import progress_bar
from ema_core.faults import FAULTS
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.estimate_record import by_fault, estimate_record
from ema_monitor.identification.last_faults import LastFaults
from ema_monitor.identification.search import Identification
from ema_monitor.model.monitor_model import compile_kernels
from ema_monitor.windows.window import MIN_TRAVEL


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@source_options(USE_OPTIONS)
@identification_options
@click.option("--json", "as_json", is_flag=True, help="Print one list, an object a window.")
def estimate(bag: Path, source: Source, options: IdentificationOptions, as_json: bool) -> None:
    """Name the faults in each window of BAG, with their uncertainty."""
    with one_clear_line():
        calibration = options.calibration()
        found = read_windows(bag, source)
        for remark in found.remarks:
            click.echo(f"{bag}: {remark}", err=True)
        require_windows(bag, found, source)
        estimates = estimate_windows(found.windows, calibration, options, force=source.force)
    if as_json:
        click.echo(json.dumps([as_object(e, found) for e in estimates], indent=2))
    else:
        click.echo(f"calibration {calibration.calibration_id} ({options.calibration_source})")
        for number, one in enumerate(estimates):
            _print(number, one, found)
    if not all(one.valid for one in estimates):
        sys.exit(REFUSED)


def estimate_windows(
    windows: Sequence[RecordedWindow],
    calibration: Calibration,
    options: IdentificationOptions,
    *,
    force: bool = False,
) -> list[Estimate]:
    """Return the estimate of every window, as a monitor makes them, with a progress bar.

    Parameters
    ----------
    windows
        What was found in a bag.
    calibration
        Calibration of the model.
    options
        How to identify.
    force
        Whether to estimate even if the calibration does not fit.
    """
    # So that the computing time of the first estimate is that of an estimate.
    compile_kernels()
    estimates, last_faults = [], LastFaults()
    with progress_bar() as progress:
        task = progress.add_task("identifying", total=len(windows))
        for number, window in enumerate(windows):
            found = window.load()
            description = found.description
            run = Identification(
                found.window,
                description,
                calibration,
                options.search,
                force=force,
                previous=last_faults.of(description, calibration),
            )
            for generation in run:
                progress.update(
                    task,
                    state=f"window {number + 1} of {len(windows)}, "
                    f"{generation.evaluations} evaluations, "
                    f"fitness {generation.fitness:.5f} A^2.s",
                )
            if run.estimate is not None:
                last_faults.record(description, run.estimate)
                estimates.append(run.estimate)
            progress.advance(task)
    return estimates


def as_object(one: Estimate, found: BagWindows) -> dict[str, Any]:
    """Return an estimate as plain values; what is not a number is null."""
    record = estimate_record(one)
    record["play_offset"] = record.pop("play")
    record["calibration"] = record.pop("calibration_id")
    return record | {
        "sigma": by_fault(one.sigma),
        "excitation_limit": MIN_TRAVEL,
        "start": round(found.seconds(one.start_ns), 9),
        "end": round(found.seconds(one.end_ns), 9),
    }


def found_in_words(one: Estimate) -> str:
    """Return the significant faults, the largest first.

    Parameters
    ----------
    one
        A valid estimate.
    """
    significant = [
        (abs(k - fault.healthy), f"{fault.label} {k:.3f} ({fault.physical(k)})")
        for fault, k, insignificant, hidden in zip(
            FAULTS, one.faults, one.insignificant, one.unobservable, strict=True
        )
        if fault.limit is not None and not insignificant and not hidden
    ]
    if not significant:
        return "no significant fault"
    return "; ".join(words for _, words in sorted(significant, reverse=True))


def _figure(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "unknown"


def _print(number: int, one: Estimate, found: BagWindows) -> None:
    start, end = found.seconds(one.start_ns), found.seconds(one.end_ns)
    title = f"window {number}, {start:.4f} s to {end:.4f} s"
    if not one.valid:
        click.echo(f"{title}: no valid estimate: {one.reason}")
        return
    table = Table(title=title, title_justify="left")
    for heading in ("fault", "estimate", "sigma", "which means"):
        table.add_column(heading, justify="right" if heading in ("estimate", "sigma") else "left")
    for fault, value, sigma, is_healthy in zip(
        FAULTS, one.faults, one.sigma, one.insignificant, strict=True
    ):
        known = "unobservable" if np.isnan(sigma) else f"{sigma:.4f}"
        meaning = "healthy (not significant)" if is_healthy else fault.physical(value)
        table.add_row(fault.label, f"{value:.4f}", known, meaning)
    Console().print(table)
    click.echo(f"found: {found_in_words(one)}")
    click.echo(
        f"fitness {one.fitness:.5f} A^2.s, goodness of fit {_figure(one.goodness_of_fit)} "
        f"(limit {one.goodness_limit:.2f}), command travels {1e3 * one.excitation:.1f} mrad "
        f"(limit {1e3 * MIN_TRAVEL:g} mrad)"
    )
    click.echo(
        f"{one.algorithm}, {'warm' if one.warm_start else 'cold'}: {one.evaluations} evaluations "
        f"in {one.computing_time_s:.2f} s; calibration of {one.calibration_windows} windows"
    )
    if one.reason:
        click.echo(f"note: {one.reason}")
