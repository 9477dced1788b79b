"""What the columns of a window say of each other, whatever moves the actuator (M27)."""

import math
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ema_monitor.calibration.calibration import Calibration
from ema_monitor.model.deviations import COLUMNS
from ema_monitor.model.readings import TRAVEL, law_slopes
from ema_monitor.windows.control_law import law_offset
from ema_monitor.windows.travel import travel_ratio
from ema_monitor.windows.window import Window

_ODD = 3.0


class Relations(NamedTuple):
    """Relations of the columns, which are linear in their readings; there may be none.

    Attributes
    ----------
    slopes
        Derivatives by deviations in the order of `COLUMNS`, ``(k, 28)``.
    values, sigmas
        By how much the window differs from a healthy one, and the standard deviations, ``(k,)``.
    """

    slopes: NDArray[np.float64]
    values: NDArray[np.float64]
    sigmas: NDArray[np.float64]

    @classmethod
    def none(cls) -> Self:
        """Return no relation."""
        return cls(np.zeros((0, len(COLUMNS))), np.zeros(0), np.zeros(0))

    @classmethod
    def of(cls, window: Window, calibration: Calibration) -> Self:
        """Return those of a window, as far as they can be judged.

        Parameters
        ----------
        window, calibration
            The window, and the calibration of its unit, which knows what they say when healthy.
        """
        parameters = calibration.parameters
        found = []
        travel = travel_ratio(window, parameters)
        if travel is not None and not math.isnan(calibration.travel_ratio):
            found.append((TRAVEL, travel.value / calibration.travel_ratio - 1.0, travel.sigma))
        law = law_offset(window, parameters)
        if law is not None and not math.isnan(calibration.law_offset):
            slopes = law_slopes(parameters)
            found.append((slopes, law.value - calibration.law_offset, law.sigma))
        if not found:
            return cls.none()
        return cls(*(np.array(rows) for rows in zip(*found, strict=True)))

    def left(self, columns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what readings leave of them, ``(m, k)``, in sigma of each.

        Parameters
        ----------
        columns
            Deviations in the order of `COLUMNS`, ``(m, 28)``.
        """
        return (columns @ self.slopes.T - self.values) / self.sigmas

    @property
    def are_healthy(self) -> bool:
        """Whether the columns agree as when healthy."""
        return bool(np.all(np.abs(self.values) < _ODD * self.sigmas))
