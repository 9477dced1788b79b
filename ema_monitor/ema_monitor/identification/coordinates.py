"""What a point of the unit box means: a fault vector and the motor's place in its play."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, HIGHEST, N_FAULTS

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
            Points of the box, ``(m, d)``; an eccentricity beyond 1 is drawn back to 1.
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
