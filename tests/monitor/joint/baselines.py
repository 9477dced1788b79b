# SPDX-License-Identifier: Apache-2.0
"""Synthetic baselines and records from coefficients, without telemetry."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.record import NS_A_DAY, JointRecord
from ema_monitor.joint.shape import DRY, GRAVITY, INERTIA, LOAD, VISCOUS, Shape
from ema_monitor.joint.signals import Preparation

from .plant import FIRST_DAY

Values = NDArray[np.float64]

USUAL_SPEED = 2.0
SHAPE = Shape(coulomb=1.0, sine=0.5, has_gravity=True)
"""Coulomb friction of 1 A and gravity of 0.5 A."""

HEALTHY: Values = np.array([1.0, 0.12, 0.25, 0.1, 1.0])
"""Dry friction and gravity relative to the shape, inertia, viscous friction and load."""

ERRORS: Values = np.array([0.006, 0.0008, 0.004, 0.004, 0.01])
"""Standard deviations of the errors of a record; the two friction errors are correlated."""

SCATTER = 0.01
"""Relative standard deviation of each coefficient between days; half of it between records."""

SEPARATE = 100
"""Day of a test, long after the healthy records."""


def covariance(scale: float = 1.0) -> NDArray[np.float64]:
    """Return the covariance of the errors of a record, correlated for the friction coefficients."""
    correlation = np.eye(5)
    correlation[DRY, VISCOUS] = correlation[VISCOUS, DRY] = -0.8
    return scale**2 * correlation * np.outer(ERRORS, ERRORS)


def record_of(
    values: Values, *, day: int = SEPARATE, second: int = 0, error: float = 1.0, **more: Any
) -> JointRecord:
    """Return a record with these coefficients, measured with ``error`` times the usual error."""
    return JointRecord(
        (FIRST_DAY + day) * NS_A_DAY + second * 10**9,
        np.array(values),
        covariance(error),
        more.pop("usual_speed", USUAL_SPEED),
        more.pop("travel", 2.0),
        **more,
    )


def drawn_effects(rng: np.random.Generator, scatter: float) -> Values:
    """Return the factors and the load of a day or a record."""
    effects = scatter * rng.standard_normal(5)
    effects[LOAD] *= 0.5
    return effects


def drawn(
    rng: np.random.Generator,
    day: int,
    of_day: Values,
    *,
    healthy: Values = HEALTHY,
    scatter: float = SCATTER,
    **more: Any,
) -> JointRecord:
    """Return a healthy record of a day, with scatter and error."""
    effects = of_day + drawn_effects(rng, 0.5 * scatter)
    scale = np.array(healthy)
    scale[LOAD] = 1.0
    error = rng.multivariate_normal(np.zeros(5), covariance())
    return record_of(healthy + scale * effects + error, day=day, **more)


def baseline_of(
    seed: int = 0,
    *,
    days: int = 3,
    a_day: int = 3,
    healthy: Values = HEALTHY,
    shape: Shape = SHAPE,
    scatter: float = SCATTER,
    records: Sequence[Mapping[str, Any]] = (),
) -> Baseline:
    """Return a baseline of drawn records; ``records`` has additional attributes of each record."""
    rng = np.random.default_rng(seed)
    drawn_records = []
    for day in range(days):
        of_day = drawn_effects(rng, scatter)
        for number in range(a_day):
            more = records[day * a_day + number] if records else {}
            drawn_records.append(
                drawn(rng, day, of_day, healthy=healthy, scatter=scatter, second=number, **more)
            )
    return Baseline(Preparation(2.0, 0.0, USUAL_SPEED), shape, tuple(drawn_records))


def changed(
    values: Values,
    *,
    friction: float = 1.0,
    inertia: float = 1.0,
    viscous: float = 0.0,
    load: float = 0.0,
    gravity: float = 1.0,
    torque: float = 1.0,
) -> Values:
    """Return coefficients after changes: factors, and additional viscous friction and load.

    ``viscous`` is a share of all friction at the usual speed.
    """
    coefficients = np.array(values)
    coefficients[DRY] *= friction
    coefficients[INERTIA] *= inertia
    coefficients[VISCOUS] += viscous * (1.0 / USUAL_SPEED + HEALTHY[VISCOUS])
    coefficients[LOAD] += load
    coefficients[GRAVITY] *= gravity
    return coefficients / torque
