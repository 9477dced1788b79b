"""What an optimizer minimises: the distance of the model from a window, over the unit box."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, HIGHEST, N_FAULTS, healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.fitness import DEFAULT_FITNESS, FITNESS
from ema_monitor.model.monitor_model import Response
from ema_monitor.optimizers.least_squares import DIFFERENCE
from ema_monitor.windows.window import Window

_PLANE = [ECCENTRICITY, ECCENTRICITY_PHASE]


@dataclass(frozen=True)
class Coordinates:
    """Map between points of the unit box and fault vectors.

    Attributes
    ----------
    play
        Where in its play the motor stands at the window's start [half-widths]; None when it is
        unknown, then it is searched for as a ninth component.
    cartesian
        Whether eccentricity and phase are searched for as ``zeta cos(phi)`` and ``zeta sin(phi)``,
        which are smooth at zero eccentricity, where the phase is undefined.
    """

    play: float | None
    cartesian: bool

    def decode(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return fault vectors, ``(m, 8)``, and places in the play, ``(m,)``.

        Parameters
        ----------
        points
            Points of the box, ``(m, d)``; an eccentricity beyond 1 is reduced to 1.
        """
        faults = points[:, :N_FAULTS].copy()
        if self.cartesian:
            x, y = (2.0 * points[:, _PLANE] - 1.0).T
            faults[:, ECCENTRICITY] = np.minimum(np.hypot(x, y), 1.0)
            faults[:, ECCENTRICITY_PHASE] = (np.arctan2(y, x) / np.pi + 1.0) / 2.0
        play = np.full(len(points), self.play) if self.play is not None else 2 * points[:, -1] - 1.0
        return np.minimum(faults, HIGHEST), play

    def encode(self, faults: NDArray[np.float64], play: float = 0.0) -> NDArray[np.float64]:
        """Return the point, ``(d,)``, of a fault vector, ``(8,)``, and a place in the play."""
        point = faults.copy()
        if self.cartesian:
            zeta, phi = faults[ECCENTRICITY], (2.0 * faults[ECCENTRICITY_PHASE] - 1.0) * np.pi
            point[_PLANE] = (1.0 + zeta * np.array([np.cos(phi), np.sin(phi)])) / 2.0
        return point if self.play is not None else np.append(point, (play + 1.0) / 2.0)


class Linearisation(NamedTuple):
    """Residuals, ``(r,)``, and their derivatives, ``(r, d)``, at a point, ``(d,)``."""

    point: NDArray[np.float64]
    residuals: NDArray[np.float64]
    jacobian: NDArray[np.float64]

    @property
    def cost(self) -> float:
        """Sum of squares of the residuals [A^2.s]."""
        return float(self.residuals @ self.residuals)


class Objective:
    """Residuals of a calibrated model in a window, as a function on the unit box.

    Parameters
    ----------
    window
        The window.
    calibration
        Calibration of the model; it has as many samples as the window.
    fitness
        Name of the distance that is minimised.
    cartesian
        Whether eccentricity and phase are searched for as ``zeta cos(phi)``, ``zeta sin(phi)``.

    Attributes
    ----------
    healthy
        The healthy point, ``(d,)``.
    good_cost
        Highest cost at which an optimum is accepted as the lowest [A^2.s].
    """

    def __init__(
        self,
        window: Window,
        calibration: Calibration,
        fitness: str = DEFAULT_FITNESS,
        *,
        cartesian: bool = True,
    ) -> None:
        self._window = window
        self._model = calibration.model()
        self._corrections = calibration.corrections(calibration.alignment(window))
        self._fitness = FITNESS[fitness](window, calibration)
        self._coordinates = Coordinates(window.play, cartesian=cartesian)
        self.healthy = self._coordinates.encode(healthy_faults())
        self.good_cost = self._fitness.good_cost

    @property
    def dimension(self) -> int:
        """Number of components of a point: eight, and the place in the play where unknown."""
        return len(self.healthy)

    @property
    def spacing(self) -> float:
        """Time between two residuals [s]."""
        return self._fitness.spacing

    @property
    def linearisation_evaluations(self) -> int:
        """Number of model evaluations that `linearise` takes."""
        return 2 * self.dimension + 1

    def encode(self, faults: NDArray[np.float64], play: float = 0.0) -> NDArray[np.float64]:
        """Return the point of a fault vector, ``(8,)``, and a place in the play."""
        return self._coordinates.encode(faults, play)

    def decode(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return fault vectors, ``(m, 8)``, and places in the play, ``(m,)``, of points."""
        return self._coordinates.decode(points)

    def expect(self, faults: NDArray[np.float64], play: NDArray[np.float64]) -> Response:
        """Return the calibrated response to faults, ``(m, 8)``, and play positions, ``(m,)``."""
        return self._model.respond(self._window, faults, play, self._corrections)

    def residuals(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the residuals at points, ``(m, r)`` [A.s^(1/2)]; the cost is the sum of squares.

        Parameters
        ----------
        points
            Points of the unit box, ``(m, d)``.
        """
        return self._fitness.residuals(self.expect(*self.decode(points)))

    def linearise(self, point: NDArray[np.float64]) -> Linearisation:
        """Return residuals and their central differences at a point, ``(d,)``."""
        d = len(point)
        below = np.maximum(point - DIFFERENCE * np.eye(d), 0.0)
        above = np.minimum(point + DIFFERENCE * np.eye(d), 1.0)
        rows = self.residuals(np.concatenate([point[None], below, above]))
        at_point, at_below, at_above = np.split(rows, [1, 1 + d])
        steps = np.sum(above - below, axis=1)
        return Linearisation(point, at_point[0], (at_above - at_below).T / steps)
