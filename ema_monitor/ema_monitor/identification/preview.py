# SPDX-License-Identifier: Apache-2.0
"""Prediction of the information that a search in a stretch of ordinary motion would give.

The method is described in ``docs/identification.md``, M28.
"""

from typing import Final, NamedTuple, Self

import numpy as np

from ema_core.arrays import Array
from ema_core.faults import N_FAULTS
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.knowledge import NUISANCE, Knowledge, information
from ema_monitor.identification.objective import Objective
from ema_monitor.model.measured import expected_causes
from ema_monitor.optimizers.gauss_newton import LeastSquaresProblem, LineSearch, Stopping, descend
from ema_monitor.optimizers.linear_model import Linearisation, Quadratic
from ema_monitor.windows.band import band_limited
from ema_monitor.windows.window import Window

_LOADS: Final = 17
# A preview takes few evaluations: seventeen trial loads, then two steps.
_SHARES: Final = ((1.0, 0.6, 0.3),)
_STOPPING: Final = Stopping(iterations=2)
_NEAR: Final = 0.05
_REPEATED: Final = 0.8


class StretchMotion(NamedTuple):
    """Motion of a stretch, sampled every millisecond."""

    states: Array
    """Position and speed, ``(n, 2)`` [rad, rad/s]. If the speed is not measured, it is derived from
    the position, in radians per sample."""
    scale: Array
    """Travel and largest speed, ``(2,)``, in the units of ``states``."""
    load: float
    """Load relative to the largest possible load [-]."""

    @classmethod
    def of(cls, stretch: Window, load: float) -> Self:
        """Return the motion of a stretch under a load."""
        telemetry = stretch.telemetry
        speed = telemetry.speed if len(telemetry.speed) else np.gradient(telemetry.position)
        rows = band_limited(np.array([telemetry.position, speed]), stretch.sample_period)
        scale = np.array([np.ptp(rows[0]), np.max(np.abs(rows[1]))])
        return cls(rows.T, np.maximum(scale, 1e-12), load)

    def repeats(self, earlier: Self) -> bool:
        """Return whether the motion repeats an earlier motion.

        A repetition has the same model errors, and therefore adds no information.
        """
        if abs(self.load - earlier.load) > _NEAR:
            return False
        scale = np.maximum(self.scale, earlier.scale)
        apart = np.abs(self.states[:, None] - earlier.states[None]) / scale
        near = np.any(np.all(apart <= _NEAR, axis=2), axis=1)
        return bool(np.mean(near) >= _REPEATED)


class Preview(NamedTuple):
    """Predicted result of a search in a stretch of motion."""

    load: float
    """Load that explains the stretch best, in the unit box."""
    misfit: float
    """Ratio of the rms residual to the rms residual of a healthy window, from the linear model with
    the prior knowledge [-]."""
    gained: Array
    """Information about the faults at the noise level of a healthy window, ``(8, 8)``."""
    motion: StretchMotion
    """Motion of the stretch."""

    @classmethod
    def of(
        cls, stretch: Window, calibration: Calibration, knowledge: Knowledge, faults: Array
    ) -> Self:
        """Return the predicted result of a search in a stretch.

        Parameters
        ----------
        stretch
            The stretch.
        calibration
            Calibration of its actuator.
        knowledge
            Knowledge of the faults before the stretch.
        faults
            Faults at which the information is computed, ``(8,)``, with the load that explains the
            stretch best.
        """
        suspects = expected_causes(calibration.parameters, stretch)
        [load] = [cause for cause in suspects if cause.name == NUISANCE]
        objective = Objective(stretch, calibration, causes=(load,))
        points = np.tile(objective.encode(faults), (_LOADS, 1))
        points[:, -1] = np.linspace(0.0, 1.0, _LOADS)
        search = LineSearch(lambda at: _explained(at, knowledge, objective.noise), _SHARES)
        problem = LeastSquaresProblem(objective.residuals, objective.linearise)
        descent = descend(problem, points, search, _STOPPING)
        point = descent.point
        return cls(
            float(point[-1]),
            objective.misfit(descent.residuals),
            information(objective.linearise(point).jacobian, objective.noise),
            StretchMotion.of(stretch, float(objective.causes(point)[0]) / load.reach),
        )


def _explained(at: Linearisation, knowledge: Knowledge, noise: float) -> Array:
    """Return the point in the unit box, ``(d,)``, with the lowest cost.

    The cost is the cost of the linear model ``at`` of a stretch, plus the cost of ``knowledge``:
    the knowledge of the faults from earlier stretches. ``noise`` is the variance of a residual
    [A^2.s].
    """
    _, gradient, normal = Quadratic.of(at)
    of_stretch = Quadratic(at.point, gradient / noise, normal / noise).with_ridge()
    faults, rows = slice(0, N_FAULTS), knowledge.rows()
    of_stretch.hessian[faults, faults] += rows.T @ rows
    of_stretch.gradient[faults] += rows.T @ (rows @ (at.point[faults] - knowledge.point))
    return of_stretch.lowest()
