"""``ema lives``: simulated lives to failure, as bags or as estimates."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import click
import pandas as pd

from ema_cli.errors import NameChoice, one_clear_line
from ema_cli.executor_options import workers_or_all
from ema_cli.lives.making import LifeJob, make_life, make_life_by_itself
from ema_cli.processes.stop_request import StopRequest, deferred_signals
from ema_cli.show.progress import progress_bar
from ema_core.faults import TYPICAL
from ema_monitor.model.threads import limit_threads
from ema_tasks.choice import EXECUTORS, open_pool
from ema_tasks.pool import ClusterLostError, WorkerLostError

INDEX: Final = "lives.csv"
"""File with a line about each life."""

_SERIAL: Final = "serial"


@click.command()
@click.option(
    "-o",
    "--output",
    "folder",
    required=True,
    type=click.Path(path_type=Path),
    help="Folder to make; it must not be there.",
)
@click.option("--count", default=1, type=click.IntRange(1, 10_000))
@click.option(
    "--seed",
    default=0,
    type=click.IntRange(0),
    help="Of everything random. The same seed makes the same lives, however many.",
)
@click.option(
    "--fault",
    "kind",
    type=NameChoice("fault", TYPICAL),
    help="Dominant fault; drawn for each life when not given.",
)
@click.option(
    "--as",
    "form",
    default="bags",
    type=click.Choice(["bags", "estimates"]),
    help="bags: a folder a life, with a bag a test and the unit's calibration, for ema prognose. "
    "estimates: a file a life, with a line of JSON a test, the truth and what the monitor "
    "estimates, to develop or score other methods of prognosis; docs/prognosis.md lists its keys.",
)
@click.option("--constant", "is_constant", is_flag=True, help="Lives in which no fault grows.")
@click.option(
    "--repair", "with_repair", is_flag=True, help="Repair the dominant fault once in each life."
)
@click.option(
    "--executor",
    default=_SERIAL,
    type=click.Choice((_SERIAL, *EXECUTORS)),
    help="Lives one by one, or side by side in processes, threads or on a Dask cluster, whose "
    "workers need FOLDER at the same path; each on one core.",
)
@click.option(
    "--workers",
    type=click.IntRange(1),
    help="How many lives at once on this machine; by default as many as there are cores.",
)
@click.option(
    "--scheduler",
    default="",
    metavar="ADDRESS",
    help="With --executor dask: the cluster's scheduler; without it a cluster of local processes "
    "is started.",
)
def lives(
    folder: Path,
    count: int,
    seed: int,
    kind: str | None,
    form: str,
    is_constant: bool,
    with_repair: bool,
    executor: str,
    workers: int | None,
    scheduler: str,
) -> None:
    """Simulate actuators from new until a fault reaches its limit, test by test.

    A test is due every ten flight hours; a tenth is missing, and three in a hundred are disturbed
    by noise or a gap. Each life is that of a unit with a serial number of its own. FOLDER/lives.csv
    holds the truth about each life: its end, its dominant fault, its repair.
    """
    if is_constant and (kind or with_repair):
        raise click.UsageError("--constant excludes --fault and --repair")
    if executor == _SERIAL and (workers or scheduler):
        raise click.UsageError("--workers and --scheduler need --executor")
    with one_clear_line():
        if folder.exists():
            raise ValueError(f"{folder} is there already: give a folder that is not")
        folder.mkdir(parents=True)
        jobs = [
            LifeJob(folder.resolve(), seed, number, kind, form, is_constant, with_repair)
            for number in range(count)
        ]
        index: dict[int, dict[str, object]] = {}
        with deferred_signals() as stop, progress_bar() as progress:
            if executor == _SERIAL:
                made = _one_by_one(jobs, stop, progress)
            else:
                made = _side_by_side(jobs, stop, progress, executor, workers, scheduler)
            for number, line in made:
                index[number] = line
                lines = [index[number] for number in sorted(index)]
                pd.DataFrame(lines).to_csv(folder / INDEX, index=False)
        if len(index) < count:
            raise ValueError(f"stopped: {len(index)} of {count} lives are in {folder}")
    click.echo(f"{folder}: {count} {'life' if count == 1 else 'lives'}, the truth in {INDEX}")


def _one_by_one(
    jobs: Sequence[LifeJob], stop: StopRequest, progress: Any
) -> Iterator[tuple[int, dict[str, object]]]:
    """Make lives in this process, until it is asked to stop."""
    task = progress.add_task("simulating", total=None)
    for job in jobs:

        def follow(test: int, tests: int, job: LifeJob = job) -> None:
            state = f"life {job.number + 1} of {len(jobs)}"
            progress.update(task, completed=test, total=tests, state=state)

        line = make_life(job, stop, follow)
        if line is None:
            return
        yield job.number, line


def _side_by_side(
    jobs: Sequence[LifeJob],
    stop: StopRequest,
    progress: Any,
    executor: str,
    workers: int | None,
    scheduler: str,
) -> Iterator[tuple[int, dict[str, object]]]:
    """Make lives in a pool; once it is asked to stop, those that were begun are completed."""
    task = progress.add_task("simulating", total=len(jobs))
    try:
        with open_pool(executor, workers_or_all(workers), scheduler) as pool:
            for outcome in pool.run(make_life_by_itself, (job for job in jobs if not stop)):
                progress.advance(task)
                yield outcome.name.number, outcome.result()
    except (ClusterLostError, WorkerLostError) as error:
        raise ValueError(f"{error}; the lives so far are in {jobs[0].folder}") from error
    finally:
        limit_threads(None)
