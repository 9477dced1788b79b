"""An archive at work: time and memory by its size, speed-up, queries, killed workers.

    python archive.py [--full] [--json FILE]

Drawn tests take the place of bags where only their number matters; real bags are those of
simulated lives. Without --full the largest archive has 10,000 tests of 50 units, and there are 60
real bags and 10 kills; with it 100,000 of 500, 1,000 and 200.
"""

import json
import os
import random
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any, Final

import click
import pyarrow as pa
from archive_drawn import MODEL, draw, make_stubs, write_drawn_health
from rich.console import Console
from tables import target_table
from targets import Row

from ema_archive.bag_task import BagTask, diagnose_bag
from ema_archive.manifest import Manifest
from ema_archive.partitions import TABLES, write_table
from ema_archive.query import answer
from ema_archive.running import RunTally, run_bags, run_units, scan, write_summaries
from ema_archive.tables import WHOLE
from ema_bags.reader import Bag
from ema_core.linear_algebra import one_thread
from ema_core.tasks import Workers

FLEET_BAGS: Final = 6_000_000
"""Of 200 aircraft with 8 actuators each, tested daily for ten years."""

FLEET_UNITS: Final = 1600
_ROUNDS: Final = 3
_TIMED_BAGS: Final = 30


def of_size(place: Path, tests: int, units: int) -> dict[str, Any]:
    """Return time and memory of an archive of drawn tests, estimates alone."""
    make_stubs(place / "bags", units, tests)
    began_s, used_s = time.perf_counter(), time.process_time()
    with Manifest(place / "archive", is_new=True) as manifest, Workers("processes", 2) as pool:
        scan(manifest, [str(place / "bags")])
        run_bags(manifest, pool, RunTally(), diagnose=draw)
        taken_s, used_s = time.perf_counter() - began_s, time.process_time() - used_s
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        write_summaries(manifest)
    asked_s = time.perf_counter()
    answer(place / "archive", "select count(*), avg(friction) from estimates where valid")
    written = list((place / "archive").rglob("*.parquet"))
    return {
        "tests": tests,
        "units": units,
        "seconds": taken_s,
        "own_cpu_s": used_s,
        "peak_mb": peak_mb,
        "estimates_query_s": time.perf_counter() - asked_s,
        "files": len(written),
        "megabytes": sum(path.stat().st_size for path in written) / 1e6,
    }


def of_unit(place: Path, tests: int) -> dict[str, Any]:
    """Return what it takes to follow the tests of a unit, and one that is added to them."""
    make_stubs(place / "bags", 1, tests + 1)
    last = max((place / "bags").rglob("*.mcap"))
    last.rename(place / last.name)
    figures: dict[str, Any] = {"tests": tests}
    with Manifest(place / "archive", is_new=True) as manifest, Workers("threads", 1) as pool:
        for name in ("whole", "one_more"):
            if name == "one_more":
                (place / last.name).rename(last)
            tally = RunTally()
            scan(manifest, [str(place / "bags")])
            run_bags(manifest, pool, tally, diagnose=draw)
            used_s = time.process_time()
            run_units(manifest, pool, tally)
            figures[f"{name}_cpu_s"] = time.process_time() - used_s
            figures[f"{name}_followed"] = tally.followed
    return figures


def of_a_bag(bags: Path) -> dict[str, Any]:
    """Return the computing time of a real bag, and how much it records."""
    with tempfile.TemporaryDirectory() as folder, Manifest(Path(folder) / "a", is_new=True) as made:
        scan(made, [str(bags)])
        settings = made.settings
        made.find_due(settings)
        tasks = [BagTask(*bag, settings) for bag in made.due(settings)][:_TIMED_BAGS]
    diagnose_bag(tasks[0])
    used_s = time.process_time()
    for task in tasks:
        diagnose_bag(task)
    used_s = (time.process_time() - used_s) / len(tasks)
    spans = [(bag.end_ns or 0) - (bag.start_ns or 0) for bag in (Bag(t.url) for t in tasks)]
    recorded_s = sum(spans) * 1e-9 / len(tasks)
    return {"cpu_s": used_s, "recorded_s": recorded_s, "bags": len(tasks)}


def of_workers(place: Path, bags: Path) -> dict[str, Any]:
    """Return how long real bags take one and two workers, in turns."""
    seconds: dict[int, list[float]] = {1: [], 2: []}
    done = 0
    for number in range(_ROUNDS):
        for workers, taken in seconds.items():
            archive, tally = place / f"archive_{number}_{workers}", RunTally()
            with Manifest(archive, is_new=True) as manifest, Workers("processes", workers) as pool:
                scan(manifest, [str(bags)])
                settings = manifest.settings
                manifest.find_due(settings)
                warm = BagTask(*next(iter(manifest.due(settings))), settings)
                # Not timed: each process loads its kernels.
                list(pool.run(diagnose_bag, [warm] * 3 * workers))
                began_s = time.perf_counter()
                run_bags(manifest, pool, tally)
                taken.append(time.perf_counter() - began_s)
                done = tally.bags
    ratios = [one / two for one, two in zip(*seconds.values(), strict=True)]
    middle = statistics.median(ratios)
    return {"bags": done, "seconds": seconds, "speedups": ratios, "speedup": middle}


def of_queries(place: Path, tests: int, units: int) -> dict[str, Any]:
    """Return how long the worst twenty take, by the latest rows and by all rows of health."""
    latest = write_drawn_health(place, units, tests // units)
    named = [row | {"model": MODEL, "unit": f"flap+{row['serial_number']}"} for row in latest]
    table = pa.Table.from_pylist(named, WHOLE["units"])
    write_table(place / TABLES / "units.parquet", table)
    questions = {
        "worst_s": "select * from worst_first limit 20",
        "worst_of_all_rows_s": "select * from health qualify row_number() over "
        "(partition by unit order by stamp_ns desc) = 1 order by level desc, rul_50 limit 20",
        "alarms_s": "select count(*) from false_alarms",
    }
    figures: dict[str, Any] = {"rows": tests, "units": units}
    for name, question in questions.items():
        began_s = time.perf_counter()
        answer(place, question)
        figures[name] = time.perf_counter() - began_s
    return figures


def of_kills(place: Path, bags: Path, kills: int) -> dict[str, Any]:
    """Return what is missing or doubled after so many workers were killed at random."""
    archive, tally, rng = place / "archive", RunTally(), random.Random(0)
    killed, over = 0, threading.Event()

    def kill() -> None:
        nonlocal killed
        while killed < kills and not over.wait(rng.uniform(0.05, 0.5)):
            children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
            workers = [
                int(child)
                for child in children
                if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()
            ]
            if workers:
                os.kill(rng.choice(workers), signal.SIGKILL)
                killed += 1

    with Manifest(archive, is_new=True) as manifest:
        scan(manifest, [str(bags)])
        killer = threading.Thread(target=kill)
        killer.start()
        rounds = 0
        # A bag that met three kills is a row with that reason; a bag that is touched is due again.
        while manifest.find_due(manifest.settings) and rounds < 2 * kills:
            with Workers("processes", 2) as pool:
                run_bags(manifest, pool, tally)
            for url, *_ in _lost(archive, manifest):
                os.utime(url)
            scan(manifest, [])
            rounds += 1
        over.set()
        killer.join()
        write_summaries(manifest)
    _, rows = answer(archive, "select bag, number from estimates")
    doubled = sum(count > 1 for count in Counter(rows).values())
    there = {str(path) for path in bags.rglob("*.mcap")}
    missing = len(there - {row[0] for row in rows})
    return {"kills": killed, "bags": len(there), "missing": missing, "doubled": doubled}


def _lost(archive: Path, manifest: Manifest) -> list[tuple[Any, ...]]:
    write_summaries(manifest)
    return answer(archive, "select bag from bags where reason like '%worker processes ended%'")[1]


def lives(place: Path, count: int) -> Path:
    """Simulate lives until there are so many bags; return their folder."""
    bags, seed = place / "real", 0
    bags.mkdir()
    while len(made := sorted(bags.rglob("*.mcap"))) < count:
        words = ["ema", "lives", "-o", str(bags / f"lives_{seed}"), "--seed", str(seed)]
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
        seed += 1
    for extra in made[count:]:
        extra.unlink()
    return bags


PARTS: Final = {
    "size": lambda place, tests, units: of_size(place, int(tests), int(units)),
    "unit": lambda place, tests: of_unit(place, int(tests)),
    "bag": lambda place, bags: of_a_bag(Path(bags)),
    "workers": lambda place, bags: of_workers(place, Path(bags)),
    "queries": lambda place, tests, units: of_queries(place, int(tests), int(units)),
    "kills": lambda place, bags, kills: of_kills(place, Path(bags), int(kills)),
}
"""Each is measured in a process of its own, which has its own peak of memory."""


def in_a_process(part: str, *given: object) -> Any:
    """Return what a part gives."""
    words = [sys.executable, __file__, "--part", part, *map(str, given)]
    environment = os.environ | one_thread()
    done = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True, env=environment)
    return json.loads(done.stdout.splitlines()[-1])


def measure(*, full: bool, only: tuple[str, ...]) -> dict[str, Any]:
    """Return all figures."""
    figures: dict[str, Any] = {}

    def wanted(name: str) -> bool:
        return not only or name in only

    if wanted("size"):
        sizes = [(1_000, 5), (10_000, 50), (100_000, 500)][: 3 if full else 2]
        figures["sizes"] = [in_a_process("size", *size) for size in sizes]
    if wanted("unit"):
        figures["unit"] = in_a_process("unit", 1000 if full else 200)
    if wanted("queries"):
        figures["queries"] = in_a_process("queries", 1_000_000, 500)
    if {"bag", "workers", "kills"} & set(only or PARTS):
        with tempfile.TemporaryDirectory() as folder:
            bags = lives(Path(folder), 1000 if full else 60)
            for name, more in (("bag", ()), ("workers", ()), ("kills", (200 if full else 10,))):
                if wanted(name):
                    figures[name] = in_a_process(name, bags, *more)
    return figures


def rows(figures: dict[str, Any]) -> list[Row]:
    """Return the rows of the table."""
    found: list[Row] = []
    if "sizes" in figures:
        first, *_, last = figures["sizes"]
        memory = last["peak_mb"] / first["peak_mb"]
        each = [1e3 * one["own_cpu_s"] / one["tests"] for one in (first, last)]
        what = f"{last['tests']} tests over {first['tests']}"
        found += [
            Row(f"memory, {what}", "<= 1.5", f"{memory:.2f}", memory <= 1.5),
            Row(
                f"computing a test beside its task, {what}",
                "<= 1.3",
                f"{each[1] / each[0]:.2f} ({each[1]:.2f} ms)",
                each[1] <= 1.3 * each[0],
            ),
        ]
    if "workers" in figures:
        speedup = figures["workers"]["speedup"]
        found.append(Row("two workers over one", ">= 1.8", f"{speedup:.2f}", speedup >= 1.8))
    if "bag" in figures:
        bag = figures["bag"]
        ratio = bag["recorded_s"] / bag["cpu_s"]
        what = f"bag of {bag['recorded_s']:.1f} s, over real time, a core"
        found.append(Row(what, ">= 100", f"{ratio:.0f} ({bag['cpu_s']:.3f} s)", ratio >= 100.0))
    if "queries" in figures:
        one = figures["queries"]
        worst_s, all_s = one["worst_s"], one["worst_of_all_rows_s"]
        found += [
            Row(
                f"worst twenty of {one['rows']} rows [s]", "<= 1", f"{worst_s:.2f}", worst_s <= 1.0
            ),
            Row("  by all rows of health [s]", "<= 1", f"{all_s:.2f}", all_s <= 1.0),
        ]
    if "unit" in figures:
        unit = figures["unit"]
        each_ms = 1e3 * unit["whole_cpu_s"] / unit["whole_followed"]
        found += [
            Row("follow a test of a unit [ms]", "", f"{each_ms:.1f}", None),
            Row(
                f"follow one more after {unit['tests']} [s]",
                "",
                f"{unit['one_more_cpu_s']:.2f}",
                None,
            ),
        ]
    if "kills" in figures:
        one = figures["kills"]
        lost = one["missing"] + one["doubled"]
        what = f"bags missing or doubled after {one['kills']} kills"
        found.append(Row(what, "0", str(lost), lost == 0))
    if {"bag", "unit", "sizes"} <= figures.keys():
        found.append(
            Row("six million bags on two cores [days]", "", f"{fleet_days(figures):.1f}", None)
        )
    return found


def fleet_days(figures: dict[str, Any], cores: int = 2) -> float:
    """Return how long the fleet's archive takes from nothing, by what was measured [d]."""
    unit = figures["unit"]
    each_s = figures["bag"]["cpu_s"] + unit["whole_cpu_s"] / unit["whole_followed"]
    return FLEET_BAGS * each_s / cores / 86_400.0


@click.command()
@click.option("--full", is_flag=True, help="The sizes of the targets; hours.")
@click.option("--only", multiple=True, type=click.Choice(list(PARTS)), help="Parts to measure.")
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--part", type=click.Choice(list(PARTS)), hidden=True)
@click.argument("given", nargs=-1)
def main(
    full: bool, only: tuple[str, ...], output: Path | None, part: str | None, given: tuple[str, ...]
) -> None:
    """Print what an archive takes."""
    if part is not None:
        with tempfile.TemporaryDirectory() as folder:
            print(json.dumps(PARTS[part](Path(folder), *given)))
        return
    figures = measure(full=full, only=only)
    Console(width=140).print(target_table("archive", rows(figures)))
    if output is not None:
        output.write_text(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
