"""All targets in one table, from what the other benchmarks wrote.

    python benchmarks/summary.py

Reads the JSON files that `make bench` writes beside this file, prints the table, writes it to
summary.json, and fails when a target is missed.
"""

import json
from pathlib import Path
from typing import Any, Final

import advisory
import archive
import design
import field_oriented
import memory
import normal
import ordinary_motion
import resume
import sampling
import startup
import targets
import trust
import unknown_drive
from prognosis import own_tables
from rich.console import Console
from tables import target_table
from targets import Row, at_least, at_most, untargeted

HERE: Final = Path(__file__).parent
_KERNEL_SHARE: Final = 0.9
_SCALING: Final = 1.7
_ACTUATORS: Final = 16
_LARGE_BATCH: Final = 64


def kernel_rows(figures: dict[str, Any]) -> list[Row]:
    """Return the rows of the batch kernel: its speed in yardsticks, and on two cores."""
    same_form = figures["yardstick_form"]["ratio"]["median"]
    what = "kernel, yardstick's form, 16 lanes, of the yardstick's speed"
    result = [at_least(what, same_form, _KERNEL_SHARE)]
    for run in figures["monitor"].values():
        ratio = run["cores_1"]["ratio"]["median"]
        what = f"  shipped form, {1e6 * run['dt_s']:.0f} us steps, {run['batch']} individuals"
        result.append(untargeted(what, f"{ratio:.2f}"))
        if run["batch"] >= _LARGE_BATCH:
            result.append(at_least("  two cores over one", run["scaling"]["median"], _SCALING))
    for case, by_name in figures["reference"].items():
        ratio, time_ns = by_name["C++"]["ratio"]["median"], by_name["numba"]["value"]["median"]
        what = f"reference step, {case}, time over that of C++"
        result.append(at_most(what, ratio, 1.0, f"{ratio:.2f} ({time_ns:.0f} ns)"))
    return result


def live_rows(figures: dict[str, Any]) -> list[Row]:
    """Return the rows of the live graph."""
    count = figures["windows"]
    median, late = figures["latency_median_s"], figures["latency_95_percent_s"]
    lost = figures["samples_lost_by_monitor"] + figures["samples_lost_by_recorder"]
    what = f"live, {count} windows: last sample to estimate, median [s]"
    return [
        at_most(what, median, 0.1, f"{median:.3f}"),
        at_least("  windows", count, 100, str(count)),
        at_most("  95th percentile [s]", late, 0.3, f"{late:.3f}"),
        Row("  samples lost", "0", f"{lost} of {figures['samples']}", lost == 0),
    ]


def fleet_rows(figures: dict[str, Any]) -> list[Row]:
    """Return the row of the fleet that one monitor follows."""
    rows = [row for row in figures["rows"] if row["monitors"] == 1]
    followed = max((row["actuators"] for row in rows if row["is_followed"]), default=0)
    tried = f"{followed} of {max(row['actuators'] for row in rows)} tried"
    return [at_least("actuators that one monitor follows", followed, _ACTUATORS, tried)]


def main() -> None:
    """Print the table, write it, and fail when a target is missed."""
    parts = {
        "accuracy": targets.rows,
        "field_oriented": field_oriented.rows,
        "trust": trust.rows,
        "sampling": sampling.rows,
        "design": design.rows,
        "ordinary_motion": ordinary_motion.rows,
        "unknown_drive": unknown_drive.rows,
        "normal": normal.rows,
        "kernels": kernel_rows,
        "live": live_rows,
        "many_actuators": fleet_rows,
        "startup": startup.rows,
        "resume": resume.rows,
        "memory": memory.rows,
        "archive": archive.rows,
        "prognosis": own_tables.rows,
        "advisory": advisory.rows,
    }
    rows: list[Row] = []
    for name, rows_of in parts.items():
        rows += rows_of(json.loads((HERE / f"{name}.json").read_text()))
    beside = f"thesis, or\n{own_tables.BESIDE}"
    Console(width=140).print(target_table("targets", rows, beside))
    content = [row._asdict() | {"met": None if row.met is None else bool(row.met)} for row in rows]
    (HERE / "summary.json").write_text(json.dumps(content, indent=2))
    missed = sum(row.met is False for row in rows)
    raise SystemExit(f"{missed} targets missed" if missed else 0)


if __name__ == "__main__":
    main()
