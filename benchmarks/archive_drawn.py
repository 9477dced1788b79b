# SPDX-License-Identifier: Apache-2.0
"""Tests of a fleet, drawn at random instead of recorded. Worker processes import this module."""

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
from prognosis.whole import worn

from ema_archive.bag_task import DONE, BagResult, BagTask, UnitRows
from ema_archive.settings import estimation_software
from ema_archive.sources import content_digest
from ema_archive.store import Store, insert
from ema_archive.tables import HEALTH, count_row, estimate_row, placed
from ema_monitor.prognosis.history_entry import Count

MODEL: Final = "drawn"
HOURS_A_TEST: Final = 24.0
_NS_PER_HOUR: Final = 3_600_000_000_000


def make_stubs(folder: Path, units: int, tests: int) -> None:
    """Write one small file per test, in one folder per unit; ``tests`` counts all units."""
    for unit in range(units):
        place = folder / f"unit_{unit:04d}"
        place.mkdir(parents=True)
        for number in range(tests // units):
            stub = json.dumps({"unit": unit, "number": number, "of": tests // units})
            (place / f"test_{number:05d}.mcap").write_text(stub, encoding="utf-8")


def draw(task: BagTask) -> BagResult:
    """Return the result of a task with a random estimate, for a file of ``make_stubs``."""
    path = Path(task.url)
    test = json.loads(path.read_text(encoding="utf-8"))
    unit, number = test["unit"], test["number"]
    rng, hours = np.random.default_rng([unit, number]), number * HOURS_A_TEST
    estimate = worn(hours, number / test["of"], rng)
    names = {"actuator_id": "flap", "serial_number": f"drawn-{unit:04d}"}
    sha256 = content_digest(path)
    made = {
        "bag": task.url,
        "bag_sha256": sha256,
        "software": estimation_software(),
        "settings": task.settings.estimation_id,
    }
    count = Count(estimate.start_ns, hours, number)
    rows = UnitRows(
        **names,
        model=MODEL,
        calibration_id=estimate.calibration_id,
        estimates=[estimate_row(estimate, 0) | names | made],
        usage=[count_row(count, 0) | names | {"bag": task.url}],
        duty=[],
    )
    return BagResult(task, DONE, sha256=sha256, units=[rows])


def write_drawn_health(archive: Path, units: int, tests: int) -> None:
    """Create an archive with ``tests`` rows of health per unit, and the latest row of each."""
    import pyarrow as pa

    tables = []
    for unit in range(units):
        rng = np.random.default_rng([1, unit])
        end = 0.2 + rng.random()
        share = np.linspace(0.0, end, tests)
        level = np.select([share > 1.0, share > 0.6], [2, 1], 0)
        stamps = (np.arange(tests, dtype=np.int64) + 1) * 24 * _NS_PER_HOUR
        columns: dict[str, Any] = {
            "actuator_id": ["flap"] * tests,
            "serial_number": [f"drawn-{unit:04d}"] * tests,
            "tested": stamps // 1000,
            "tested_ns": stamps,
            "flight_hours": np.arange(tests) * HOURS_A_TEST,
            "cycles": np.arange(tests),
            "level": level,
            "health_index": np.clip(1.0 - share, 0.0, 1.0),
            "severity": np.clip(np.ceil(4.0 * share), 0, 4),
            "confidence": np.ones(tests),
            "dominant_fault": np.where(level > 0, "friction", ""),
            "rul": [
                {
                    "known": True,
                    "hours_05": 800.0 * left,
                    "hours_50": 1000.0 * left,
                    "hours_95": 1300.0 * left,
                }
                for left in (1.2 - share).tolist()
            ],
            "events": [[]] * tests,
        }
        arrays = [
            pa.array(columns[field.name], field.type)
            if field.name in columns
            else pa.nulls(tests, field.type)
            for field in HEALTH
        ]
        table = pa.Table.from_arrays(arrays, schema=HEALTH)
        tables.append(placed(table, MODEL, f"flap+drawn-{unit:04d}"))
    with Store(archive, is_new=True) as store, store.changing() as db:
        insert(db, "health", pa.concat_tables(tables))
        insert(db, "units", pa.concat_tables(table.slice(tests - 1) for table in tables))
