"""How many actuators 1, 2 and 4 monitor processes follow, and what happens beyond.

    python benchmarks/many_actuators.py [--monitors 1,2,4] [--actuators 4,8,...] [--json FILE]

One process publishes the telemetry of all actuators in real time, as `fleet.py` says: each streams
0.7 s of test in every 5 s, in blocks of 10 ms at 10,000 samples a second, in turn. The monitors
share the actuators by the parameter `shard` and write their histories in one folder.

For each number of monitors the largest number of actuators is searched, of those given, that is
followed: no window is dropped or missing, no block lost, and each estimate comes before the next
test of its actuator, once kernels are compiled and every actuator has had three windows. Then twice
as many as the first one follows are sent to it: what is dropped, and whether its memory grows.

Prints a table; writes JSON. All run on the same machine: the processor time of what publishes and
listens is beside that of the monitors.
"""

import json
import multiprocessing
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from multiprocessing.queues import SimpleQueue
from pathlib import Path
from typing import Final

import click
import fleet
import numpy as np
import rclpy
from rclpy.serialization import serialize_message
from rich.console import Console
from rich.table import Table

from ema_cli.processes.fleet_commands import Common, monitor_commands

_SETTLING: Final = 3
_LAST_S: Final = 10.0
_QUEUE_S: Final = 30.0
_MB: Final = 1e-6


@dataclass(frozen=True)
class Row:
    """How a number of monitors fares with a number of actuators, once it has settled.

    Attributes
    ----------
    monitors, actuators
        How many there were.
    windows, missing, dropped, refused
        How many windows there were, and how many of them without estimate, given up for later
        ones, and with an estimate that is not valid for another reason.
    dropped_before
        How many windows were given up while it settled.
    blocks_lost
        Blocks of telemetry that did not reach their monitor.
    latency_median_s, latency_longest_s
        From a window's last sample to the reception of its estimate, of the valid ones [s].
    least_served
        Valid estimates of the actuator that had fewest, over those of the one that had most [-].
    waiting_most
        Windows of a monitor that waited at the same time, at most.
    cores
        Processor time of the monitors over time [-].
    other_cores
        Processor time of what publishes and listens over time [-].
    memory_mb
        Resident memory of the largest monitor at the end [MB].
    memory_slope_mb_per_min
        Its growth over the second half of the time that is measured [MB/min].
    publisher_late_s
        How much too late a block was sent at most [s].
    """

    monitors: int
    actuators: int
    windows: int
    missing: int
    dropped: int
    refused: int
    dropped_before: int
    blocks_lost: int
    latency_median_s: float
    latency_longest_s: float
    least_served: float
    waiting_most: int
    cores: float
    other_cores: float
    memory_mb: float
    memory_slope_mb_per_min: float
    publisher_late_s: float

    @property
    def is_followed(self) -> bool:
        """Whether nothing was lost, and each estimate came before the next test of its actuator."""
        is_complete = not (self.missing or self.dropped or self.blocks_lost)
        return is_complete and self.latency_longest_s < fleet.PERIOD_S


@contextmanager
def running(monitors: int, actuators: list[str]) -> Iterator[list["subprocess.Popen[bytes]"]]:
    """Run monitors that share actuators, with histories in a folder of their own."""
    with tempfile.TemporaryDirectory(prefix="ema_many_") as place:
        folder = Path(place, "history")
        given = [f'history_folder:="{folder}"', f"most_actuators:={len(actuators)}"]
        files = Path(place, "parameters")
        files.mkdir()
        commands = monitor_commands(monitors, Common(assignments=given), files, actuators)
        started = [
            subprocess.Popen(command, stderr=subprocess.DEVNULL) for command in commands.values()
        ]
        try:
            yield started
        finally:
            for process in started:
                process.send_signal(signal.SIGINT)
            for process in started:
                try:
                    process.wait(_LAST_S)
                except subprocess.TimeoutExpired:
                    process.kill()


class Course:
    """Memory of monitors over time, and the windows that wait, noted while one listens."""

    def __init__(self, observer: fleet.Observer, processes: list["subprocess.Popen[bytes]"]):
        self._observer = observer
        self._processes = processes
        self._next_s = 0.0
        self.memory: list[tuple[float, list[float]]] = []
        self.waiting_most = 0

    def note(self) -> None:
        """Note both, once a second."""
        now_s = time.time()
        if now_s < self._next_s:
            return
        self._next_s = now_s + 1.0
        self.memory.append((now_s, [resident_mb(one.pid) for one in self._processes]))
        waiting = [
            int(values["windows waiting"])
            for values in self._observer.statuses.values()
            if "windows waiting" in values
        ]
        self.waiting_most = max([self.waiting_most, *waiting])

    def memory_at_end(self) -> tuple[float, float]:
        """Return memory [MB] and its growth over the second half [MB/min] of the largest."""
        half = self.memory[len(self.memory) // 2 :]
        largest = int(np.argmax(half[-1][1]))
        times = np.array([at_s for at_s, _ in half]) / 60.0
        course = np.array([values[largest] for _, values in half])
        slope = float(np.polyfit(times - times[0], course, 1)[0]) if len(half) > 2 else float("nan")
        return float(course[-1]), slope


def measure(monitors: int, actuators: int, bursts: int, tests: list[list[bytes]]) -> Row:
    """Let monitors follow a number of actuators, and return how they fare."""
    names = [f"flap_{number}" for number in range(actuators)]
    total = _SETTLING + bursts
    context = multiprocessing.get_context("spawn")
    times: SimpleQueue[float] = context.SimpleQueue()
    observer = fleet.Observer()
    publisher = context.Process(
        target=fleet.publish, args=(actuators, total, times, monitors, tests)
    )
    with running(monitors, names) as processes:
        publisher.start()
        try:
            observer.listen_until(lambda: not times.empty())
            began_s = times.get()
            course = Course(observer, processes)
            observer.listen_until(lambda: time.time() > began_s + _SETTLING * fleet.PERIOD_S)
            others = [publisher.pid or 0, os.getpid()]
            before_s, at_s = cpu_s(processes, others), time.time()

            def is_over() -> bool:
                course.note()
                return time.time() > began_s + total * fleet.PERIOD_S

            observer.listen_until(is_over)
            used_s = np.subtract(cpu_s(processes, others), before_s) / (time.time() - at_s)
            memory_mb, slope = course.memory_at_end()
            observer.listen_until(lambda: not times.empty())
            late_s = times.get()
            expected = {(name, number) for name in names for number in range(_SETTLING, total)}
            deadline_s = time.time() + _QUEUE_S
            observer.listen_until(
                lambda: expected <= observer.latencies_s.keys() or time.time() > deadline_s
            )
            said_s = time.time() + 1.5
            # The status of all, once more.
            observer.listen_until(lambda: time.time() > said_s)
        finally:
            publisher.join(_LAST_S)
            publisher.kill()
            observer.close()
    heard = expected & observer.latencies_s.keys()
    valid = heard - observer.invalid.keys()
    dropped = [key for key, why in observer.invalid.items() if why.startswith("dropped: ")]
    given_up = len(expected & set(dropped))
    served = [sum((name, number) in valid for number in range(_SETTLING, total)) for name in names]
    blocks = [int(values["blocks"]) for values in observer.statuses.values() if "blocks" in values]
    latencies_s = [observer.latencies_s[key] for key in valid] or [float("nan")]
    sent = actuators * total * round(fleet.TEST_S / fleet.BLOCK_S)
    return Row(
        monitors=monitors,
        actuators=actuators,
        windows=len(expected),
        missing=len(expected - heard),
        dropped=given_up,
        refused=len(heard) - len(valid) - given_up,
        dropped_before=len(dropped) - given_up,
        blocks_lost=sent - sum(blocks),
        latency_median_s=float(np.median(latencies_s)),
        latency_longest_s=float(np.max(latencies_s)),
        least_served=min(served) / max(1, *served),
        waiting_most=course.waiting_most,
        cores=float(used_s[0]),
        other_cores=float(used_s[1]),
        memory_mb=memory_mb,
        memory_slope_mb_per_min=slope,
        publisher_late_s=late_s,
    )


def cpu_s(processes: list["subprocess.Popen[bytes]"], others: list[int]) -> tuple[float, float]:
    """Return the processor time of the monitors, and of others, so far [s]."""
    own = sum(fleet.cpu_time_s(process.pid) for process in processes)
    return own, sum(fleet.cpu_time_s(number) for number in others)


def resident_mb(process: int) -> float:
    """Return the resident memory of a process [MB]."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") * _MB


def search(
    monitors: int, numbers: list[int], start: int, bursts: int, tests: list[list[bytes]]
) -> list[Row]:
    """Return rows up to and beyond the largest number that is followed, sought from a start on."""
    place = min(range(len(numbers)), key=lambda i: abs(numbers[i] - start))
    rows = [measure(monitors, numbers[place], bursts, tests)]
    step = 1 if rows[0].is_followed else -1
    while 0 <= place + step < len(numbers):
        place += step
        rows.append(measure(monitors, numbers[place], bursts, tests))
        if rows[-1].is_followed != (step > 0):
            break
    return sorted(rows, key=lambda row: row.actuators)


def followed(rows: list[Row]) -> int:
    """Return the largest number of actuators that was followed; 0 when none was."""
    return max((row.actuators for row in rows if row.is_followed), default=0)


@click.command()
@click.option("--monitors", default="1,2,4", show_default=True, help="Numbers of processes.")
@click.option(
    "--actuators",
    default="8,16,32,48,64,96,128",
    show_default=True,
    help="Numbers of them, from the least on.",
)
@click.option("--bursts", default=3, show_default=True, help="Tests of each that are measured.")
@click.option(
    "--beyond",
    default=9,
    show_default=True,
    help="Tests of each of twice as many actuators that are sent to the first one; 0: none.",
)
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
def main(monitors: str, actuators: str, bursts: int, beyond: int, output: Path | None) -> None:
    """Print the table and write the JSON file."""
    rclpy.init()
    tests = [[serialize_message(item) for item in test] for test in fleet.simulated_tests()]
    numbers = sorted(int(number) for number in actuators.split(","))
    counts = [int(number) for number in monitors.split(",")]
    rows: list[Row] = []
    start = numbers[len(numbers) // 2]
    for count in counts:
        found = search(count, numbers, start, bursts, tests)
        start = followed(found) or numbers[0]
        rows += found
    most = followed([row for row in rows if row.monitors == counts[0]]) or numbers[0]
    overload = []
    if beyond:
        overload.append(measure(counts[0], 2 * most, beyond, tests))
    rclpy.shutdown()
    columns = [item.name for item in fields(Row)]
    title = f"{fleet.TEST_S:g} s of test in every {fleet.PERIOD_S:g} s of each actuator, in turn"
    table = Table(*(name.replace("_", " ") for name in columns), "followed", title=title)
    for row in (*rows, *overload):
        values = [getattr(row, name) for name in columns]
        texts = [f"{value:.3g}" if isinstance(value, float) else str(value) for value in values]
        table.add_row(*texts, "yes" if row.is_followed else "no", end_section=row is rows[-1])
    Console(width=200).print(table)
    for count in counts:
        most = followed([row for row in rows if row.monitors == count])
        print(f"{count} monitors: {most} actuators followed")
    if output:
        kept = {"rows": rows, "beyond": overload}
        content = {
            name: [asdict(row) | {"is_followed": row.is_followed} for row in those]
            for name, those in kept.items()
        }
        output.write_text(json.dumps(content, indent=2))


if __name__ == "__main__":
    main()
