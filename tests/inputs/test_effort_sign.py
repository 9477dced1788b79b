# SPDX-License-Identifier: Apache-2.0
"""A reversed effort seems to gain energy from friction; braking after a step does not."""

from math import copysign, sin

import numpy as np
import pytest

from ema_bags.inputs.motion import ThinnedMotion

H = 1e-3
INERTIA, VISCOUS, GRAVITY, COULOMB = 0.3, 1.5, 8.0, 4.0


def motion_of_steps(sign: float, *, seconds: float = 20.0) -> ThinnedMotion:
    """Return the motion of a joint under PD control, whose set point steps every two seconds."""
    rng = np.random.default_rng(0)
    goal = q = v = 0.0
    rows = []
    for i in range(round(seconds / H)):
        if i % 2000 == 0:
            goal = rng.uniform(-1.0, 1.0)
        effort = 1500.0 * (goal - q) - 40.0 * v
        free = v + H / INERTIA * (effort - VISCOUS * v - GRAVITY * sin(q))
        v = copysign(max(abs(free) - H / INERTIA * COULOMB, 0.0), free)
        q += H * v
        if i % 4 == 0:
            rows.append((q, v, sign * effort))
    position, speed, current = np.array(rows).T
    stamps = np.arange(len(rows), dtype=np.int64) * 4_000_000
    columns = {"position": position, "speed": speed, "current": current}
    motion = ThinnedMotion.of(columns, stamps, 1.0)
    assert motion is not None
    return motion


def test_net_work_has_the_sign_of_the_effort_even_with_hard_braking():
    right, reversed_ = motion_of_steps(1.0), motion_of_steps(-1.0)
    # Friction takes 12 % of the work that a step puts into the inertia and takes out again.
    assert right.work_share > 0.05
    assert reversed_.work_share == pytest.approx(-right.work_share)


def test_without_effort_there_is_no_work():
    position = np.sin(np.arange(2000) * 0.01)
    stamps = np.arange(2000, dtype=np.int64) * 4_000_000
    motion = ThinnedMotion.of({"position": position}, stamps, 1.0)
    assert motion is not None
    assert motion.work_share == 0.0
