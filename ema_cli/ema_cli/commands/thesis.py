# SPDX-License-Identifier: Apache-2.0
"""``ema thesis``: repeat the thesis's study of optimizers."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import click
import pandas as pd
from rich.console import Console
from rich.table import Column, Table

from ema_cli.executor_options import ExecutorOptions, executor_options, stops_in_a_line
from ema_cli.progress import progress_bar
from ema_core import __version__
from ema_core.wording import counted
from ema_monitor.model.threads import available_cpus
from ema_study.contents import checked, jobs_of
from ema_study.execution import execute, time_executors
from ema_study.models import MODELS
from ema_study.plan import RUNS, Job, plan
from ema_study.report import write_report
from ema_study.run import as_frame
from ema_study.sources import single_fault_runs
from ema_study.store import RunStore, numerics_version
from ema_study.tables import StudyTable, study_tables, write_tables

QUICK_RUNS: Final = 2

_TIMING = "timing.csv"


def _number_of_table(_: click.Context, __: click.Parameter, number: int | None) -> int | None:
    try:
        return None if number is None else checked(number)
    except ValueError as error:
        raise click.BadParameter(str(error)) from error


@click.command()
@click.option(
    "-o",
    "--output",
    "folder",
    default="thesis-study",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for runs, tables, figures and report; existing runs are kept.",
)
@click.option(
    "--table",
    "number",
    type=int,
    metavar="NUMBER",
    callback=_number_of_table,
    help="Repeat one table, by its number in the thesis.",
)
@click.option(
    "--model",
    "models",
    multiple=True,
    default=["fast"],
    type=click.Choice(list(MODELS)),
    help=(
        "Monitor model: the shipped model, or the thesis's model with 1 us steps, 20 times slower."
    ),
)
@click.option(
    "--runs",
    type=click.IntRange(1, 1000),
    help=f"Runs of each algorithm and fault; {RUNS} by default.",
)
@click.option("--quick", is_flag=True, help=f"{QUICK_RUNS} runs each, without table 8.")
@executor_options
def thesis(
    folder: Path,
    number: int | None,
    models: tuple[str, ...],
    runs: int | None,
    quick: bool,
    executor: ExecutorOptions,
) -> None:
    """Repeat the thesis's study of ten single faults and a multiple fault.

    Ctrl-C stops the study at any time; the same command resumes. Further models and runs are added
    to the folder. With --table, the command computes the runs of one table and prints the table.

    Tables: 8 to 10 calibration and settings, 11 to 55 single faults, 56 and 57 multiple fault, 58
    to 61 summaries (docs/study.md).
    """
    if quick and runs is not None:
        raise click.UsageError("--quick and --runs exclude each other")
    runs = runs or (QUICK_RUNS if quick else RUNS)
    models = tuple(dict.fromkeys(models))
    if number is not None:
        jobs = [job for model in models for job in jobs_of(number, model, runs)]
        with RunStore(folder) as store:
            _make(store, jobs, executor)
            store.export()
            tables = study_tables(as_frame(store.results), [number])
            [path] = write_tables(tables, folder / "tables")
        _print_table(tables[0])
        click.echo(f"written: {path}")
        return
    jobs = [job for model in models for job in plan(model, runs, with_trials=not quick)]
    started = time.perf_counter()
    with RunStore(folder) as store:
        made = _make(store, jobs, executor)
        with stops_in_a_line(lambda: _stopped(store, jobs), _kept(store)):
            timing = _timing(folder, models)
        minutes = (time.perf_counter() - started) / 60.0
        click.echo("writing tables, figures and report")
        store.export()
        frame = as_frame(store.results)
        write_tables(study_tables(frame), folder / "tables")
        report = write_report(
            folder,
            frame,
            timing,
            {
                "version": __version__,
                "models": ", ".join(sorted(set(frame["model"]))),
                "executor": (
                    f"{executor.kind}, {counted(executor.number, 'parallel run')}, each on one core"
                ),
                "cores": str(available_cpus()),
                "last run": f"{counted(made, 'run')} and the timing in {minutes:.1f} min",
            },
        )
    _print_summary(frame)
    click.echo(f"{counted(made, 'run')} in {minutes:.1f} min; report: {report}")


def _make(store: RunStore, jobs: Sequence[Job], executor: ExecutorOptions) -> int:
    """Compute the runs missing from the store and return their number."""
    missing = store.missing(jobs)
    if done := len(jobs) - len(missing):
        click.echo(f"{store.folder}: {done} of {len(jobs)} runs are already done")
    if not missing:
        return 0

    def stopped() -> str:
        return _stopped(store, jobs)

    kept = _kept(store)
    with (
        stops_in_a_line(stopped, kept),
        executor.open(stopped, kept) as workers,
        progress_bar() as progress,
    ):
        task = progress.add_task("study", total=len(missing), state="starting")
        for done, result in enumerate(execute(missing, workers), 1):
            store.add(result)
            job, error = result.job, result.error_percent
            state = f"{done} of {len(missing)} runs, {job.model}: {job.algorithm}"
            state += f", {job.case}, run {job.run}: {error:.2f} %"
            progress.update(task, advance=1, state=state)
    return len(missing)


def _stopped(store: RunStore, jobs: Sequence[Job]) -> str:
    done = f"{len(jobs) - len(store.missing(jobs))} of {len(jobs)} runs"
    return f"stopped with {done} in {store.folder}; the same command resumes"


def _kept(store: RunStore) -> str:
    return f"the runs so far are in {store.folder}, the same command resumes"


def _timing(folder: Path, models: Sequence[str]) -> pd.DataFrame:
    """Return the timings of the executors for each model, and measure missing timings."""
    path = folder / _TIMING
    timing = pd.read_csv(path) if path.exists() else pd.DataFrame({"model": [], "version": []})
    timing = timing[timing["version"] == numerics_version()]
    for model in models:
        if model not in set(timing["model"]):
            with progress_bar() as progress:
                progress.add_task("timing", total=None, state=f"serial and parallel, {model} model")
                measured = time_executors(model).assign(version=numerics_version())
            timing = pd.concat([timing, measured], ignore_index=True)
            timing.to_csv(path, index=False)
    return timing.drop(columns="version")


def _print_table(table: StudyTable) -> None:
    """Print a table of the thesis, one block per source."""
    click.echo(f"Table {table.number}: {table.title}")
    for source in table.frame.columns.unique("source"):
        block = table.frame[source].dropna(how="all")
        text = block.to_string(na_rep="", float_format=lambda value: f"{value:.4g}")
        click.echo(f"\n{source}\n{text}")
    click.echo(f"\n{table.note}".rstrip())


def _print_summary(frame: pd.DataFrame) -> None:
    """Print each algorithm's mean error and time over the single faults."""
    single = single_fault_runs(frame)
    headings = ("runs", "error %", "generations", "time s")
    figures = (Column(heading, justify="right") for heading in headings)
    table = Table("model", "algorithm", "level", *figures, title="means")
    for key, group in single.groupby(["model", "algorithm", "level"]):
        means = group[["error_percent", "generations", "time_s"]].mean()
        table.add_row(
            *map(str, key),
            str(len(group)),
            f"{means['error_percent']:.2f}",
            f"{means['generations']:.0f}",
            f"{means['time_s']:.2f}",
        )
    Console().print(table)
