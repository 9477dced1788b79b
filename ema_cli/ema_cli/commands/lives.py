# SPDX-License-Identifier: Apache-2.0
"""``ema lives``: simulate lives to failure, as bags or as estimates."""

from pathlib import Path
from typing import Final

import click
import pandas as pd

from ema_cli.executor_options import ExecutorOptions, executor_options
from ema_cli.options import NameChoice
from ema_cli.output import start_option
from ema_cli.progress import progress_bar
from ema_cli.simulated_lives import LifeJob, make_life, remove_parts
from ema_core.faults import TYPICAL

INDEX: Final = "lives.csv"
"""File with one line per life."""


@click.command()
@click.option(
    "-o",
    "--output",
    "folder",
    required=True,
    type=click.Path(path_type=Path),
    help="Folder to write; new or empty.",
)
@click.option("--count", default=1, type=click.IntRange(1, 10_000), help="Number of lives.")
@click.option(
    "--seed",
    default=0,
    type=click.IntRange(0),
    help="Seed; the first lives of a seed do not depend on --count.",
)
@click.option(
    "--fault",
    type=NameChoice("fault", TYPICAL),
    help="Dominant fault; by default drawn for each life.",
)
@click.option(
    "--as",
    "form",
    default="bags",
    type=click.Choice(["bags", "estimates"]),
    help=(
        "bags: a folder per life, with a bag per test and the calibration. estimates: a file per "
        "life, with true faults and estimate of each test as JSON (keys: docs/prognosis.md)."
    ),
)
@click.option(
    "--constant", "is_constant", is_flag=True, help="Simulate lives without growing faults."
)
@click.option(
    "--repair", "with_repair", is_flag=True, help="Repair the dominant fault once in each life."
)
@start_option("UTC time at which each life begins")
@executor_options
def lives(
    folder: Path,
    count: int,
    seed: int,
    fault: str | None,
    form: str,
    is_constant: bool,
    with_repair: bool,
    start_ns: int,
    executor: ExecutorOptions,
) -> None:
    """Simulate lives of actuators, test by test, until a fault reaches its limit.

    A test is due every ten service hours; 10 % of the tests are missing, and 3 % are disturbed by
    noise or a gap. Each life belongs to a unit with its own serial number. FOLDER/lives.csv lists
    the true end, dominant fault and repair of each life.
    """
    if is_constant and (fault or with_repair):
        raise click.UsageError("--constant excludes --fault and --repair")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(f"{folder} already exists: expected a new or empty folder")
    folder.mkdir(parents=True, exist_ok=True)
    jobs = [
        LifeJob(folder.resolve(), seed, number, fault, form, is_constant, with_repair, start_ns)
        for number in range(count)
    ]
    index: dict[int, dict[str, object]] = {}

    def stopped() -> str:
        remove_parts(folder)
        return f"stopped: {len(index)} of {count} lives are complete in {folder}"

    kept = f"the lives so far are in {folder}"
    with executor.open(stopped, kept) as workers, progress_bar() as progress:
        task = progress.add_task("simulating", total=count)
        for outcome in workers.run(make_life, jobs):
            index[outcome.item.number] = outcome.result()
            lines = [index[number] for number in sorted(index)]
            pd.DataFrame(lines).to_csv(folder / INDEX, index=False)
            progress.advance(task)
    click.echo(
        f"{folder}: {count} {'life' if count == 1 else 'lives'}, true ends and faults in {INDEX}"
    )
