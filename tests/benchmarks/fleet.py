"""How many actuators one monitor process follows, each streaming 0.7 s of test in every 5 s.

    python tests/benchmarks/fleet.py [--actuators 1,4,16,32,64] [--duration S] [--json FILE]

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
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

import click
import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rich.console import Console
from rich.table import Table

from ema_cli.bringup import program
from ema_core.commands import THESIS_CHIRP
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_interfaces.msg import FaultEstimate, TelemetryBlock
from ema_messages.description import description_to_message
from ema_messages.stamps import stamp_from_message, stamp_to_message
from ema_messages.telemetry import telemetry_to_message
from ema_messages.topics import ACTUATOR_TOPICS, DESCRIPTION, NAMESPACE, TELEMETRY
from ema_sim.actuator import SimulatedActuator

PERIOD_S: Final = 5.0
TEST_S: Final = 0.7
BLOCK_S: Final = 0.01
SETTLING_S: Final = 2.0 * PERIOD_S
START_S: Final = 30.0

_DEPTH: Final = 1.5e-3
_APPROACH_S: Final = 0.15
_REST_S: Final = 0.047
_CURRENT_NOISE: Final = 0.02
_VARIANTS: Final = 8
_CYCLES: Final = 3


@dataclass(frozen=True)
class Row:
    """What one number of actuators leads to."""

    actuators: int
    windows: int
    missing: int
    dropped: int
    invalid: int
    blocks_lost: int
    latency_median_s: float
    latency_95_percent_s: float
    latency_most_s: float
    monitor_cores: float
    publisher_late_ms: float

    @property
    def is_followed(self) -> bool:
        """Whether the monitor did not fall behind."""
        return not (self.missing or self.dropped or self.blocks_lost)


def test_command(h: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
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
    before, sent, after = test_command(h)
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


def names(count: int) -> list[str]:
    """Return the actuators' names."""
    return [f"flap_{number}" for number in range(count)]


def publish(count: int, together: bool, until_ns: int, told: "multiprocessing.Queue[float]") -> None:
    """Publish telemetry in real time, and tell how late the latest block was sent [s]."""
    tests = simulated_tests()
    rclpy.init()
    node = rclpy.create_node("fleet", namespace=NAMESPACE)
    message_class, qos = ACTUATOR_TOPICS[DESCRIPTION]
    descriptions = [node.create_publisher(message_class, DESCRIPTION, qos) for _ in range(count)]
    for publisher, name in zip(descriptions, names(count), strict=True):
        publisher.publish(description_to_message(replace(ActuatorDescription(), actuator_id=name)))
    telemetry = node.create_publisher(*ACTUATOR_TOPICS[TELEMETRY][:1], TELEMETRY, ACTUATOR_TOPICS[TELEMETRY][1])
    while not telemetry.get_subscription_count():
        time.sleep(0.05)
    time.sleep(1.0)  # for the descriptions to arrive
    began_ns, h_ns, size = time.time_ns(), 100_000, round(BLOCK_S * 1e4)
    blocks = round(TEST_S / BLOCK_S)
    latest_s = 0.0
    for due_ns, actuator, burst, block in schedule(count, together, blocks):
        end_ns = began_ns + due_ns
        if end_ns > until_ns:
            break
        time.sleep(max(0.0, (end_ns - time.time_ns()) * 1e-9))
        latest_s = max(latest_s, (time.time_ns() - end_ns) * 1e-9)
        message = tests[(actuator % _VARIANTS) * _CYCLES + burst % _CYCLES][block]
        message.actuator_id = f"flap_{actuator}"
        message.header.stamp = stamp_to_message(end_ns - (size - 1) * h_ns)
        message.first_index = due_ns // h_ns - size + 1
        telemetry.publish(message)
    time.sleep(2.0)  # a reader may ask for what it missed
    told.put(latest_s)
    rclpy.shutdown()
