# SPDX-License-Identifier: Apache-2.0
"""Performance of an archive: time and memory by size, speed-up, queries and killed workers.

    python archive.py [--full] [--only PART] [--json FILE]

Where only the number of bags matters, their tests are drawn at random. Real bags are recorded from
simulated lives. Without --full the largest archive has 10,000 tests of 50 units, and there are 60
real bags and 10 kills. With --full there are 100,000 tests of 500 units, 1,000 bags and 200 kills.
"""

import os
import random
import resource
import signal
import statistics
import subprocess
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import click
from archive_drawn import draw, make_stubs, write_drawn_health
from script import Figures, Workers, command, in_a_process
from targets import Row, at_least, at_most, none_of, untargeted

from ema_archive.bag_task import BagTask, diagnose_bag
from ema_archive.manifest import Manifest
from ema_archive.query import answer
from ema_archive.running import RunTally, run_bags, run_units, scan
from ema_archive.store import FILE
from ema_bags.reader import Bag
from ema_core.array_environment import array_environment
from ema_core.tasks import Workers as Tasks

FLEET_BAGS: Final = 6_000_000
"""Bags of 200 aircraft with 8 actuators each, tested daily for ten years."""

SIZES: Final = ((1_000, 5), (10_000, 50), (100_000, 500))
"""Tests and units of each archive compared."""

_ROUNDS: Final = 3
_TIMED_BAGS: Final = 30


def of_size(place: Path, tests: int, units: int) -> Figures:
    """Return time and memory to write the estimates of drawn tests to an archive.

    Also return the times of a query and of a second run without changes, and the size of the file.
    """
    make_stubs(place / "bags", units, tests)
    began_s, used_s = time.perf_counter(), time.process_time()
    with Manifest(place / "archive", is_new=True) as manifest, Tasks("processes", 2) as pool:
        scan(manifest, [str(place / "bags")])
        run_bags(manifest, pool, RunTally(), diagnose=draw)
        taken_s, used_s = time.perf_counter() - began_s, time.process_time() - used_s
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        again_s = time.perf_counter()
        scan(manifest, [])
        run_bags(manifest, pool, RunTally(), diagnose=draw)
        again_s = time.perf_counter() - again_s
    asked_s = time.perf_counter()
    answer(place / "archive", "select count(*), avg(friction) from estimates where valid")
    return {
        "tests": tests,
        "units": units,
        "seconds": taken_s,
        "own_cpu_s": used_s,
        "peak_mb": peak_mb,
        "estimates_query_s": time.perf_counter() - asked_s,
        "nothing_changed_s": again_s,
        "megabytes": (place / "archive" / FILE).stat().st_size / 1e6,
    }


def of_unit(place: Path, tests: int) -> Figures:
    """Return the processor time to follow all tests of a unit, and one test added later [s].

    The numbers of tests followed are returned, too.
    """
    make_stubs(place / "bags", 1, tests + 1)
    last = max((place / "bags").rglob("*.mcap"))
    last.rename(place / last.name)
    figures: Figures = {"tests": tests}
    with Manifest(place / "archive", is_new=True) as manifest, Tasks("threads", 1) as pool:
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


def of_a_bag(place: Path, bags: Path) -> Figures:
    """Return the mean processor time and the mean recorded time of a real bag [s]."""
    with Manifest(place / "archive", is_new=True) as made:
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


def of_workers(place: Path, bags: Path) -> Figures:
    """Return the time to process real bags with one and with two workers, in turns [s]."""
    seconds: dict[int, list[float]] = {1: [], 2: []}
    for number in range(_ROUNDS):
        for workers, taken in seconds.items():
            archive, tally = place / f"archive_{number}_{workers}", RunTally()
            with Manifest(archive, is_new=True) as manifest, Tasks("processes", workers) as pool:
                scan(manifest, [str(bags)])
                settings = manifest.settings
                manifest.find_due(settings)
                warm = BagTask(*next(iter(manifest.due(settings))), settings)
                # Each process loads its kernels first, which is not timed.
                list(pool.run(diagnose_bag, [warm] * 3 * workers))
                began_s = time.perf_counter()
                run_bags(manifest, pool, tally)
                taken.append(time.perf_counter() - began_s)
    ratios = [first / second for first, second in zip(*seconds.values(), strict=True)]
    middle = statistics.median(ratios)
    done = len(list(bags.rglob("*.mcap")))
    return {"bags": done, "seconds": seconds, "speedups": ratios, "speedup": middle}


def of_queries(place: Path, tests: int, units: int) -> Figures:
    """Return the time of queries [s]: the worst twenty units by the latest rows and by all rows."""
    write_drawn_health(place / "archive", units, tests // units)
    questions = {
        "worst_s": "select * from worst_first limit 20",
        "worst_of_all_rows_s": "select * from health qualify row_number() over "
        "(partition by unit order by tested_ns desc) = 1 order by level desc, "
        "rul.hours_50 limit 20",
        "alarms_s": "select count(*) from false_alarms",
    }
    figures: Figures = {"rows": tests, "units": units}
    for name, question in questions.items():
        began_s = time.perf_counter()
        answer(place / "archive", question)
        figures[name] = time.perf_counter() - began_s
    return figures


def of_kills(place: Path, bags: Path, kills: int) -> Figures:
    """Return the number of bags missing or doubled after ``kills`` random kills of workers."""
    archive, tally, rng = place / "archive", RunTally(), random.Random(0)
    killed, over = 0, threading.Event()

    def kill() -> None:
        nonlocal killed
        while killed < kills and not over.wait(rng.uniform(0.05, 0.5)):
            children = (
                Path(f"/proc/self/task/{os.getpid()}/children").read_text(encoding="utf-8").split()
            )
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
        # A bag hit by three kills is stored with that reason. Touching its file makes it due again.
        while manifest.find_due(manifest.settings) and rounds < 2 * kills:
            with Tasks("processes", 2) as pool:
                run_bags(manifest, pool, tally)
            for url, *_ in _lost(archive):
                os.utime(url)
            scan(manifest, [])
            rounds += 1
        over.set()
        killer.join()
    _, rows = answer(archive, "select bag, number from estimates")
    doubled = sum(count > 1 for count in Counter(rows).values())
    there = {str(path) for path in bags.rglob("*.mcap")}
    missing = len(there - {row[0] for row in rows})
    return {"kills": killed, "bags": len(there), "missing": missing, "doubled": doubled}


def _lost(archive: Path) -> list[tuple[Any, ...]]:
    return answer(archive, "select bag from bags where reason like '%worker processes ended%'")[1]


def lives(place: Path, count: int) -> Path:
    """Simulate lives until there are ``count`` bags. Return their folder."""
    bags, seed = place / "real", 0
    bags.mkdir()
    while len(made := sorted(bags.rglob("*.mcap"))) < count:
        words = ["ema", "lives", "-o", str(bags / f"lives_{seed}"), "--seed", str(seed)]
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
        seed += 1
    for extra in made[count:]:
        extra.unlink()
    return bags


PARTS: Final = ("size", "unit", "queries", "bag", "workers", "kills")


def apart(work: Callable[..., Figures], *options: Any) -> Figures:
    """Run a part in a new temporary folder and a new process. Return its figures."""
    with tempfile.TemporaryDirectory() as folder:
        return in_a_process(work, Path(folder), *options)


def measure(
    _: Workers, only: Sequence[str], tests: int, unit: int, bags: int, kills: int
) -> Figures:
    """Measure time and memory of an archive, its queries, and the effect of killed workers."""
    os.environ.update(array_environment())
    figures: Figures = {}
    wanted = only or PARTS
    if "size" in wanted:
        sizes = [(size, units) for size, units in SIZES if size <= tests]
        figures["sizes"] = [apart(of_size, *size) for size in sizes]
    if "unit" in wanted:
        figures["unit"] = apart(of_unit, unit)
    if "queries" in wanted:
        figures["queries"] = apart(of_queries, 1_000_000, 500)
    if {"bag", "workers", "kills"} & set(wanted):
        with tempfile.TemporaryDirectory() as folder:
            real = lives(Path(folder), bags)
            for name, work in (
                ("bag", partial(of_a_bag, bags=real)),
                ("workers", partial(of_workers, bags=real)),
                ("kills", partial(of_kills, bags=real, kills=kills)),
            ):
                if name in wanted:
                    figures[name] = apart(work)
    return figures


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    if "sizes" in figures:
        first, last = figures["sizes"][0], figures["sizes"][-1]
        each_ms = [1e3 * entry["own_cpu_s"] / entry["tests"] for entry in (first, last)]
        ratio = each_ms[1] / each_ms[0]
        what = f"{last['tests']} tests over {first['tests']}"
        yield at_most(f"memory, {what}", last["peak_mb"] / first["peak_mb"], 1.5)
        measured = f"{ratio:.2f} ({each_ms[1]:.2f} ms)"
        yield at_most(f"computing a test beside its task, {what}", ratio, 1.3, measured)
    if "workers" in figures:
        yield at_least("two workers over one", figures["workers"]["speedup"], 1.8)
    if "bag" in figures:
        bag = figures["bag"]
        ratio = bag["recorded_s"] / bag["cpu_s"]
        what = f"bag of {bag['recorded_s']:.1f} s, over real time, a core"
        yield at_least(what, ratio, 100.0, f"{ratio:.0f} ({bag['cpu_s']:.3f} s)")
    if "queries" in figures:
        queries = figures["queries"]
        yield at_most(f"worst twenty of {queries['rows']} rows [s]", queries["worst_s"], 1.0)
        yield at_most("  by all rows of health [s]", queries["worst_of_all_rows_s"], 1.0)
    if "unit" in figures:
        unit = figures["unit"]
        yield untargeted("follow a test of a unit [ms]", f"{1e3 * _followed_s(unit):.1f}")
        what = f"follow one more after {unit['tests']} [s]"
        yield untargeted(what, f"{unit['one_more_cpu_s']:.2f}")
    if "kills" in figures:
        kills = figures["kills"]
        lost = kills["missing"] + kills["doubled"]
        yield none_of(f"bags missing or doubled after {kills['kills']} kills", lost)
    if {"bag", "unit"} <= figures.keys():
        each_s = figures["bag"]["cpu_s"] + _followed_s(figures["unit"])
        days = FLEET_BAGS * each_s / 2.0 / 86_400.0
        yield untargeted("six million bags on two cores [days]", f"{days:.1f}")


def _followed_s(unit: Figures) -> float:
    """Return the processor time per followed test [s]."""
    return unit["whole_cpu_s"] / unit["whole_followed"]


main = command(
    measure,
    "archive",
    rows,
    full={"tests": 100_000, "unit": 1000, "bags": 1000, "kills": 200},
    only=click.Option(["--only"], multiple=True, type=click.Choice(PARTS), help="Parts."),
    tests=10_000,
    unit=200,
    bags=60,
    kills=10,
)

if __name__ == "__main__":
    main()
