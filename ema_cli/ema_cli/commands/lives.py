"""``ema lives``: simulated lives to failure, as bags or as estimates."""

import math
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import click
import numpy as np
import pandas as pd

from ema_cli.bags.unit_record import CALIBRATION_FILE
from ema_cli.errors import NameChoice, one_clear_line
from ema_cli.lives.files import as_line, with_estimates, write_test
from ema_cli.lives.tests_of_life import LifeTest, calibration_of_life, simulated_tests, unit_of_life
from ema_cli.processes.stop_request import deferred_signals
from ema_cli.show.progress import progress_bar
from ema_core.description import ActuatorDescription
from ema_core.faults import COMPONENTS, TYPICAL
from ema_monitor.health import HealthLimits
from ema_sim.lives import SimulatedLife, constant_life, run_to_failure

INDEX: Final = "lives.csv"
"""File with a line about each life."""

_PART: Final = ".part"


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
def lives(
    folder: Path,
    count: int,
    seed: int,
    kind: str | None,
    form: str,
    is_constant: bool,
    with_repair: bool,
) -> None:
    """Simulate actuators from new until a fault reaches its limit, test by test.

    A test is due every ten flight hours; a tenth is missing, and three in a hundred are disturbed
    by noise or a gap. Each life is that of a unit with a serial number of its own. FOLDER/lives.csv
    holds the truth about each life: its end, its dominant fault, its repair.
    """
    if is_constant and (kind or with_repair):
        raise click.UsageError("--constant excludes --fault and --repair")
    with one_clear_line():
        if folder.exists():
            raise ValueError(f"{folder} is there already: give a folder that is not")
        folder.mkdir(parents=True)
        index: list[dict[str, object]] = []
        with deferred_signals() as stop, progress_bar() as progress:
            task = progress.add_task("simulating", total=None)
            for number in range(count):
                of_life, of_sensors = np.random.default_rng([seed, number]).spawn(2)
                life = _drawn(of_life, kind, is_constant=is_constant, with_repair=with_repair)
                state = f"life {number + 1} of {count}"
                progress.update(task, completed=0, total=len(life.hours), state=state)
                description = unit_of_life(seed, number)
                tests = simulated_tests(life, description, of_sensors, stop)
                name = f"life_{number:04d}"
                # Under another name until it is complete.
                part = folder / f"{name}{_PART}"
                write = _write_bags if form == "bags" else _write_estimates
                try:
                    for test in write(part, tests, description):
                        progress.update(task, completed=test.number)
                except OSError as error:
                    _remove(part)
                    words = error.strerror or str(error)
                    raise OSError(error.errno, words, error.filename or str(part)) from error
                if stop:
                    _remove(part)
                    raise ValueError(f"stopped: {number} of {count} lives are in {folder}")
                part.rename(folder / (name if form == "bags" else f"{name}.jsonl"))
                index.append(_index_line(name, description, life))
                pd.DataFrame(index).to_csv(folder / INDEX, index=False)
    click.echo(f"{folder}: {count} {'life' if count == 1 else 'lives'}, the truth in {INDEX}")


def _drawn(
    rng: np.random.Generator, kind: str | None, *, is_constant: bool, with_repair: bool
) -> SimulatedLife:
    limits = HealthLimits()
    by_fault = {name: limits.of(name) for name in COMPONENTS}
    if is_constant:
        return constant_life(by_fault, rng)
    return run_to_failure(by_fault, rng, kind, with_repair=with_repair)


def _write_bags(
    folder: Path, tests: Iterable[LifeTest], description: ActuatorDescription
) -> Iterator[LifeTest]:
    """Write the tests of a life and yield each as it is written."""
    folder.mkdir()
    calibration_of_life(description).save(folder / CALIBRATION_FILE)
    for test in tests:
        write_test(folder / f"test_{test.number:04d}.mcap", test, description)
        yield test


def _write_estimates(
    path: Path, tests: Iterable[LifeTest], description: ActuatorDescription
) -> Iterator[LifeTest]:
    """Write the tests of a life and yield each as it is written."""
    with path.open("w", encoding="utf-8") as file:
        for test, estimate in with_estimates(tests, description):
            file.write(as_line(test, estimate))
            yield test


def _remove(part: Path) -> None:
    if part.is_dir():
        shutil.rmtree(part)
    else:
        part.unlink(missing_ok=True)


def _index_line(name: str, unit: ActuatorDescription, life: SimulatedLife) -> dict[str, object]:
    """Return the line about a life; no end and no repair are empty cells."""
    return {
        "life": name,
        "serial_number": unit.serial_number,
        "dominant_fault": life.dominant,
        "end_hours": life.end_hours if math.isfinite(life.end_hours) else None,
        "repair_hours": life.repair_hours if math.isfinite(life.repair_hours) else None,
        "tests": len(life.hours),
        "missing": life.windows.count("missing"),
        "disturbed": life.windows.count("noisy") + life.windows.count("gap"),
    }
