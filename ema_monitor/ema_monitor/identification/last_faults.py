"""Where the search in an actuator's next window begins: at what its last valid estimate says."""

import numpy as np
from numpy.typing import NDArray

from ema_core.description import ActuatorDescription
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate


class LastFaults:
    """Remembers the faults of each actuator's last valid estimate.

    It depends on the windows and their order alone: live, in a replay and offline, the same
    windows begin at the same faults. Under another description or calibration than those of the
    last valid estimate there is none to begin at.
    """

    def __init__(self) -> None:
        self._last: dict[str, tuple[ActuatorDescription, str, NDArray[np.float64]]] = {}

    def clear(self) -> None:
        """Forget all."""
        self._last.clear()

    def of(
        self, description: ActuatorDescription, calibration: Calibration | str
    ) -> NDArray[np.float64] | None:
        """Return the faults to begin at, ``(8,)``; None when there are none.

        Parameters
        ----------
        description
            The actuator.
        calibration
            What its next window is identified with, or why there is nothing.
        """
        described, calibration_id, faults = self._last.get(
            description.actuator_id, (None, "", None)
        )
        if isinstance(calibration, str) or described != description:
            return None
        return faults if calibration_id == calibration.calibration_id else None

    def record(self, description: ActuatorDescription, estimate: Estimate) -> None:
        """Remember an estimate if it is valid.

        Parameters
        ----------
        description
            The actuator.
        estimate
            What was found in its latest window.
        """
        if estimate.valid:
            self._last[description.actuator_id] = (
                description,
                estimate.calibration_id,
                estimate.faults,
            )
