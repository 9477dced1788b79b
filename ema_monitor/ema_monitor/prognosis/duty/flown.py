"""What was flown between two tests: travel by load, and hours by temperature of the winding."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

LOAD_CLASSES: Final = 10
"""Classes of the load, the magnitude of the current over its limit: a tenth each, the last open."""

LEAST_RISE: Final = -100.0
CLASS_KELVIN: Final = 10.0
WINDING_CLASSES: Final = 32
"""Classes of the rise of the winding over its calibrated state: 10 K each from -100 K on, first and
last open."""


@dataclass(frozen=True, slots=True, eq=False)
class FlownDuty:
    """What telemetry and topics say of the use of a unit over some time.

    Attributes
    ----------
    hours
        Time that telemetry covers [h].
    travel
        Travel of the user shaft [rad], and the sum of travel times load [rad], by class of the
        load, ``(2, LOAD_CLASSES)``.
    winding
        Hours [h], and the sum of hours times rise [h K], by class of the rise of the winding over
        its calibrated state, as far as that is known, ``(2, WINDING_CLASSES)``.
    """

    hours: float = 0.0
    travel: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2, LOAD_CLASSES)))
    winding: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2, WINDING_CLASSES)))

    def __add__(self, other: "FlownDuty") -> "FlownDuty":
        return FlownDuty(
            self.hours + other.hours, self.travel + other.travel, self.winding + other.winding
        )

    def as_record(self) -> dict[str, Any]:
        """Return it in plain values, for ``of_record``."""
        return {
            "hours": self.hours,
            "travel": self.travel.tolist(),
            "winding": self.winding.tolist(),
        }

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> Self:
        """Return what ``as_record`` was made of."""
        return cls(record["hours"], np.array(record["travel"]), np.array(record["winding"]))


def together(one: FlownDuty | None, other: FlownDuty | None) -> FlownDuty | None:
    """Return two duties as one; None where neither is known."""
    if one is None or other is None:
        return one or other
    return one + other
