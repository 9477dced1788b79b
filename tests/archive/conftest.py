# SPDX-License-Identifier: Apache-2.0
"""Fixtures: bags and archives of two units with separate calibrations, over three months."""

import math
import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from ema_archive.manifest import Manifest
from ema_archive.running import run, scan
from ema_archive.store import FILE, TABLES, Store, insert
from ema_archive.tables import placed
from ema_core.faults import fault_vector
from ema_core.tasks import Workers
from ema_monitor.model.threads import limit_threads
from ema_sim.lives import SimulatedLife, WindowKind

HOURS = (300.0, 600.0, 900.0, 1200.0, 1500.0)
WINDOWS: tuple[WindowKind, ...] = ("good", "good", "gap", "good", "good")


@pytest.fixture(scope="session")
def made_fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder per unit with a bag per test.

    Friction grows in unit 0, backlash in unit 1.
    """
    from ema_cli.simulated_lives import (
        calibration_of_life,
        simulated_tests,
        unit_of_life,
        write_test,
    )

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
            # The order of the names differs from the order of the tests.
            write_test(folder / f"{9 - test.number}.mcap", test, description)
    return root


@pytest.fixture(scope="session")
def whole(made_fleet: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an archive of the fleet that tests only read."""
    folder = tmp_path_factory.mktemp("whole") / "archive"
    with Manifest(folder, is_new=True) as manifest, Workers("processes", 2) as pool:
        scan(manifest, [str(made_fleet)])
        run(manifest, pool)
        status = manifest.status(manifest.settings)
    assert (status.bags, status.due, status.units_due, status.damaged_tables) == (10, 0, 0, [])
    return folder


@pytest.fixture(scope="session")
def made_archive(made_fleet: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with bags and their archive; its copy ``as made`` stays unchanged."""
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
    """Return bags that a test may change."""
    shutil.rmtree(made_archive)
    shutil.copytree(made_archive.with_name("as made"), made_archive)
    return made_archive / "bags"


@pytest.fixture
def archive(fleet: Path) -> Path:
    """Return the archive of ``fleet``, which a test may change."""
    return fleet.parent / "archive"


@pytest.fixture(autouse=True)
def _threads_as_before() -> Iterator[None]:
    yield
    limit_threads(None)


def table_of(archive: Path, name: str) -> pa.Table:
    """Return a table of an archive sorted by all columns, without the computing time."""
    with Store(archive, writes=False) as store, store.reading() as db:
        table = db.execute(f"SELECT * FROM {name} ORDER BY ALL").to_arrow_table()
    times = [name for name in table.column_names if name == "computing_time"]
    return table.drop_columns(times)


def rows_of_unit(archive: Path, name: str, unit: str) -> pa.Table:
    """Return the rows of one unit in a table, ordered by time."""
    with Store(archive, writes=False) as store:
        return store.rows_of_unit(name, unit)


def write_rows(
    archive: Path, name: str, rows: list[dict[str, Any]], unit: str = "unit", model: str = "model"
) -> None:
    """Add rows to a table of an archive; create the archive if it does not exist."""
    with Store(archive, is_new=True) as store, store.changing() as db:
        insert(db, name, placed(pa.Table.from_pylist(rows, TABLES[name]), model, unit))


def damage_rows(archive: Path, table: str) -> None:
    """Flip one bit in the stored rows of a table."""
    with Store(archive, writes=False) as store, store.reading() as db:
        [(size,)] = db.execute(
            "SELECT block_size FROM pragma_database_size() WHERE database_name = 'archive'"
        ).fetchall()
        [(block, offset)] = db.execute(
            f"SELECT block_id, block_offset FROM pragma_storage_info('{table}') "
            "WHERE persistent AND block_id >= 0 AND count > 0 ORDER BY ALL LIMIT 1"
        ).fetchall()
    with (archive / FILE).open("r+b") as file:
        # Three headers of 4096 bytes precede the first block, and a checksum of 8 bytes each block.
        file.seek(3 * 4096 + block * size + 8 + offset)
        [byte] = file.read(1)
        file.seek(-1, os.SEEK_CUR)
        file.write(bytes([byte ^ 1]))


def exactly(archive: Path, name: str) -> list[str]:
    """Return the rows of a table as texts, which show every bit and in which NaN equals NaN."""
    return [repr(row) for row in table_of(archive, name).to_pylist()]
