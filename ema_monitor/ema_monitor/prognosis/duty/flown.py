"""What was flown between two tests: travel by load, and hours by temperature of the winding."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ema_core.quantity import is_finite_number

LOAD_CLASSES: Final = 10
"""Classes of the load, the magnitude of the current over its limit: a tenth each, the last open."""

LEAST_RISE: Final = -100.0
CLASS_KELVIN: Final = 10.0
WINDING_CLASSES: Final = 32
"""Classes of the rise of the winding over its calibrated state: 10 K each from -100 K on, first and
last open."""


class Share(NamedTuple):
    """What belongs to one class.

    Attributes
    ----------
    number
        Number of the class.
    amount
        Travel [rad], or hours [h].
    mean
        Mean load [-], or rise of temperature [K], of it.
    """

    number: int
    amount: float
    mean: float


Spectrum = tuple[Share, ...]
"""Classes with anything in them, in ascending order."""


def spectrum(amount: NDArray[np.float64], moment: NDArray[np.float64]) -> Spectrum:
    """Return a spectrum of what is in each class, and the sum of amount times value, ``(n,)``."""
    return tuple(
        Share(int(i), float(amount[i]), float(moment[i] / amount[i]))
        for i in np.flatnonzero(amount > 0.0)
    )


def _sum(one: Spectrum, other: Spectrum) -> Spectrum:
    by_number: dict[int, Share] = {share.number: share for share in one}
    for share in other:
        if (known := by_number.get(share.number)) is not None:
            total = known.amount + share.amount
            mean = (known.amount * known.mean + share.amount * share.mean) / total
            share = Share(share.number, total, mean)
        by_number[share.number] = share
    return tuple(by_number[number] for number in sorted(by_number))


@dataclass(frozen=True, slots=True)
class FlownDuty:
    """What telemetry and topics say of the use of a unit over some time.

    Attributes
    ----------
    hours
        Time that telemetry covers [h].
    travel
        Travel of the user shaft by load [rad].
    winding
        Hours by rise of the winding over its calibrated state, as far as that is known [h].
    """

    hours: float = 0.0
    travel: Spectrum = ()
    winding: Spectrum = ()

    def __add__(self, other: "FlownDuty") -> "FlownDuty":
        return FlownDuty(
            self.hours + other.hours,
            _sum(self.travel, other.travel),
            _sum(self.winding, other.winding),
        )

    @property
    def travelled(self) -> float:
        """Travelled angle of the user shaft [rad]."""
        return float(sum(share.amount for share in self.travel))

    def as_record(self) -> dict[str, Any]:
        """Return it in plain values, for ``of_record``."""
        return {
            "hours": self.hours,
            "travel": [list(share) for share in self.travel],
            "winding": [list(share) for share in self.winding],
        }

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> Self:
        """Return what ``as_record`` was made of.

        Raises
        ------
        ValueError, KeyError, TypeError
            When it is none.
        """
        return cls(
            _amount(record["hours"]),
            _spectrum(record["travel"], LOAD_CLASSES),
            _spectrum(record["winding"], WINDING_CLASSES),
        )


def together(one: FlownDuty | None, other: FlownDuty | None) -> FlownDuty | None:
    """Return two duties as one; None where neither is known."""
    if one is None or other is None:
        return one or other
    return one + other


def _spectrum(rows: Iterable[Any], classes: int) -> Spectrum:
    found = []
    for number, amount, mean in rows:
        if number not in range(classes) or not is_finite_number(mean):
            raise ValueError(f"class {number!r} of mean {mean!r}: expected one of {classes}")
        found.append(Share(int(number), _amount(amount), float(mean)))
    return tuple(found)


def _amount(value: Any) -> float:
    if not is_finite_number(value) or value < 0.0:
        raise ValueError(f"{value!r} of duty: expected a number of at least 0")
    return float(value)
