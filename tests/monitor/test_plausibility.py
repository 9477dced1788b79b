# SPDX-License-Identifier: Apache-2.0
"""Samples that no motor can give refuse a window: they are neither a departure nor wear."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.commands import THESIS_CHIRP
from ema_core.parameters import ActuatorParameters
from ema_monitor.windows.plausibility import impossible_motion
from ema_monitor.windows.trigger import Refusal, WindowTrigger
from ema_sim.actuator import SimulatedActuator

from .streams import blocks, only

PARAMETERS = ActuatorParameters()


@pytest.fixture(scope="module")
def recorded(cycle):
    return SimulatedActuator().advance(cycle.samples)


def spoiled(telemetry, name, rows, change):
    values = getattr(telemetry, name).copy()
    values[rows] = change(values[rows])
    return replace(telemetry, **{name: values})


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("position", lambda value: value + 2.0 * np.pi, "the position jumps 2 times"),
        ("position", lambda value: value - 0.01, "the position jumps 2 times, by up to 0.01"),
        ("speed", lambda value: value + 1000.0, "the speed is wrong for one sample 1 time"),
        ("speed", lambda value: 0.0 * value - 3e3, "the speed is wrong for one sample 1 time"),
    ],
)
@pytest.mark.parametrize("size", [50, 100_000])
def test_impossible_sample_refuses_its_window(recorded, cycle, name, change, words, size):
    telemetry = spoiled(recorded, name, cycle.start + 1000, change)
    trigger = WindowTrigger(PARAMETERS)
    events = [event for block in blocks(telemetry, size) for event in trigger.feed(block)]
    [refusal] = only(Refusal, events)
    assert refusal.reason.startswith("impossible samples: ")
    assert words in refusal.reason


def test_position_that_wraps_refuses_its_window(recorded, cycle):
    """With half of the samples, each crossing is a jump."""
    telemetry = replace(recorded, position=recorded.position % (2.0 * np.pi))
    events = WindowTrigger(PARAMETERS).feed(telemetry)
    [refusal] = only(Refusal, events)
    assert "by up to 6.283 rad" in refusal.reason


@pytest.mark.parametrize("period", [1e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_motion_of_a_noisy_actuator_at_its_limits_is_possible(period, noise):
    """The command has full reversals between the stops, which the shaft hits."""
    rng = np.random.default_rng(1)
    samples = np.tile(THESIS_CHIRP.sample(1e-4), 1)
    command = 30.0 * samples
    telemetry = SimulatedActuator().advance(command)
    step = round(period / 1e-4)
    part = replace(
        telemetry,
        sample_period=period,
        command=command[::step],
        position=telemetry.position[::step] + noise * rng.standard_normal(len(command[::step])),
        speed=telemetry.speed[::step] + 1e4 * noise * rng.standard_normal(len(command[::step])),
        current=telemetry.current[::step],
    )
    assert impossible_motion(part, PARAMETERS) is None
