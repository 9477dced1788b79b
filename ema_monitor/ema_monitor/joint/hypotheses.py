# SPDX-License-Identifier: Apache-2.0
"""Possible changes of a joint, as directions in the space of the coefficients of a record."""

from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array
from ema_monitor.joint.baseline import Baseline
from ema_monitor.quantities import FRICTION, GRAVITY, INERTIA, LOAD, TORQUE, VISCOUS

OF_COEFFICIENTS: Final[tuple[str, ...]] = (FRICTION, INERTIA, VISCOUS, LOAD, GRAVITY)
"""Quantity of each coefficient, in the order of ``COEFFICIENTS``."""

_PAYLOAD: Final = frozenset({GRAVITY, INERTIA, LOAD})


class Hypothesis(NamedTuple):
    """Possible explanation of a record: the changed quantities and their columns, ``(5, k)``.

    Each column is the change of the coefficients per unit change of its quantity. Changes are
    relative; a change of the load is in amperes.
    """

    quantities: tuple[str, ...]
    columns: Array

    @property
    def causes(self) -> int:
        """Number of independent changes: a payload changes inertia, gravity and load together.

        The constant load includes the gravity at the centre of the motion.
        """
        return 1 if set(self.quantities) <= _PAYLOAD else len(self.quantities)


def hypotheses(baseline: Baseline) -> list[Hypothesis]:
    """Return the changes that may explain a record: first single quantities, then combinations."""
    columns: dict[str, Array] = dict(zip(OF_COEFFICIENTS, np.diag(_steps(baseline)), strict=True))
    shape = baseline.shape
    # Load-dependent friction rises with the payload.
    for name, load_friction in ((INERTIA, shape.of_inertia), (GRAVITY, shape.of_gravity)):
        if load_friction:
            columns[name] = columns[name] + np.array(load_friction)
    # The effort of the same motion is inversely proportional to the torque per ampere.
    columns[TORQUE] = -baseline.healthy * shape.used
    combinations = [(FRICTION, TORQUE), (GRAVITY, INERTIA), (GRAVITY, INERTIA, LOAD)]
    not_fitted = [name for name, used in zip(OF_COEFFICIENTS, shape.used, strict=True) if not used]
    for name in not_fitted:
        del columns[name]
    if not baseline.shows_torque:
        del columns[TORQUE]
    singles = [Hypothesis((name,), column[:, None]) for name, column in columns.items()]
    return singles + [
        Hypothesis(names, np.column_stack([columns[name] for name in names]))
        for names in combinations
        if all(name in columns for name in names)
    ]


def _steps(baseline: Baseline) -> Array:
    """Return the change of each coefficient per unit change of its quantity, ``(5,)``."""
    friction, inertia, _, _, gravity = baseline.healthy.tolist()
    return np.array([friction, inertia, baseline.viscous_scale, 1.0, gravity])
