"""Telemetry of a fleet in real time, and what hears of it, for many_actuators.py.

One process publishes the telemetry of all actuators in turn, in blocks of 10 ms at 10,000 samples a
second. It was simulated beforehand, with other faults in each actuator and noise of 0.02 A on the
current. A test is a rest 1.5 mrad below, 0.15 s of approach, 0.05 s of rest and the thesis's chirp
of 0.5 s, so that the monitor knows where in its play the motor stands. Between the tests nothing is
sent.
"""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from multiprocessing.queues import SimpleQueue
from pathlib import Path
from typing import Final

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import deserialize_message

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
_DISCOVERY_S: Final = 2.0


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
    times: "SimpleQueue[float]",
    monitors: int,
    simulated: Sequence[Sequence[bytes]],
) -> None:
    """Publish the tests of all actuators in real time, once there are as many monitors.

    Tells when the first period began [s since the epoch], and in the end how late a block was
    sent at most [s]. ``simulated`` has the tests as serialised messages.
    """
    tests = [[deserialize_message(item, TelemetryBlock) for item in test] for test in simulated]
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
    for due_ns, number, burst, block in schedule(actuators, bursts):
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


def schedule(actuators: int, bursts: int) -> Iterator[tuple[int, int, int, int]]:
    """Yield when each block is due [ns], and the numbers of actuator, burst and block."""
    a_period, a_test = round(PERIOD_S / BLOCK_S), round(TEST_S / BLOCK_S)
    starts = [a_period * number // actuators for number in range(actuators)]
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


def cpu_time_s(process: int) -> float:
    """Return the processor time that a process has taken so far [s]."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
