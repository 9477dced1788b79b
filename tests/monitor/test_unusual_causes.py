# SPDX-License-Identifier: Apache-2.0
"""No OK if an unusual cause may hide a fault: on simulated windows, and in closed form."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from ema_core.causes import CauseEstimate
from ema_core.levels import ERROR, OK, WARN
from ema_monitor import find_windows, identify
from ema_monitor.health import TORQUE_PER_AMPERE, Health, HealthLimits, assess
from ema_monitor.identification.estimate import Verdict
from ema_monitor.model.deviations import USUAL_SIGMA
from ema_monitor.unusual_causes import ONE_SIDED_95, unusual_causes, usual_range
from ema_sim import simulate

from .windows import estimated

LIMITS = HealthLimits()
SHORTS = ("short_circuit_a", "short_circuit_b", "short_circuit_c")


def judged(
    faults: Mapping[str, float],
    causes: Mapping[str, float] | None = None,
    measured: Mapping[str, tuple[float, float]] | None = None,
) -> Health:
    """Return the health after one simulated test cycle."""
    telemetry = simulate(dict(faults), seed=5, current_noise=0.02, causes=dict(causes or {}))
    [window] = find_windows(telemetry)
    estimate = identify(window, measured=measured)
    assert estimate.valid, estimate.reason
    return assess(estimate, LIMITS)


@pytest.mark.slow
@pytest.mark.parametrize("turns", [0.09, 0.1, 0.12])
def test_equal_short_circuits_warn_although_they_look_like_a_weaker_motor(turns: float):
    health = judged(dict.fromkeys(SHORTS, turns))
    assert health.level == WARN
    # Their share of the limit 0.25, as if the turns were lost.
    assert health.health_index == pytest.approx(1.0 - turns / 0.25, abs=0.05)
    if not any(item.level == WARN for item in health.faults):
        [torque] = [
            requirement
            for requirement in health.requirements
            if requirement.name == TORQUE_PER_AMPERE
        ]
        assert torque.level == WARN
        assert torque.value == pytest.approx(1.0 - turns, abs=0.01)
        assert "torque constant" in health.reason
        assert "equal short circuits of all phases" in health.reason


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "causes", "measured"),
    [
        ({"friction": 0.1}, {}, {"current_gain": (0.2, 0.01)}),
        ({"friction": 0.15}, {}, {"current_gain": (0.3, 0.01)}),
        ({"friction": 0.2}, {}, {"current_gain": (0.4, 0.01)}),
        (dict.fromkeys(SHORTS, 0.16), {}, {"torque_constant": (-0.16, 0.005)}),
        ({}, {"torque_constant": -0.16}, None),
        ({}, {"inertia": -0.3}, None),
        ({}, {"current_gain": -0.1}, None),
        ({}, {"speed_gain": 0.05}, None),
        ({}, {"position_gain": 0.05}, None),
    ],
)
def test_cause_beyond_its_usual_range_warns_if_estimated_or_measured(faults, causes, measured):
    health = judged(faults, causes, measured)
    assert health.level == WARN
    assert not health.health_index > 0.99
    if not any(item.level == WARN for item in health.faults):
        assert "beyond its usual" in health.reason


@pytest.mark.slow
@pytest.mark.parametrize(
    ("causes", "measured"),
    [
        ({}, None),
        ({"torque_constant": -0.03}, None),
        ({"inertia": 0.1}, None),
        ({"current_gain": 0.02}, None),
        ({"viscous_friction": 1.0}, None),
        ({"winding_temperature": 60.0}, None),
        ({"load_torque": 0.05}, {"load_torque": (0.05, 0.005)}),
        ({"torque_constant": -0.05}, {"torque_constant": (-0.05, 0.01)}),
    ],
)
def test_usual_causes_leave_a_healthy_unit_ok(causes, measured):
    assert judged({}, causes, measured).level == OK


@pytest.mark.parametrize("name", USUAL_SIGMA)
def test_bound_decides_and_for_a_degraded_estimate_the_value(name: str):
    limit, sigma = usual_range(name), 0.2 * usual_range(name)
    beyond = CauseEstimate(name, -limit - (ONE_SIDED_95 * sigma + 1e-6), sigma)
    within = beyond._replace(value=-limit - (ONE_SIDED_95 * sigma - 1e-6))
    for field in ("causes", "measured"):
        fields: dict[str, Any] = {field: (beyond,)}
        assert name in unusual_causes(estimated(**fields))
        fields = {field: (within,)}
        assert not unusual_causes(estimated(**fields))
    degraded = estimated(verdict=Verdict.DEGRADED)
    assert name in unusual_causes(replace(degraded, causes=(within,)))
    usual = within._replace(value=0.9 * limit)
    assert not unusual_causes(replace(degraded, causes=(usual,)))
    poor = replace(degraded, causes=(usual,), goodness_of_fit=4.0, goodness_limit=3.5)
    assert "fits badly" in unusual_causes(poor)[name]


@pytest.mark.parametrize(("loss", "level"), [(0.05, OK), (0.09, WARN), (0.26, ERROR)])
def test_loss_of_torque_counts_in_index_and_requirements(loss: float, level: int):
    cause = CauseEstimate("torque_constant", -loss, 0.002)
    health = assess(estimated(causes=(cause,), goodness_of_fit=1.0), LIMITS)
    assert health.level == level
    assert health.health_index == pytest.approx(max(0.0, 1.0 - loss / 0.25))
    [torque] = health.requirements
    assert (torque.name, torque.level) == (TORQUE_PER_AMPERE, level)
