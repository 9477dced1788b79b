"""Bags of a small fleet: two units with calibrations of their own, over three months."""

import math
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from click.testing import Result

from ema_archive.manifest import Manifest
from ema_archive.partitions import TABLES
from ema_archive.running import run, scan
from ema_cli.simulated_lives import (
    calibration_of_life,
    simulated_tests,
    unit_of_life,
    write_test,
)
from ema_core.faults import fault_vector
from ema_core.tasks import Workers
from ema_monitor.model.threads import limit_threads
from ema_sim.lives import SimulatedLife, WindowKind

from .. import commands

HOURS = (300.0, 600.0, 900.0, 1200.0, 1500.0)
WINDOWS: tuple[WindowKind, ...] = ("good", "good", "gap", "good", "good")

Ema = Callable[..., Result]


@pytest.fixture(scope="session")
def ema() -> Ema:
    return commands.ema


@pytest.fixture(scope="session")
def made_fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder a unit, with a bag a test; friction grows in one, backlash in the other."""
    root = tmp_path_factory.mktemp("fleet") / "bags"
    for number, kind in enumerate(("friction", "backlash")):
        faults = np.array([fault_vector({kind: 0.05 + 0.06 * i}) for i in range(len(HOURS))])
        life = SimulatedLife(kind, {}, np.array(HOURS), faults, WINDOWS, math.inf)
        description = replace(unit_of_life(0, number), actuator_id=f"flap {number}")
        folder = root / f"unit_{number}"
        folder.mkdir(parents=True)
        calibration = replace(calibration_of_life(description), actuator_id=description.actuator_id)
        calibration.save(folder / "calibration.yaml")
        rng = np.random.default_rng(number)
        for test in simulated_tests(life, description, rng):
            # Names whose order is not that of the tests.
            write_test(folder / f"{9 - test.number}.mcap", test, description)
    return root


@pytest.fixture(scope="session")
def whole(made_fleet: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An archive of the fleet that no test changes."""
    folder = tmp_path_factory.mktemp("whole") / "archive"
    with Manifest(folder, is_new=True) as manifest, Workers("processes", 2) as pool:
        scan(manifest, [str(made_fleet)])
        run(manifest, pool)
        status = manifest.status(manifest.settings)
    assert (status.bags, status.due, status.units_due, status.damaged_files) == (10, 0, 0, 0)
    return folder


@pytest.fixture
def fleet(made_fleet: Path, tmp_path: Path) -> Path:
    """A copy that a test may change."""
    return Path(shutil.copytree(made_fleet, tmp_path / "bags"))


@pytest.fixture(autouse=True)
def _threads_as_before() -> Iterator[None]:
    yield
    limit_threads(None)


def table_of(archive: Path, name: str) -> pa.Table:
    """Return a table of an archive in a fixed order, without what differs from run to run."""
    import duckdb

    files = f"{archive / TABLES / name}/**/*.parquet"
    with duckdb.connect() as db:
        table = db.sql(f"SELECT * FROM read_parquet('{files}') ORDER BY ALL").to_arrow_table()
    times = [name for name in table.column_names if name == "computing_time_s"]
    return table.drop_columns(times)


def exactly(archive: Path, name: str) -> list[str]:
    """Return the rows of a table as texts that show every bit, and in which NaN equals itself."""
    return [repr(row) for row in table_of(archive, name).to_pylist()]
