"""Changes of a joint that may explain a record, as directions in the space of its coefficients."""

from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array
from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.comparison import FRICTION, GRAVITY, INERTIA, LOAD, TORQUE, VISCOUS
from ema_monitor.joint.shape import COEFFICIENTS

OF_COEFFICIENTS: Final[tuple[str, ...]] = (FRICTION, INERTIA, VISCOUS, LOAD, GRAVITY)
"""Quantity that each coefficient stands for."""


class Hypothesis(NamedTuple):
    """A change that may explain a record: its quantities, and their columns, ``(5, k)``.

    A column is the change of the coefficients for a change of 1 of its quantity: relative, or in
    amperes.
    """

    quantities: tuple[str, ...]
    columns: Array


def hypotheses(baseline: Baseline) -> list[Hypothesis]:
    """Return the changes that are considered: single quantities first, then pairs."""
    columns: dict[str, Array] = dict(zip(OF_COEFFICIENTS, np.diag(_steps(baseline)), strict=True))
    # The effort that the same motion takes is inverse to the torque per ampere.
    columns[TORQUE] = -baseline.healthy
    pairs = [(FRICTION, TORQUE)]
    if baseline.shape.has_gravity:
        pairs.append((GRAVITY, INERTIA))
    else:
        del columns[GRAVITY]
        columns[TORQUE] = np.where(np.arange(len(COEFFICIENTS)) == 4, 0.0, columns[TORQUE])
    return [Hypothesis((name,), column[:, None]) for name, column in columns.items()] + [
        Hypothesis(pair, np.column_stack([columns[name] for name in pair])) for pair in pairs
    ]


def _steps(baseline: Baseline) -> Array:
    """Return the change of each coefficient for a change of 1 of its quantity, ``(5,)``."""
    friction, inertia, _, _, gravity = baseline.healthy.tolist()
    return np.array([friction, inertia, baseline.viscous_scale, 1.0, gravity])
