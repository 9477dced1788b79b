"""What a stretch of ordinary motion can tell, before it is searched (M28)."""

from typing import Final, NamedTuple, Self

import numpy as np

from ema_core.arrays import Array
from ema_core.faults import N_FAULTS
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.knowledge import NUISANCE, Knowledge, information
from ema_monitor.identification.objective import Objective
from ema_monitor.model.measured import expected_causes
from ema_monitor.optimizers.gauss_newton import LineSearch, Problem, Stopping, descend
from ema_monitor.optimizers.linear_model import Linearisation, Quadratic
from ema_monitor.windows.band import band_limited
from ema_monitor.windows.window import Window

_LOADS: Final = 17
# A preview is a guess at the cost of a few evaluations: two steps after seventeen loads.
_SHARES: Final = ((1.0, 0.6, 0.3),)
_STOPPING: Final = Stopping(iterations=2)
_NEAR: Final = 0.05
_REPEATED: Final = 0.8


class StretchMotion(NamedTuple):
    """Where a stretch went, a value a millisecond.

    Attributes
    ----------
    states
        Position and speed, ``(n, 2)`` [rad, rad/s].
    scale
        Travel and largest speed, ``(2,)`` [rad, rad/s].
    load
        Load over the largest that is possible [-].
    """

    states: Array
    scale: Array
    load: float

    @classmethod
    def of(cls, stretch: Window, load: float) -> Self:
        """Return that of a stretch under a load."""
        telemetry = stretch.telemetry
        speed = telemetry.speed if len(telemetry.speed) else np.gradient(telemetry.position)
        rows = band_limited(np.array([telemetry.position, speed]), stretch.sample_period)
        scale = np.array([np.ptp(rows[0]), np.max(np.abs(rows[1]))])
        return cls(rows.T, np.maximum(scale, 1e-12), load)

    def repeats(self, other: Self) -> bool:
        """Return whether it went where another one did before: the model errs there as it did."""
        if abs(self.load - other.load) > _NEAR:
            return False
        scale = np.maximum(self.scale, other.scale)
        apart = np.abs(self.states[:, None] - other.states[None]) / scale
        near = np.any(np.all(apart <= _NEAR, axis=2), axis=1)
        return bool(np.mean(near) >= _REPEATED)


class Preview(NamedTuple):
    """What a stretch can tell of the faults.

    Attributes
    ----------
    load
        The load that explains the stretch best, in the unit box.
    misfit
        How many times larger than when healthy its residuals are, by the linear model, where what
        is known explains it best.
    gained
        Its information on the faults, ``(8, 8)``, with the noise of a healthy window.
    motion
        Where it went.
    """

    load: float
    misfit: float
    gained: Array
    motion: StretchMotion

    @classmethod
    def of(cls, stretch: Window, calibration: Calibration, known: Knowledge, faults: Array) -> Self:
        """Return that of a stretch.

        What moves the motor shows what a stretch can tell: it is judged at ``faults``, ``(8,)``,
        under the load that explains it best.
        """
        suspects = expected_causes(calibration.parameters, stretch)
        [load] = [one for one in suspects if one.name == NUISANCE]
        objective = Objective(stretch, calibration, causes=(load,))
        points = np.tile(objective.encode(faults), (_LOADS, 1))
        points[:, -1] = np.linspace(0.0, 1.0, _LOADS)
        search = LineSearch(lambda at: _explained(at, known, objective.noise), _SHARES)
        problem = Problem(objective.residuals, objective.linearise)
        descent = descend(problem, points, search, _STOPPING)
        point = descent.point
        return cls(
            float(point[-1]),
            objective.misfit(descent.residuals),
            information(objective.linearise(point).jacobian, objective.noise),
            StretchMotion.of(stretch, float(objective.causes(point)[0]) / load.reach),
        )


def _explained(at: Linearisation, known: Knowledge, noise: float) -> Array:
    """Return the point, ``(d,)``, that explains a stretch best, by the linear model of it alone.

    ``noise`` is the variance of an effective residual.
    """
    _, gradient, normal = Quadratic.of(at)
    of_stretch = Quadratic(at.point, gradient / noise, normal / noise).with_ridge()
    faults, rows = slice(0, N_FAULTS), known.rows()
    of_stretch.hessian[faults, faults] += rows.T @ rows
    of_stretch.gradient[faults] += rows.T @ (rows @ (at.point[faults] - known.point))
    return of_stretch.lowest()
