"""``ema thesis``: the thesis's study of optimizers, repeated."""

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
from ema_study.execution import execute, time_executors
from ema_study.models import MODELS
from ema_study.plan import RUNS, plan
from ema_study.report import write_report
from ema_study.run import as_frame
from ema_study.sources import single_fault_runs
from ema_study.store import RunStore, numerics_version
from ema_study.tables import study_tables, write_tables

QUICK_RUNS: Final = 2

_TIMING = "timing.csv"


@click.command()
@click.option(
    "-o",
    "--output",
    "folder",
    default="thesis-study",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of runs, tables, figures and report. Runs that it already holds are kept.",
)
@click.option(
    "--model",
    "models",
    multiple=True,
    default=["fast"],
    type=click.Choice(list(MODELS)),
    help="Monitor model: the shipped one, or the thesis's own at 1 us, 20 times slower.",
)
@click.option(
    "--runs",
    type=click.IntRange(1, 1000),
    help=f"Runs of each algorithm and fault; {RUNS} by default.",
)
@click.option("--quick", is_flag=True, help=f"{QUICK_RUNS} runs each, without table 8.")
@executor_options
def thesis(
    folder: Path, models: tuple[str, ...], runs: int | None, quick: bool, executor: ExecutorOptions
) -> None:
    """Repeat the thesis's study: ten single faults and a multiple one by GA, PSO, DE and GWO.

    Stop it with Ctrl-C at any time: the same command resumes. Further models and runs are added to
    the folder.
    """
    if quick and runs is not None:
        raise click.UsageError("--quick and --runs exclude each other")
    runs = runs or (QUICK_RUNS if quick else RUNS)
    models = tuple(dict.fromkeys(models))
    jobs = [job for model in models for job in plan(model, runs, with_trials=not quick)]
    with RunStore(folder) as store:
        missing = store.missing(jobs)
        if done := len(jobs) - len(missing):
            click.echo(f"{folder}: {done} of {len(jobs)} runs are already done")
        started = time.perf_counter()

        def stopped() -> str:
            done = f"{len(jobs) - len(store.missing(jobs))} of {len(jobs)} runs"
            return f"stopped with {done} in {folder}; the same command resumes"

        kept = f"the runs so far are in {folder}, the same command resumes"
        with stops_in_a_line(stopped, kept):
            if missing:
                with executor.open(stopped, kept) as workers, progress_bar() as progress:
                    task = progress.add_task("study", total=len(missing), state="starting")
                    for done, result in enumerate(execute(missing, workers), 1):
                        store.add(result)
                        job, error = result.job, result.error_percent
                        state = f"{done} of {len(missing)} runs, {job.model}: {job.algorithm}"
                        state += f", {job.case}, run {job.run}: {error:.2f} %"
                        progress.update(task, advance=1, state=state)
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
                "executor": f"{executor.kind}, {counted(executor.number, 'run')} at once, each on "
                "one core",
                "cores": str(available_cpus()),
                "last run": f"{counted(len(missing), 'run')} and the timing in {minutes:.1f} min",
            },
        )
    _print_summary(frame)
    click.echo(f"{counted(len(missing), 'run')} in {minutes:.1f} min; report: {report}")


def _timing(folder: Path, models: Sequence[str]) -> pd.DataFrame:
    """Return the timing of executors with each model; missing timings are measured."""
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


def _print_summary(frame: pd.DataFrame) -> None:
    """Print mean error and time of each algorithm over the single faults."""
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
