"""How many actuators one monitor process follows, each streaming 0.7 s of test in every 5 s.

    python benchmarks/fleet.py [--actuators 1,4,16,32,64] [--duration S] [--json FILE]

One process publishes the telemetry of all actuators in real time, in blocks of 10 ms at 10,000
samples a second; they take turns, or with `--together` they all test at once. The telemetry was
simulated beforehand, with other faults in each actuator and noise of 0.02 A on the current. A
test is a rest 1.5 mrad below, 0.15 s of approach, 0.05 s of rest and the thesis's chirp of 0.5 s,
so that the monitor knows where in its play the motor stands. Between the tests nothing is sent.

Prints windows, those missing, dropped or without valid estimate, the time from a window's last
sample to the reception of its estimate, and the share of a core that the monitor takes; writes
JSON. A row begins when the monitor has settled: every actuator has had two windows.
"""

import json
import multiprocessing
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from multiprocessing.queues import SimpleQueue
from pathlib import Path
from typing import Final

import click
import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import deserialize_message
from rich.console import Console
from rich.table import Table

from ema_cli.processes.bringup import program
from ema_core.commands import THESIS_CHIRP
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_interfaces.msg import FaultEstimate, TelemetryBlock
from ema_ros.messages import description_to_message, telemetry_to_message
from ema_ros.stamps import stamp_from_message, stamp_to_message
from ema_ros.topics import ACTUATOR_TOPICS, DESCRIPTION, FAULT_ESTIMATE, NAMESPACE, TELEMETRY
from ema_sim.actuator import SimulatedActuator

PERIOD_S: Final = 5.0
TEST_S: Final = 0.7
BLOCK_S: Final = 0.01

_DEPTH: Final = 1.5e-3
_APPROACH_S: Final = 0.15
_REST_S: Final = 0.047
_CURRENT_NOISE: Final = 0.02
_VARIANTS: Final = 8
_CYCLES: Final = 3
_SETTLING: Final = 2
_DISCOVERY_S: Final = 2.0
_LAST_S: Final = 10.0


@dataclass(frozen=True)
class Row:
    """How the monitor of a number of actuators fares, once it has settled.

    Attributes
    ----------
    actuators, together
        How many there were, and whether they tested at once.
    windows, missing, dropped, invalid
        How many windows there were, and how many of them without estimate, given up for later
        ones, and with an estimate that is not valid.
    blocks_lost
        Blocks of telemetry that did not reach the monitor.
    latency_median_s, latency_95_percent_s, latency_longest_s
        From a window's last sample to the reception of its estimate [s].
    monitor_cores
        Processor time of the monitor over time [-].
    publisher_late_s
        How much too late a block was sent at most [s].
    reasons
        Why estimates were not valid.
    """

    actuators: int
    together: bool
    windows: int
    missing: int
    dropped: int
    invalid: int
    blocks_lost: int
    latency_median_s: float
    latency_95_percent_s: float
    latency_longest_s: float
    monitor_cores: float
    publisher_late_s: float
    reasons: list[str]

    @property
    def is_followed(self) -> bool:
        """Whether nothing was lost, and each estimate came before the next test of its actuator."""
        is_complete = not (self.missing or self.dropped or self.blocks_lost)
        return is_complete and self.latency_longest_s < PERIOD_S


def commands(h: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the command before, during and after what is sent, at a sample period [rad]."""

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


def simulated_tests() -> list[list[TelemetryBlock]]:
    """Return the blocks of tests of actuators with other faults each, several tests of each."""
    h, rng = ActuatorDescription().sample_period, np.random.default_rng(20)
    before, sent, after = commands(h)
    size = round(BLOCK_S / h)
    tests = []
    for _ in range(_VARIANTS):
        actuator = SimulatedActuator()
        friction, backlash, short, zeta, phase = rng.uniform(0.0, 0.3, 5)
        actuator.faults = fault_vector(
            {
                "friction": friction,
                "backlash": backlash,
                "short_circuit_b": short,
                "eccentricity": zeta,
                "eccentricity_phase": 3.0 * phase,
            }
        )
        for _ in range(_CYCLES):
            actuator.advance(before)
            blocks = [actuator.advance(part) for part in np.split(sent, len(sent) // size)]
            actuator.advance(after)
            noisy = [
                replace(b, current=b.current + rng.normal(0.0, _CURRENT_NOISE, len(b)))
                for b in blocks
            ]
            tests.append([telemetry_to_message(block, "") for block in noisy])
    return tests


def publish(
    actuators: int,
    bursts: int,
    together: bool,
    times: "SimpleQueue[float]",
    monitors: int = 1,
    simulated: Sequence[Sequence[bytes]] = (),
) -> None:
    """Publish the tests of all actuators in real time, once there are as many monitors.

    Tells when the first period began [s since the epoch], and in the end how late a block was
    sent at most [s]. ``simulated`` has the tests as serialised messages; they are simulated if it
    is empty.
    """
    tests = [[deserialize_message(item, TelemetryBlock) for item in test] for test in simulated]
    tests = tests or simulated_tests()
    rclpy.init()
    node = rclpy.create_node("fleet", namespace=NAMESPACE)
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
    for due_ns, number, burst, block in schedule(actuators, bursts, together):
        time.sleep(max(0, began_ns + due_ns - time.time_ns()) * 1e-9)
        latest_ns = max(latest_ns, time.time_ns() - began_ns - due_ns)
        message = tests[number % _VARIANTS * _CYCLES + burst % _CYCLES][block]
        message.actuator_id = units[number].actuator_id
        message.header.stamp = stamp_to_message(began_ns + due_ns - (size - 1) * h_ns)
        message.first_index = due_ns // h_ns - size + 1
        telemetry.publish(message)
    time.sleep(_DISCOVERY_S)  # a reader may still ask for what it missed
    times.put(latest_ns * 1e-9)
    rclpy.shutdown()


def schedule(actuators: int, bursts: int, together: bool) -> Iterator[tuple[int, int, int, int]]:
    """Yield when each block is due [ns], and the numbers of actuator, burst and block."""
    a_period, a_test = round(PERIOD_S / BLOCK_S), round(TEST_S / BLOCK_S)
    starts = [0 if together else a_period * number // actuators for number in range(actuators)]
    for tick in range(bursts * a_period + max(starts)):
        for number, start in enumerate(starts):
            burst, block = divmod(tick - start, a_period)
            if 0 <= burst < bursts and block < a_test:
                yield round((tick + 1) * BLOCK_S * 1e9), number, burst, block


class Observer:
    """Listens to what the monitor publishes, and keeps it."""

    def __init__(self) -> None:
        self.latencies_s: dict[tuple[str, int], float] = {}
        # Why there is no valid estimate.
        self.invalid: dict[tuple[str, int], str] = {}
        self.statuses: dict[str, dict[str, str]] = {}
        self._node = rclpy.create_node("observer", namespace="/benchmark")
        self._node.create_subscription(
            FaultEstimate, f"{NAMESPACE}/{FAULT_ESTIMATE}", self._note_estimate, 1000
        )
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._note_status, 1000)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)

    def listen_until(self, is_over: Callable[[], bool]) -> None:
        """Take in what comes until something holds."""
        while not is_over():
            self._executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        """Stop listening."""
        self._executor.shutdown()
        self._node.destroy_node()

    def _note_estimate(self, message: FaultEstimate) -> None:
        window = (message.actuator_id, message.window)
        self.latencies_s[window] = time.time() - 1e-9 * stamp_from_message(message.window_end)
        if not message.valid:
            self.invalid[window] = message.reason

    def _note_status(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.statuses[status.name] = {pair.key: pair.value for pair in status.values}


def measure(actuators: int, together: bool, duration_s: float) -> Row:
    """Let a monitor follow a number of actuators, and return how it fares."""
    bursts = _SETTLING + max(1, round(duration_s / PERIOD_S))
    context = multiprocessing.get_context("spawn")
    times: SimpleQueue[float] = context.SimpleQueue()
    observer = Observer()
    monitor = subprocess.Popen([program("monitor")], stderr=subprocess.DEVNULL)
    publisher = context.Process(target=publish, args=(actuators, bursts, together, times))
    publisher.start()
    try:
        observer.listen_until(lambda: not times.empty())
        began_s = times.get()
        observer.listen_until(lambda: time.time() > began_s + _SETTLING * PERIOD_S)
        cpu_s, at_s = cpu_time_s(monitor.pid), time.time()
        observer.listen_until(lambda: time.time() > began_s + bursts * PERIOD_S)
        cores = (cpu_time_s(monitor.pid) - cpu_s) / (time.time() - at_s)
        observer.listen_until(lambda: not times.empty())
        late_s = times.get()
        deadline_s = time.time() + _LAST_S
        expected = {
            (f"flap_{number}", window)
            for number in range(actuators)
            for window in range(_SETTLING, bursts)
        }
        observer.listen_until(
            lambda: expected <= observer.latencies_s.keys() or time.time() > deadline_s
        )
    finally:
        publisher.join(_LAST_S)
        publisher.kill()
        monitor.send_signal(signal.SIGINT)
        monitor.wait(_LAST_S)
        observer.close()
    latencies_s = [observer.latencies_s[key] for key in expected & observer.latencies_s.keys()]
    heard = [int(values["blocks"]) for values in observer.statuses.values() if "blocks" in values]
    return Row(
        actuators=actuators,
        together=together,
        windows=len(expected),
        missing=len(expected) - len(latencies_s),
        dropped=int(observer.statuses["/ema/monitor: input"]["windows dropped"]),
        invalid=len(observer.invalid.keys() & expected),
        blocks_lost=actuators * bursts * round(TEST_S / BLOCK_S) - sum(heard),
        latency_median_s=float(np.median(latencies_s)),
        latency_95_percent_s=float(np.quantile(latencies_s, 0.95)),
        latency_longest_s=float(np.max(latencies_s)),
        monitor_cores=cores,
        publisher_late_s=late_s,
        reasons=sorted(set(observer.invalid.values())),
    )


def cpu_time_s(process: int) -> float:
    """Return the processor time that a process has taken so far [s]."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@click.command()
@click.option("--actuators", default="1,4,16,32,64", show_default=True, help="Numbers of them.")
@click.option("--together", is_flag=True, help="All test at once instead of taking turns.")
@click.option("--duration", "duration_s", default=40.0, show_default=True, help="Of a row [s].")
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
def main(actuators: str, together: bool, duration_s: float, output: Path | None) -> None:
    """Print the table and write the JSON file."""
    rclpy.init()
    rows = [measure(int(number), together, duration_s) for number in actuators.split(",")]
    rclpy.shutdown()
    columns = [item.name for item in fields(Row) if item.name not in ("together", "reasons")]
    order = "at once" if together else "in turn"
    title = f"one monitor, {TEST_S:g} s of test in every {PERIOD_S:g} s of each actuator, {order}"
    table = Table(*(name.replace("_", " ") for name in columns), "followed", title=title)
    for row in rows:
        values = [getattr(row, name) for name in columns]
        texts = [f"{value:.3f}" if isinstance(value, float) else str(value) for value in values]
        table.add_row(*texts, "yes" if row.is_followed else "no")
    Console(width=140).print(table)
    if output:
        content = [asdict(row) | {"is_followed": row.is_followed} for row in rows]
        output.write_text(json.dumps(content, indent=2))


if __name__ == "__main__":
    main()
