"""Bags of a small fleet: two units with calibrations of their own, over three months."""

import math
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from ema_archive.manifest import Manifest
from ema_archive.partitions import TABLES
from ema_archive.running import run, scan
from ema_cli.simulated_lives import calibration_of_life, simulated_tests, unit_of_life, write_test
from ema_core.faults import fault_vector
from ema_core.tasks import Workers
from ema_monitor.model.threads import limit_threads
from ema_sim.lives import SimulatedLife, WindowKind

HOURS = (300.0, 600.0, 900.0, 1200.0, 1500.0)
WINDOWS: tuple[WindowKind, ...] = ("good", "good", "gap", "good", "good")


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


@pytest.fixture(scope="session")
def made_archive(made_fleet: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a copy of the bags and an archive of them; beside it is all of it, as made."""
    root = tmp_path_factory.mktemp("changed") / "now"
    shutil.copytree(made_fleet, root / "bags")
    with Manifest(root / "archive", is_new=True) as manifest, Workers("threads", 2) as pool:
        scan(manifest, [str(root / "bags")])
        tally = run(manifest, pool)
    assert (tally.bags, tally.units) == (10, 2)
    shutil.copytree(root, root.with_name("as made"))
    return root


@pytest.fixture
def fleet(made_archive: Path) -> Path:
    """Bags that a test may change."""
    shutil.rmtree(made_archive)
    shutil.copytree(made_archive.with_name("as made"), made_archive)
    return made_archive / "bags"


@pytest.fixture
def archive(fleet: Path) -> Path:
    """An archive of these bags that a test may change."""
    return fleet.parent / "archive"


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
