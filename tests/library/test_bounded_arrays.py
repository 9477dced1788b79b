# SPDX-License-Identifier: Apache-2.0
"""Descriptions that would need arrays of excessive size are refused with a reason."""

import tracemalloc
from collections.abc import Callable
from typing import Any

import pytest

from ema_core.commands import Command, approach_depth, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters
from ema_core.quantity import MOST_BYTES
from ema_monitor.prognosis.requirements.performance import PerformanceModel
from ema_sim.bench import ActuatorBench, BenchSettings


def peak_bytes(call: Callable[[], Any]) -> int:
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def cycle_of(command: Command, period: float, **parameters: float) -> Callable[[], Any]:
    depth = approach_depth(ActuatorParameters().replace(parameters))
    return lambda: build_cycle(command, period, depth)


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (cycle_of(Command(duration=3600.0), 1e-6), "duration = 3600 s at sample_period = 1e-06 s"),
        (cycle_of(Command(), 1e-9), "rad/s and sample_period = 1e-09 s: 4e"),
        (
            # With such a weak position control, the approach would last for days.
            cycle_of(Command(), 1e-4, GAP=1e-6, theta_stop=1e6, G_prop=1.0),
            "an approach from .* rad below at 0.005 rad/s",
        ),
        (
            lambda: PerformanceModel(ActuatorParameters(GAP=1e3, J_m=1e-9, J_u=0.0)),
            r"GAP = 1000 N.m.s/rad with an inertia of 1e-09 kg.m\^2",
        ),
        (
            lambda: ActuatorBench(
                ActuatorDescription(sample_period=1e-6), BenchSettings(pause_s=3600.0)
            ),
            "pause_s = 3600 s at sample_period = 1e-06 s",
        ),
    ],
)
def test_description_that_needs_too_much_memory_is_refused_by_name(
    call: Callable[[], Any], named: str
):
    def refused() -> None:
        with pytest.raises(ValueError, match=named):
            call()

    assert peak_bytes(refused) < 1e6


@pytest.mark.slow
def test_memory_just_within_the_bound_hardly_exceeds_it():
    """The bound is in bytes; here it corresponds to 200 s at 100 kHz."""
    command = Command("step", duration=160.0)
    assert peak_bytes(lambda: build_cycle(command, 1e-5)) < 4 * MOST_BYTES
