# SPDX-License-Identifier: Apache-2.0
"""Calibrations on worn units are refused: they are implausible for their description."""

from collections.abc import Mapping
from typing import Any

import pytest

from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters
from ema_monitor import calibrate, find_windows
from ema_monitor.windows.window import Window
from ema_sim import Command, simulate

FLAP = ActuatorDescription()


def windows(
    faults: Mapping[str, float], parameters: ActuatorParameters | None = None, **more: Any
) -> list[Window]:
    windows = []
    for seed in range(3):
        telemetry = simulate(
            dict(faults), seed=seed, current_noise=0.02, parameters=parameters, **more
        )
        windows += find_windows(telemetry)[:1]
    return windows


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "words"),
    [
        ({"friction": 0.4}, "friction is"),
        ({"backlash": 0.3}, "of the current"),
        ({"backlash": 0.6}, "of the current"),
        ({"short_circuit_a": 0.15}, "turns a is"),
        ({"short_circuit_a": 0.45}, "would explain them as well"),
        ({"short_circuit_a": 0.5}, "would explain them as well"),
        ({"eccentricity": 0.3}, "eccentricity cos is"),
        ({"eccentricity": 0.7}, "of the current"),
        ({"gain": 0.8}, "loop gain is"),
        ({"gain": 0.2}, "loop gain is"),
        ({"friction": 0.4, "backlash": 0.4, "gain": 0.7}, "of the current"),
    ],
)
def test_worn_unit_is_refused_unless_a_person_accepts_it(faults: Mapping[str, float], words: str):
    worn = windows(faults)
    with pytest.raises(ValueError, match="implausible for a healthy unit") as refused:
        calibrate(worn, FLAP)
    assert words in str(refused.value)
    assert "state who accepts it" in str(refused.value)
    assert calibrate(worn, FLAP, accepted_by="Ada").windows == 3


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_healthy_units_with_deviating_parameters_are_plausible(seed: int):
    nominal = ActuatorParameters()
    factors = [1.0 + 0.05 * (-1.0) ** (seed >> bit) for bit in range(2)]
    off = nominal.replace(
        {
            "J_m": factors[0] * nominal.J_m,
            "J_u": factors[0] * nominal.J_u,
            "f_sm": factors[1] * nominal.f_sm,
            "f_su": factors[1] * nominal.f_su,
        }
    )
    assert calibrate(windows({}, off), FLAP).windows == 3


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        Command("swing", amplitude=0.005),
        Command("sine", amplitude=0.005, start_frequency=4.0),
        Command("ramp", amplitude=0.02, rate=0.01, duration=0.5),
        Command("chirp", amplitude=0.001),
    ],
    ids=["swing", "sine", "ramp", "small chirp"],
)
def test_healthy_unit_with_other_commands_is_plausible(command: Command):
    assert calibrate(windows({}, command=command), FLAP).windows == 3
