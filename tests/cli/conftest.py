# SPDX-License-Identifier: Apache-2.0
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_bags.writer import BagWriter
from ema_cli.simulated_lives import simulated_tests, write_test
from ema_core.commands import THESIS_CHIRP, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_core.telemetry import Telemetry
from ema_sim.actuator import SimulatedActuator
from ema_sim.lives import SimulatedLife

INTERVAL_H, TESTS, RATE = 10.0, 10, 0.02
"""Properties of the recorded life: hours between tests, number of tests, growth per test."""


@pytest.fixture(scope="session")
def life_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the bags of a life, which tests only read."""
    folder = tmp_path_factory.mktemp("life")
    hours = INTERVAL_H * np.arange(1.0, TESTS + 1)
    faults = np.array([fault_vector({"friction": 0.1 + RATE * i}) for i in range(TESTS)])
    life = SimulatedLife("friction", {}, hours, faults, ("good",) * TESTS, math.inf)
    description = ActuatorDescription()
    for test in simulated_tests(life, description, np.random.default_rng(0)):
        # The order of the names differs from the order of the tests.
        write_test(folder / f"{TESTS - test.number:02d}.mcap", test, description)
    return folder


@pytest.fixture(scope="session")
def faulty_blocks() -> list[Telemetry]:
    """Return telemetry of one cycle with friction, in blocks of 10 ms."""
    actuator = SimulatedActuator()
    actuator.faults = fault_vector({"friction": 0.3})
    samples = build_cycle(THESIS_CHIRP, 1e-4).samples
    return [actuator.advance(part) for part in np.split(samples, range(100, len(samples), 100))]


def repeated(blocks: list[Telemetry], cycles: int) -> list[Telemetry]:
    """Return the same telemetry repeated for several cycles, with continuing stamps and indices."""
    samples = sum(map(len, blocks))
    return [
        replace(
            block,
            stamp_ns=block.stamp_ns + round(1e9 * cycle * samples * block.sample_period),
            first_index=block.first_index + cycle * samples,
        )
        for cycle in range(cycles)
        for block in blocks
    ]


@pytest.fixture
def record(tmp_path: Path) -> Callable[[list[Telemetry]], Path]:
    """Return a function that writes blocks to a bag and returns its path."""

    def write(blocks: list[Telemetry]) -> Path:
        path = tmp_path / "recorded.mcap"
        with SimulatedActuatorBag(BagWriter(path), ActuatorDescription()) as bag:
            for block in blocks:
                bag.write_block(block, 0.0)
        return path

    return write


@pytest.fixture(scope="session")
def spoiled() -> Callable[[Telemetry, str, int, float], Telemetry]:
    """Return a function that replaces one sample of one column of a block."""

    def spoil(block: Telemetry, column: str, sample: int, value: float) -> Telemetry:
        values = getattr(block, column).copy()
        values[sample] = value
        return replace(block, **{column: values})

    return spoil
