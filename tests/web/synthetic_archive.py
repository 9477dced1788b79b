# SPDX-License-Identifier: Apache-2.0
"""Write tables of a random fleet to a folder, and print the summary that the dashboard serves.

python synthetic_archive.py FOLDER [UNITS]
"""

import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ema_archive.store import Store, insert
from ema_archive.tables import PLACE, UNIT_TABLES
from ema_dashboard.contents import FleetDocument

LATEST = datetime(2031, 5, 20, 14, 30, tzinfo=UTC)
MONTHS = 30
MODELS = ("EMA-200", "EMA-200B", "EMA-75")
FAULTS = ("friction", "backlash", "eccentricity", "short_circuit_b", "overshoot")


def write(folder: Path, count: int) -> None:
    """Write the tables of ``count`` units with random lives to an existing folder."""
    rng = np.random.default_rng(19)
    rows: dict[str, list[dict[str, Any]]] = {"units": [], "lives": [], "months": []}
    for number in range(count):
        life = 4000.0 * rng.weibull(2.5)
        hours = 3200.0 * rng.random()
        share = min(hours / life, 1.1)
        level = 3 if rng.random() < 0.02 else int(np.searchsorted((0.75, 1.0), share))
        is_known = level != 3 and share > 0.15
        remaining = max(life - hours, 0.0)
        unit = {"model": MODELS[number % 7 % 3], "unit": f"flap_{number % 8}+{number:04d}"}
        rows["units"].append(
            unit
            | {
                "actuator_id": f"flap_{number % 8}",
                "serial_number": f"{number:04d}",
                "level": level,
                "last_level": number % 3 if level == 3 else level,
                "flight_hours": min(hours, life) if share > 1.0 else hours,
                "health_index": float("nan") if level == 3 else max(1.0 - share, 0.0),
                "dominant_fault": FAULTS[number % 5] if share > 0.5 else "",
                "rul": {
                    "known": is_known,
                    **{
                        f"hours_{q}": k * remaining
                        for q, k in (("05", 0.7), ("50", 1.0), ("95", 1.6))
                    },
                },
                "removal_hours": 0.7 * remaining if is_known else float("nan"),
                "tested": LATEST - timedelta(days=float(rng.exponential(6.0))),
                "calibrated": (
                    None if number % 9 == 0 else LATEST - timedelta(days=float(900 * rng.random()))
                ),
            }
        )
        end = min(hours, life)
        rows["lives"].append(
            unit
            | {"life": 0, "begin_hours": 0.0, "from_age": min(200.0 * rng.random(), end)}
            | {"to_age": end, "has_failed": bool(hours >= life)}
        )
        for month in range(int(MONTHS * rng.random()), MONTHS):
            if rng.random() < 0.06:
                continue
            windows = int(rng.integers(12, 31))
            name = f"{2028 + (month + 11) // 12}-{(month + 11) % 12 + 1:02d}"
            valid = int(rng.binomial(windows, 0.97))
            rows["months"].append(unit | {"month": name, "windows": windows, "valid": valid})
    with Store(folder, is_new=True) as store, store.changing() as db:
        for name, table_rows in rows.items():
            schema = pa.schema([*((key, pa.string()) for key in PLACE), *UNIT_TABLES[name]])
            insert(db, name, pa.Table.from_pylist(table_rows, schema))


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(exist_ok=True)
    write(folder, int((*sys.argv[2:], 1600)[0]))
    print(FleetDocument(str(folder))({"most": "20"}, "").content.decode())
