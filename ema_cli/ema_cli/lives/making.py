"""The task of a life: drawn, simulated test by test, and written to a folder or a file."""

import math
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ema_cli.bags.unit_record import CALIBRATION_FILE
from ema_cli.lives.files import as_line, with_estimates, write_test
from ema_cli.lives.tests_of_life import LifeTest, calibration_of_life, simulated_tests, unit_of_life
from ema_core.description import ActuatorDescription
from ema_core.faults import COMPONENTS
from ema_monitor.health import HealthLimits
from ema_monitor.model.threads import limit_threads
from ema_sim.lives import SimulatedLife, constant_life, run_to_failure

_PART: Final = ".part"


@dataclass(frozen=True)
class LifeJob:
    """A life that is to be made.

    Attributes
    ----------
    folder
        Where its folder or file is made.
    seed, number
        What is random follows from both.
    kind
        Dominant fault; drawn when None.
    form
        "bags" or "estimates".
    """

    folder: Path
    seed: int
    number: int
    kind: str | None
    form: str
    is_constant: bool
    with_repair: bool

    @property
    def name(self) -> str:
        """Name of the life."""
        return f"life_{self.number:04d}"


def make_life(job: LifeJob) -> dict[str, object]:
    """Make a life on one core; return the line about it, with no end and no repair as empty cells.

    Raises
    ------
    OSError
        When it cannot be written; nothing is left of it.
    """
    limit_threads(1)
    of_life, of_sensors = np.random.default_rng([job.seed, job.number]).spawn(2)
    life = _drawn(job, of_life)
    description = unit_of_life(job.seed, job.number)
    tests = simulated_tests(life, description, of_sensors)
    # Under another name until it is complete; a worker that was killed may have left one.
    part = job.folder / f"{job.name}{_PART}"
    _remove(part)
    write = _write_bags if job.form == "bags" else _write_estimates
    try:
        write(part, tests, description)
    except OSError as error:
        _remove(part)
        words = error.strerror or str(error)
        raise OSError(error.errno, words, error.filename or str(part)) from error
    part.rename(job.folder / (job.name if job.form == "bags" else f"{job.name}.jsonl"))
    return {
        "life": job.name,
        "serial_number": description.serial_number,
        "dominant_fault": life.dominant,
        "end_hours": life.end_hours if math.isfinite(life.end_hours) else None,
        "repair_hours": life.repair_hours if math.isfinite(life.repair_hours) else None,
        "tests": len(life.hours),
        "missing": life.windows.count("missing"),
        "disturbed": life.windows.count("noisy") + life.windows.count("gap"),
    }


def _drawn(job: LifeJob, rng: np.random.Generator) -> SimulatedLife:
    limits = HealthLimits()
    by_fault = {name: limits.of(name) for name in COMPONENTS}
    if job.is_constant:
        return constant_life(by_fault, rng)
    return run_to_failure(by_fault, rng, job.kind, with_repair=job.with_repair)


def _write_bags(folder: Path, tests: Iterable[LifeTest], description: ActuatorDescription) -> None:
    folder.mkdir()
    calibration_of_life(description).save(folder / CALIBRATION_FILE)
    for test in tests:
        write_test(folder / f"test_{test.number:04d}.mcap", test, description)


def _write_estimates(
    path: Path, tests: Iterable[LifeTest], description: ActuatorDescription
) -> None:
    with path.open("w", encoding="utf-8") as file:
        for test, estimate in with_estimates(tests, description):
            file.write(as_line(test, estimate))


def remove_parts(folder: Path) -> None:
    """Remove what is left of lives that are not complete."""
    for part in folder.glob(f"*{_PART}"):
        _remove(part)


def _remove(part: Path) -> None:
    if part.is_dir():
        shutil.rmtree(part)
    else:
        part.unlink(missing_ok=True)
