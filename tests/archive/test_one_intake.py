# SPDX-License-Identifier: Apache-2.0
"""A recording gives bit-identical results through a monitor, `ema predict` and an archive.

The duty affects the growth, each window has measured causes, and each test a count of service
hours.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from ema_archive.manifest import Manifest
from ema_archive.running import run, scan
from ema_archive.settings import ArchiveSettings
from ema_archive.tables import BAG_TABLES, HEALTH, estimate_row, growth_rows, health_row
from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_bags.writer import BagWriter
from ema_cli.bags.predicting import Predicting
from ema_cli.bags.unit_course import diagnose_unit
from ema_core.commands import THESIS_CHIRP, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_core.tasks import Workers
from ema_core.telemetry import Telemetry
from ema_interfaces.msg import HiddenCause, MeasuredCauses
from ema_monitor import Count, Diagnosed, Monitor, MonitorSettings, Outlook
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.prognosis.duty.damage import DamageSettings
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.reports import health_report
from ema_ros import topics
from ema_ros.stamps import stamp_to_message
from ema_sim.actuator import SimulatedActuator

from .conftest import rows_of_unit, table_of

pytestmark = pytest.mark.slow

UNIT = ActuatorDescription()
CYCLE = build_cycle(THESIS_CHIRP, UNIT.sample_period)
CYCLES = 14
HOURS = 100.0
START_NS = 1_700_000_000_000_000_000
COLD = SearchSettings(warm_start=False)
# Telemetry covers a test of 1.7 s every 100 h, and represents the whole interval.
BY_DAMAGE = PrognosisSettings(damage=DamageSettings(least_coverage=1e-6))
PROVENANCE = {
    *("actuator_id", "serial_number"),
    *("bag", "bag_sha256", "software", "settings", "computing_time"),
}


@dataclass(frozen=True)
class Received:
    """Inputs of a test cycle: blocks, the count before them, and causes measured for the window."""

    number: int
    blocks: list[Telemetry]
    count: Count
    measured_ns: int
    measured: dict[str, tuple[float, float]]


@pytest.fixture(scope="module")
def cycles() -> list[Received]:
    """Return test cycles under load, in which friction grows and the winding becomes warmer."""
    actuator, received = SimulatedActuator(stamp_ns=START_NS), []
    for number in range(CYCLES):
        actuator.faults = fault_vector({"friction": 0.02 * number})
        load = 0.1 + 0.04 * number
        actuator.causes = {"load_torque": load}
        whole = actuator.advance(CYCLE.samples)
        blocks = [whole.part(start, start + 500) for start in range(0, len(whole) - 500, 500)]
        blocks.append(whole.part(500 * len(blocks), len(whole)))
        count = Count(whole.stamp_ns, HOURS * number, number + 1)
        causes = {"load_torque": (load, 0.005), "winding_temperature": (2.0 * number, 1.0)}
        received.append(Received(number, blocks, count, whole.stamp_ns, causes))
    return received


@pytest.fixture(scope="module")
def bag(cycles: list[Received], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("recording") / "unit.mcap", cycles)


def write_bag(path: Path, cycles: list[Received]) -> Path:
    writer, topic = BagWriter(path), f"{topics.NAMESPACE}/{topics.MEASURED_CAUSES}"
    with SimulatedActuatorBag(writer, UNIT, cycles[0].measured_ns) as recording:
        writer.add_topic(topic, *topics.SYSTEM_TOPICS[topics.MEASURED_CAUSES])
        for cycle in cycles:
            recording.begin_cycle(cycle.number, fault_vector({}), cycle.count.hours)
            writer.write(topic, message_of(cycle), cycle.measured_ns, cycle.measured_ns)
            for block in cycle.blocks:
                recording.write_block(block)
    return path


def message_of(cycle: Received) -> MeasuredCauses:
    units = {"load_torque": "N.m", "winding_temperature": "K"}
    message = MeasuredCauses(
        actuator_id=UNIT.actuator_id,
        causes=[
            HiddenCause(name=name, value=value, sigma=sigma, unit=units[name])
            for name, (value, sigma) in cycle.measured.items()
        ],
    )
    message.header.stamp = stamp_to_message(cycle.measured_ns)
    return message


def monitored(cycles: list[Received]) -> Iterator[tuple[Estimate, Outlook]]:
    """Yield each estimate of a monitor that receives the cycles, with the outlook after it."""
    monitor = Monitor(UNIT, settings=MonitorSettings(search=COLD, prognosis=BY_DAMAGE))
    for cycle in cycles:
        monitor.count(cycle.count)
        monitor.measure(cycle.measured_ns, cycle.measured)
        for block in cycle.blocks:
            estimate = None
            for event in monitor.feed(block):
                if isinstance(event, Diagnosed):
                    estimate = event.estimate
                elif isinstance(event, Outlook):
                    assert estimate is not None
                    yield estimate, event


def predicted(path: Path, prognosis: PrognosisSettings):
    return diagnose_unit([path], Predicting(search=COLD, prognosis=prognosis))


def rows_of(steps) -> dict[str, list[str]]:
    """Return estimates, health and growth as texts of rows, which show every bit."""
    estimates = [estimate_row(estimate, number) for number, (estimate, _) in enumerate(steps)]
    reports = [health_report(outlook, UNIT.unit_key) for _, outlook in steps]
    health = [
        health_row(report, estimate.calibration_id)
        for report, (estimate, _) in zip(reports, steps, strict=True)
    ]
    return {
        "estimates": as_texts(estimates, BAG_TABLES["estimates"]),
        "health": as_texts(health, HEALTH),
        "growth": sorted(repr(plain(row)) for row in growth_rows(reports[-1])),
    }


def as_texts(rows: list[dict], schema: pa.Schema) -> list[str]:
    return [repr(plain(row)) for row in pa.Table.from_pylist(rows, schema).to_pylist()]


def plain(row: dict) -> dict:
    """Return a row without its provenance, with the columns sorted by name."""
    return {name: value for name, value in sorted(row.items()) if name not in PROVENANCE}


@pytest.fixture(scope="module")
def course(bag: Path):
    return predicted(bag, BY_DAMAGE)


def test_duty_and_measured_causes_change_the_prognosis(course, bag):
    """Check the recording itself: the remaining life differs if duty is ignored."""
    assert all(estimate.valid and len(estimate.measured) == 2 for estimate in course.estimates)
    assert [step.outlook.flight_hours for step in course.steps] == [
        HOURS * n for n in range(CYCLES)
    ]
    duty = course.growth.duty
    assert np.isfinite(duty.reference).all()
    by_hours = predicted(bag, PrognosisSettings(damage=DamageSettings(growth_per="hours")))
    lives = [unit.now.rul for unit in (course, by_hours)]
    assert all(life.known for life in lives)
    assert lives[0].hours_50 != lives[1].hours_50


def test_monitor_gives_the_same_results_as_the_command(course, cycles):
    assert rows_of(list(monitored(cycles))) == rows_of(course.steps)


def archived(archive: Path, folder: Path) -> dict[str, list[str]]:
    """Scan and run a folder; return the rows of the archive."""
    is_new = not archive.exists()
    with Manifest(archive, is_new=is_new) as manifest, Workers("threads", 1) as pool:
        manifest.settings = ArchiveSettings(prognosis=BY_DAMAGE)
        scan(manifest, [str(folder)])
        run(manifest, pool)
    [unit] = table_of(archive, "units")["unit"].to_pylist()
    tables = {
        name: [repr(plain(row)) for row in rows_of_unit(archive, name, unit).to_pylist()]
        for name in ("estimates", "health", "growth")
    }
    return tables | {"growth": sorted(tables["growth"])}


def test_archive_gives_the_same_results_as_the_command(course, bag, tmp_path):
    assert archived(tmp_path / "archive", bag.parent) == rows_of(course.steps)


def test_archive_continued_by_a_later_bag_gives_the_same_results_as_the_command(cycles, tmp_path):
    """The first bag ends within a cycle: duty after its last window belongs to the next test."""
    folder, archive = tmp_path / "bags", tmp_path / "archive"
    folder.mkdir()
    *before, cut, last = cycles
    write_bag(folder / "first.mcap", [*before, replace(cut, blocks=cut.blocks[:5])])
    assert len(archived(archive, folder)["health"]) == CYCLES - 2
    write_bag(folder / "second.mcap", [replace(cut, blocks=cut.blocks[5:]), last])
    rows = archived(archive, folder)
    course = predicted(folder, BY_DAMAGE)
    assert len(course.steps) == CYCLES
    health = rows_of(course.steps)["health"]
    assert (rows["health"], len(rows["estimates"])) == (health, CYCLES)
