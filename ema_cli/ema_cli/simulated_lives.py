# SPDX-License-Identifier: Apache-2.0
"""Simulation of lives, written as bags or as estimates."""

import json
import math
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_cli.output import new_bag
from ema_core.description import ActuatorDescription
from ema_core.faults import COMPONENTS
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibrations import CALIBRATION_FILE
from ema_monitor.diagnosis import Diagnosed, Diagnosis
from ema_monitor.health import HealthLimits
from ema_monitor.identification.estimate import Estimate, by_fault, estimate_record
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.model.threads import limit_threads
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_sim.bench import ActuatorBench, BenchSettings
from ema_sim.lives import NOISE_OF_DISTURBED, SimulatedLife, constant_life, run_to_failure
from ema_sim.sensors import Sensors

_NS_PER_HOUR: Final = 3_600_000_000_000
# The last start of a test is a day before the end of timestamps, because a test takes seconds.
_LAST_STAMP_NS: Final = (2**31 - 86_400) * 1_000_000_000
_GAP_BLOCKS: Final = 3
_MEASURED: Final = ("faults", "covariance", "unobservable", "goodness_of_fit")
_PART: Final = ".part"


def unit_of_life(seed: int, number: int) -> ActuatorDescription:
    """Return the description of the unit in a life: the built-in actuator with a serial number."""
    built_in = ActuatorDescription()
    return replace(built_in, serial_number=f"{built_in.serial_number}-{seed}-{number:04d}")


def calibration_of_life(unit: ActuatorDescription) -> Calibration:
    """Return a calibration for a unit identical to the built-in actuator.

    Simulated units do not scatter, so each new unit shares the built-in actuator's calibration.
    """
    return replace(Calibration.builtin(), serial_number=unit.serial_number)


@dataclass(frozen=True, eq=False)
class LifeTest:
    """A measured test of a life."""

    number: int
    """Running number from 0, counting missing tests."""
    hours: float
    """Service hour [h]."""
    start_ns: int
    """Timestamp of the start, ``hours`` after the start of the life [ns]."""
    faults: NDArray[np.float64]
    """True faults, ``(8,)``."""
    window: str
    """Quality of the window, a ``WindowKind`` of ``ema_sim.lives``."""
    blocks: list[Telemetry]
    """Telemetry, without the blocks in a gap."""


def simulated_tests(
    life: SimulatedLife,
    description: ActuatorDescription,
    rng: np.random.Generator,
    begin_ns: int = 0,
) -> Iterator[LifeTest]:
    """Yield the simulated tests of a life that starts at ``begin_ns`` [ns].

    Tests with the window "missing" are skipped.
    """
    bench = ActuatorBench(description, BenchSettings(hours_per_cycle=0.0))
    noise = Sensors(NOISE_OF_DISTURBED, {}, rng)
    for number, (hours, faults, window) in enumerate(
        zip(life.hours, life.faults, life.windows, strict=True)
    ):
        if window == "missing":
            continue
        bench.set_faults(faults)
        start_ns = begin_ns + round(float(hours) * _NS_PER_HOUR)
        blocks = [block for block, _ in bench.begin_cycle(start_ns).blocks]
        if window == "noisy":
            blocks = [noise.measure(block) for block in blocks]
        if window == "gap":
            # A gap inside the window, which lasts from 0.8 s to 1.3 s of 1.7 s.
            at = 3 * len(blocks) // 5
            del blocks[at : at + _GAP_BLOCKS]
        yield LifeTest(number, float(hours), start_ns, faults, window, blocks)


def write_test(path: Path, test: LifeTest, description: ActuatorDescription) -> None:
    """Write a test to a bag, with its true faults and the service hours before it."""
    with new_bag(path) as writer, SimulatedActuatorBag(writer, description, test.start_ns) as bag:
        bag.begin_cycle(test.number, test.faults, test.hours)
        for block in test.blocks:
            bag.write_block(block)


def with_estimates(
    tests: Iterable[LifeTest], description: ActuatorDescription
) -> Iterator[tuple[LifeTest, Estimate]]:
    """Yield each test of an actuator with the estimate of a monitor, whether valid or not."""
    calibration, diagnosis = calibration_of_life(description), Diagnosis()
    for test in tests:
        finder = WindowFinder(TriggerSettings(), description)
        events = [event for block in test.blocks for event in finder.feed(block)]
        segment = next(item for item in [*events, *finder.finish()] if isinstance(item, Segment))
        for entry in diagnosis.add(segment, calibration, SearchSettings()):
            if isinstance(entry, Diagnosed):
                yield test, entry.estimate


def as_line(test: LifeTest, estimate: Estimate) -> str:
    """Return a test and its estimate as a line of JSON, with null for NaN and infinity."""
    record = estimate_record(estimate)
    content = {
        "test": test.number,
        "hours": test.hours,
        "window": test.window,
        "valid": record["valid"],
        "reason": record["reason"],
        "truth": by_fault(test.faults),
        **{name: record[name] for name in _MEASURED},
    }
    return json.dumps(content) + "\n"


@dataclass(frozen=True)
class LifeJob:
    """Job to simulate a life."""

    folder: Path
    """Parent folder of the output."""
    seed: int
    number: int
    """Seed of all lives and number of this life, which determine all random values."""
    kind: str | None
    """Dominant fault; drawn if None."""
    form: str
    """"bags" or "estimates"."""
    is_constant: bool
    with_repair: bool
    start_ns: int = 0
    """Timestamp of the start of the life [ns]."""

    @property
    def name(self) -> str:
        """Name of the life."""
        return f"life_{self.number:04d}"


def make_life(job: LifeJob) -> dict[str, object]:
    """Simulate a life on one core, write it, and return its row in the table of lives.

    The end and the repair are None in a life without them.
    """
    limit_threads(1)
    of_life, of_sensors = np.random.default_rng([job.seed, job.number]).spawn(2)
    limits = {name: HealthLimits().of(name) for name in COMPONENTS}
    if job.is_constant:
        life = constant_life(limits, of_life)
    else:
        life = run_to_failure(limits, of_life, job.kind, with_repair=job.with_repair)
    description = unit_of_life(job.seed, job.number)
    most_ns = _LAST_STAMP_NS - round(float(life.hours[-1]) * _NS_PER_HOUR)
    if job.start_ns > most_ns:
        latest = datetime.fromtimestamp(most_ns // 1_000_000_000, UTC)
        raise ValueError(
            f"--start: a life lasts {life.hours[-1]:.0f} h and message stamps end on 2038-01-18: "
            f"expected a date from 1970-01-01 to {latest:%Y-%m-%d}"
        )
    tests = simulated_tests(life, description, of_sensors, job.start_ns)
    # Use a temporary name until complete; a killed worker may have left partial output.
    part = job.folder / f"{job.name}{_PART}"
    _remove(part)
    try:
        if job.form == "bags":
            part.mkdir()
            calibration_of_life(description).save(part / CALIBRATION_FILE)
            for test in tests:
                write_test(part / f"test_{test.number:04d}.mcap", test, description)
        else:
            with part.open("w", encoding="utf-8") as file:
                file.writelines(as_line(*test) for test in with_estimates(tests, description))
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


def remove_parts(folder: Path) -> None:
    """Remove partial output of incomplete lives."""
    for part in folder.glob(f"*{_PART}"):
        _remove(part)


def _remove(part: Path) -> None:
    if part.is_dir():
        shutil.rmtree(part)
    else:
        part.unlink(missing_ok=True)
