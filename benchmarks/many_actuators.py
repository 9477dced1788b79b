# SPDX-License-Identifier: Apache-2.0
"""Number of actuators that 1, 2 and 4 monitor processes can follow, and behaviour on overload.

    python benchmarks/many_actuators.py [--monitors 1,2,4] [--actuators 8,16,...] [--bursts N]
        [--beyond N] [--json FILE]

One process publishes the telemetry of all actuators in real time. Each actuator streams a test of
0.7 s every 5 s, in blocks of 10 ms at 10,000 samples per second. The tests of the actuators start
at different times. They are simulated beforehand, with different faults in each actuator and noise
of 0.02 A on the current. A test consists of a rest 1.5 mrad below the start, 0.15 s of approach,
0.05 s of rest and the thesis's chirp of 0.5 s. The approach defines the position of the motor in
its play. The monitors share the actuators by the parameter `shard` and write their histories to
one folder.

For each number of monitors, the benchmark searches --actuators for the largest number that they can
follow. They follow the actuators if no window is dropped or missing, no block is lost, and each
estimate arrives before the next test of its actuator. This must hold in --bursts bursts, after
kernels are compiled and every actuator has had three windows. Then the first number of monitors
receives twice as many actuators as it can follow, in --beyond bursts. The benchmark reports the
number of dropped windows and the growth of memory.

All processes run on the same machine. The processor time of the publisher and of the benchmark
itself is reported in addition to the processor time of the monitors.
"""

import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from multiprocessing.queues import SimpleQueue
from pathlib import Path
from typing import Final

import numpy as np
import rclpy
from graph import Graph
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message, serialize_message
from rich.table import Table
from script import Figures, Workers, command, cpu_s
from targets import Row, at_least, grid, untargeted

from ema_cli.processes.node_commands import NodeOptions, monitor_commands
from ema_core.commands import THESIS_CHIRP
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_interfaces.msg import FaultEstimate, TelemetryBlock
from ema_ros.messages import description_to_message, telemetry_to_message
from ema_ros.stamps import stamp_from_message, stamp_to_message
from ema_ros.topics import ACTUATOR_TOPICS, DESCRIPTION, FAULT_ESTIMATE, NAMESPACE, TELEMETRY
from ema_sim.actuator import SimulatedActuator

LEAST_ACTUATORS: Final = 100
"""Number of actuators that a monitor should be able to follow."""

PERIOD_S: Final = 5.0
TEST_S: Final = 0.7
BLOCK_S: Final = 0.01

_DEPTH: Final = 1.5e-3
_APPROACH_S: Final = 0.15
_REST_S: Final = 0.047
_CURRENT_NOISE: Final = 0.02
_VARIANTS: Final = 8
_CYCLES: Final = 3
_DISCOVERY_S: Final = 2.0
_SETTLING: Final = 3
_LAST_S: Final = 10.0
_QUEUE_S: Final = 30.0


class Course:
    """Recorder of the memory of monitor processes, and of their waiting windows."""

    def __init__(self, graph: Graph, processes: Sequence[int]) -> None:
        self._graph = graph
        self._processes = processes
        self._next_s = 0.0
        self._times_min: list[float] = []
        self._memory_mb: list[list[float]] = []
        self.waiting_most = 0

    def note(self) -> None:
        """Record memory and waiting windows, at most once per second."""
        if time.time() < self._next_s:
            return
        self._next_s = time.time() + 1.0
        self._times_min.append(time.time() / 60.0)
        self._memory_mb.append([resident_mb(process) for process in self._processes])
        waiting = [
            int(status.get("windows waiting", 0)) for status in self._graph.statuses.values()
        ]
        self.waiting_most = max([self.waiting_most, *waiting])

    def memory_at_end(self) -> tuple[float, float]:
        """Return the memory [MB] of the largest monitor, and its growth over the second half.

        The growth is in MB/min; NaN with fewer than three samples in that half.
        """
        half = len(self._memory_mb) // 2
        courses = np.array(self._memory_mb[half:]).T
        course = courses[np.argmax(courses[:, -1])]
        times = np.array(self._times_min[half:])
        slope = np.polyfit(times - times[0], course, 1)[0] if course.size > 2 else np.nan
        return float(course[-1]), float(slope)


def try_out(
    tests: Sequence[Sequence[bytes]], monitors: int, actuators: int, bursts: int
) -> Figures:
    """Run monitors with a number of actuators. Return latency, losses and load after settling."""
    names = [f"flap_{number}" for number in range(actuators)]
    total = _SETTLING + bursts
    context = multiprocessing.get_context("spawn")
    times: SimpleQueue[float] = context.SimpleQueue()
    latencies_s: dict[tuple[str, int], float] = {}
    invalid: dict[tuple[str, int], int] = {}

    def note(message: FaultEstimate) -> None:
        window = (message.actuator_id, message.window)
        latencies_s[window] = time.time() - 1e-9 * stamp_from_message(message.window_end)
        if not message.valid:
            invalid[window] = message.verdict

    def until(end_s: float) -> Callable[[], bool]:
        return lambda: time.time() > end_s

    expected = {(name, number) for name in names for number in range(_SETTLING, total)}
    with tempfile.TemporaryDirectory(prefix="ema_many_") as place, Graph() as graph:
        graph.listen(FaultEstimate, f"{NAMESPACE}/{FAULT_ESTIMATE}", note, 1000)
        parameters = [f'history_folder:="{place}/history"', f"most_actuators:={actuators}"]
        commands = monitor_commands(
            monitors, NodeOptions(assignments=parameters), Path(place), names
        )
        processes = [graph.run(command).pid for command in commands.values()]
        arguments = (actuators, total, times, monitors, tests)
        publisher = context.Process(target=publish, args=arguments)
        publisher.start()
        try:
            graph.wait(lambda: not times.empty())
            began_s = times.get()
            course = Course(graph, processes)
            graph.wait(until(began_s + _SETTLING * PERIOD_S))
            harness = [publisher.pid or 0, os.getpid()]
            at_s, before_s = time.time(), [sum(map(cpu_s, group)) for group in (processes, harness)]

            def is_over() -> bool:
                course.note()
                return time.time() > began_s + total * PERIOD_S

            graph.wait(is_over)
            used_s = np.subtract(
                [sum(map(cpu_s, group)) for group in (processes, harness)], before_s
            )
            cores, other_cores = (used_s / (time.time() - at_s)).tolist()
            graph.wait(lambda: not times.empty())
            late_s = times.get()
            is_late = until(time.time() + _QUEUE_S)
            graph.wait(lambda: expected <= latencies_s.keys() or is_late())
            # Wait for one more status of each monitor.
            graph.wait(until(time.time() + 1.5))
        finally:
            publisher.join(_LAST_S)
            publisher.kill()
        blocks = sum(int(status.get("blocks", 0)) for status in graph.statuses.values())
    estimated = expected & latencies_s.keys()
    valid = estimated - invalid.keys()
    dropped = {window for window, verdict in invalid.items() if verdict == FaultEstimate.SKIPPED}
    served = [sum(window[0] == name for window in valid) for name in names]
    of_valid_s = [latencies_s[window] for window in valid] or [float("nan")]
    memory_mb, slope = course.memory_at_end()
    return {
        "monitors": monitors,
        "actuators": actuators,
        "windows": len(expected),
        "missing": len(expected - estimated),  # without an estimate
        "dropped": len(expected & dropped),  # dropped for later windows
        "refused": len(estimated - valid - dropped),  # not valid for another reason
        "dropped_before": len(dropped - expected),  # while the monitors settled
        "blocks_lost": actuators * total * round(TEST_S / BLOCK_S) - blocks,
        # From a window's last sample to the reception of its estimate, if valid.
        "latency_median_s": float(np.median(of_valid_s)),
        "latency_longest_s": float(np.max(of_valid_s)),
        # Fewest valid estimates of an actuator over the most valid estimates of an actuator.
        "least_served": min(served) / max(1, *served),
        "waiting_most": course.waiting_most,
        "cores": cores,
        "other_cores": other_cores,  # of publisher and subscriber
        "memory_mb": memory_mb,  # of the largest monitor
        "memory_slope_mb_per_min": slope,
        "publisher_late_s": late_s,
    }


def commands_of_test(h: float) -> tuple[NDArray[np.float64], ...]:
    """Return the command [rad] before, during and after the published test.

    ``h`` is the sample period [s].
    """

    def glide(start: float, stop: float, duration_s: float) -> NDArray[np.float64]:
        u = np.arange(1, round(duration_s / h) + 1) / round(duration_s / h)
        return start + (stop - start) * (1.0 - np.cos(np.pi * u)) / 2.0

    chirp = THESIS_CHIRP.sample(h)
    approach = [glide(-_DEPTH, 0.0, _APPROACH_S), np.zeros(round(_REST_S / h))]
    sent = np.concatenate([*approach, chirp])
    sent = np.append(sent, np.full(round(TEST_S / h) - len(sent), chirp[-1]))
    return (
        np.concatenate([glide(0.0, -_DEPTH, 0.1), np.full(round(0.2 / h), -_DEPTH)]),
        sent,
        np.concatenate([glide(chirp[-1], 0.0, 0.3), np.zeros(round(0.1 / h))]),
    )


def simulated_tests() -> list[list[bytes]]:
    """Return the serialised blocks of each test: several tests per actuator, in order."""
    h, rng = ActuatorDescription().sample_period, np.random.default_rng(20)
    before, sent, after = commands_of_test(h)
    size = round(BLOCK_S / h)
    tests = []
    for _ in range(_VARIANTS):
        actuator = SimulatedActuator()
        names = ("friction", "backlash", "short_circuit_b", "eccentricity", "eccentricity_phase")
        sizes = rng.uniform(0.0, (0.3, 0.3, 0.3, 0.3, 0.9))
        actuator.faults = fault_vector(dict(zip(names, sizes.tolist(), strict=True)))
        for _ in range(_CYCLES):
            actuator.advance(before)
            blocks = [actuator.advance(part) for part in np.split(sent, len(sent) // size)]
            actuator.advance(after)
            noisy = [
                replace(b, current=b.current + rng.normal(0.0, _CURRENT_NOISE, len(b)))
                for b in blocks
            ]
            tests.append([serialize_message(telemetry_to_message(case, "")) for case in noisy])
    return tests


def publish(
    actuators: int,
    bursts: int,
    times: "SimpleQueue[float]",
    monitors: int,
    simulated: Sequence[Sequence[bytes]],
) -> None:
    """Publish the tests of all actuators in real time, as soon as all monitors have subscribed.

    Puts two values into ``times``: the start of the first period [s since the epoch] and, at the
    end, the largest delay of a block [s]. ``simulated`` has the tests as serialised messages.
    """
    tests = [[deserialize_message(item, TelemetryBlock) for item in test] for test in simulated]
    rclpy.init()
    node = rclpy.create_node("actuators", namespace=NAMESPACE)
    message_class, qos = ACTUATOR_TOPICS[DESCRIPTION]
    units = [replace(ActuatorDescription(), actuator_id=f"flap_{i}") for i in range(actuators)]
    latched = [node.create_publisher(message_class, DESCRIPTION, qos) for _ in units]
    for publisher, unit in zip(latched, units, strict=True):
        publisher.publish(description_to_message(unit))
    message_class, qos = ACTUATOR_TOPICS[TELEMETRY]
    telemetry = node.create_publisher(message_class, TELEMETRY, qos)
    while telemetry.get_subscription_count() < monitors:
        time.sleep(0.05)
    time.sleep(_DISCOVERY_S)
    began_ns, latest_ns = time.time_ns(), 0
    times.put(began_ns * 1e-9)
    size, h_ns = round(BLOCK_S / units[0].sample_period), round(units[0].sample_period * 1e9)
    for due_ns, number, burst, block in schedule(actuators, bursts):
        time.sleep(max(0, began_ns + due_ns - time.time_ns()) * 1e-9)
        latest_ns = max(latest_ns, time.time_ns() - began_ns - due_ns)
        message = tests[number % _VARIANTS * _CYCLES + burst % _CYCLES][block]
        message.actuator_id = units[number].actuator_id
        message.header.stamp = stamp_to_message(began_ns + due_ns - (size - 1) * h_ns)
        message.first_index = due_ns // h_ns - size + 1
        telemetry.publish(message)
    time.sleep(_DISCOVERY_S)  # a reader may still request missed blocks
    times.put(latest_ns * 1e-9)
    rclpy.shutdown()


def schedule(actuators: int, bursts: int) -> Iterator[tuple[int, int, int, int]]:
    """Yield the due time of each block [ns], and its numbers of actuator, burst and block."""
    a_period, a_test = round(PERIOD_S / BLOCK_S), round(TEST_S / BLOCK_S)
    starts = [a_period * number // actuators for number in range(actuators)]
    for tick in range(bursts * a_period + max(starts)):
        for number, start in enumerate(starts):
            burst, block = divmod(tick - start, a_period)
            if 0 <= burst < bursts and block < a_test:
                yield round((tick + 1) * BLOCK_S * 1e9), number, burst, block


def is_followed(entry: Figures) -> bool:
    """Return whether no data was lost and each estimate came before its actuator's next test."""
    lost = entry["missing"] or entry["dropped"] or entry["blocks_lost"]
    return not lost and entry["latency_longest_s"] < PERIOD_S


def resident_mb(process: int) -> float:
    """Return the resident memory of a process [MB]."""
    pages = int(Path(f"/proc/{process}/statm").read_text(encoding="utf-8").split()[1])
    return 1e-6 * pages * os.sysconf("SC_PAGE_SIZE")


def search(numbers: Sequence[int], start: int, run: Callable[[int], Figures]) -> list[Figures]:
    """Return the runs of a search, from ``start``, for the largest number that is followed.

    The runs are in ascending order of actuators. They include the smallest number that is not
    followed, if there is one.
    """
    place = min(range(len(numbers)), key=lambda i: abs(numbers[i] - start))
    results = [run(numbers[place])]
    step = 1 if is_followed(results[0]) else -1
    while 0 <= place + step < len(numbers):
        place += step
        results.append(run(numbers[place]))
        if is_followed(results[-1]) != (step > 0):
            break
    return sorted(results, key=lambda entry: entry["actuators"])


def followed(runs: Sequence[Figures], monitors: int) -> int:
    """Return the largest number of actuators that was followed; 0 if no run succeeded."""
    mine = (run for run in runs if run["monitors"] == monitors and is_followed(run))
    return max((run["actuators"] for run in mine), default=0)


def measure(pool: Workers, monitors: str, actuators: str, bursts: int, beyond: int) -> Figures:
    """Measure how many actuators each number of monitors can follow."""
    tests = simulated_tests()
    numbers = sorted(map(int, actuators.split(",")))
    counts = list(map(int, monitors.split(",")))
    runs: list[Figures] = []
    start = numbers[len(numbers) // 2]
    for count in pool.track("monitors", counts):
        runs += search(numbers, start, partial(try_out, tests, count, bursts=bursts))
        start = followed(runs, count) or numbers[0]
    most = followed(runs, counts[0]) or numbers[0]
    overload = [try_out(tests, counts[0], 2 * most, beyond)] if beyond else []
    return {"rows": runs, "beyond": overload}


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    runs = figures["rows"]
    for monitors in sorted({run["monitors"] for run in runs}):
        most = followed(runs, monitors)
        tried = max(run["actuators"] for run in runs if run["monitors"] == monitors)
        what, measured = f"actuators that {monitors} monitors follow", f"{most} of {tried} tried"
        if monitors == 1:
            yield at_least(what, most, LEAST_ACTUATORS, measured)
        else:
            yield untargeted(what, measured)


def tables(figures: Figures) -> Iterator[Table]:
    """Yield the tables to print below the targets."""
    runs = [*figures["rows"], *figures["beyond"]]
    yield grid(
        f"{TEST_S:g} s of test in every {PERIOD_S:g} s of each actuator, in turn",
        (*(name.replace("_", " ") for name in runs[0]), "followed"),
        ((*run.values(), "yes" if is_followed(run) else "no") for run in runs),
    )


main = command(
    measure,
    "many actuators",
    rows,
    tables,
    width=200,
    monitors="1,2,4",
    actuators="8,16,32,48,64,96,128",
    bursts=3,
    beyond=9,
)

if __name__ == "__main__":
    main()
