"""The kernels that reference and monitor model share, one by one."""

import math

import numpy as np
import pytest

from ema_core.dynamics import (
    LAG_TIME_CONSTANT,
    follow_in_play,
    lag_factor,
    next_speed,
    reference_current,
)
from ema_core.parameters import ActuatorParameters, constants

CONTROL, _, MECHANICS = constants(ActuatorParameters())
F_S, F_D, J = 0.1689, 0.08445, 2.5e-5
DT = 1e-6


def test_speed_loop_is_a_pid():
    """With e = a + b t + c t^2 all three parts are known."""
    c = CONTROL._replace(GAP=0.03, GAI=2.0, GAD=1e-4, I_max=1e3)

    def error(t: float) -> float:
        return 20.0 - 300.0 * t + 5e4 * t**2

    t, dt = 0.01, 1e-7
    integral = 20.0 * t - 150.0 * t**2 + 5e4 / 3 * t**3
    slope = -300.0 + 1e5 * t
    expected = (0.03 * error(t) + 2.0 * integral + 1e-4 * slope) / 0.0752 + 0.5
    # The difference quotient is off by c dt.
    assert reference_current(c, error(t), integral, error(t - dt), 0.5, dt) == pytest.approx(
        expected, abs=1e-4 * 5e4 * 1.1 * dt / 0.0752
    )


def stepped(omega: float, torque: float, dt: float = DT) -> float:
    return next_speed(MECHANICS, omega, torque, F_S, dt)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_breakaway_torque_can_be_less_than_static_friction(direction):
    """Ripple on top of a mean torque sets a shaft free early; in motion nothing is different."""
    torque = direction * 0.8 * F_S
    expected = direction * DT / J * (0.8 * F_S - F_D)
    assert next_speed(MECHANICS, 0.0, torque, 0.7 * F_S, DT) == pytest.approx(expected)
    assert next_speed(MECHANICS, 0.0, torque, 0.9 * F_S, DT) == 0.0
    for breakaway in (0.5 * F_S, F_S):
        assert next_speed(MECHANICS, 2.0, torque, breakaway, DT) == stepped(2.0, torque)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_step_that_would_cross_zero_ends_there(direction):
    slow = direction * 0.5 * DT / J * F_D
    assert stepped(slow, 0.0) == 0.0
    # Even under a torque that could drive it on the other way: that is for the next step.
    assert stepped(slow, -direction * 1.0) == 0.0
    assert stepped(0.0, -direction * 1.0) * direction < 0.0


def test_coast_down_converges_at_first_order():
    """J omega' = -C omega - f_d, until just before it stands still."""
    m = MECHANICS._replace(C=0.01)
    duration, start = 1.5e-3, 10.0
    exact = (start + m.f_d / m.C) * math.exp(-m.C / m.J * duration) - m.f_d / m.C
    assert exact > 1.0
    errors = []
    for steps in (500, 1000, 2000):
        omega = start
        for _ in range(steps):
            omega = next_speed(m, omega, 0.0, m.f_s, duration / steps)
        errors.append(abs(omega - exact))
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 1.0, atol=0.01)


def test_play_is_followed_at_its_edges():
    half = 0.3
    assert follow_in_play(0.0, 0.2, half) == 0.0
    assert follow_in_play(0.0, -0.3, half) == 0.0
    assert follow_in_play(0.0, 0.5, half) == pytest.approx(0.2)
    assert follow_in_play(0.0, -0.5, half) == pytest.approx(-0.2)


def test_lag_is_exact_for_constant_input():
    for dt in (1e-7, 1e-6, 1e-5, 2e-5, 1e-4):
        assert lag_factor(dt) == pytest.approx(1 - math.exp(-dt / 1e-5), rel=1e-14)
    assert LAG_TIME_CONSTANT == 1e-5
