"""The duty to come: how many hours of service an hour of growth takes."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS


@dataclass(frozen=True, eq=False)
class FutureDuty:
    """Hours of growth in an hour of service to come, of each component, on one or several paths.

    Attributes
    ----------
    factor
        Growth of the faults beside what the paths say of it [-].
    present, later
        Hours of growth in an hour at first, and once the present duty has ended, ``(7, p)`` [-].
    lasting
        Hours of service that the present duty lasts on each path, ``(p,)`` [h].
    words
        What is assumed, beside the factor.

    Raises
    ------
    ValueError
        When the factor is not a number above 0.
    """

    factor: float
    present: NDArray[np.float64]
    later: NDArray[np.float64]
    lasting: NDArray[np.float64]
    words: str = "future use as in the past"

    def __post_init__(self) -> None:
        if not 0.0 < self.factor < np.inf:
            raise ValueError(f"duty = {self.factor!r}: expected a number above 0")

    @classmethod
    def of(cls, duty: "FutureDuty | float") -> "FutureDuty":
        """Return a duty as it is, or that of a factor alone."""
        return duty if isinstance(duty, FutureDuty) else cls.steady(duty)

    @classmethod
    def steady(cls, factor: float = 1.0) -> Self:
        """Return that of a steady use as in the past, but for a factor of all growth."""
        rate = np.ones((len(COMPONENTS), 1))
        return cls(factor, rate, rate, np.full(1, np.inf))

    def __str__(self) -> str:
        if self.factor == 1.0:
            return self.words
        faster = f"faults grow {self.factor:g} times as fast in each future flight hour as "
        own = "in the past" if self.words == "future use as in the past" else f"by {self.words}"
        return faster + own

    def hours_of(self, own: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the hours of service in which some hours of growth pass [h], ``(7, n)``.

        Parameters
        ----------
        own
            Hours of growth [h], ``(7, n)``; those of a number are on the same path in all.
        """
        path = np.arange(own.shape[1]) % self.lasting.size
        own, lasting = own / self.factor, self.lasting[path]
        with np.errstate(divide="ignore", invalid="ignore"):
            at_first = np.where(own > 0.0, own / self.present[:, path], 0.0)
            more = own - lasting * self.present[:, path]
            after = lasting + more / self.later[:, path]
        return np.where(at_first <= lasting, at_first, after)

    def own_hours(self, hours: NDArray[np.float64], n: int) -> NDArray[np.float64]:
        """Return the hours of growth after some hours of service [h].

        Parameters
        ----------
        hours
            Ascending hours of service from now on [h], ``(m,)``.
        n
            Number of samples.

        Returns
        -------
        numpy.ndarray
            In a form that broadcasts to ``(m, 7, n)``.
        """
        path = np.arange(n) % self.lasting.size
        at_first = np.minimum(hours[:, None, None], self.lasting[path])
        after = hours[:, None, None] - at_first
        return self.factor * (at_first * self.present[:, path] + after * self.later[:, path])
