"""The duty to come: how many hours of service an hour of growth takes."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS


@dataclass(frozen=True, eq=False)
class FutureDuty:
    """Hours of growth in the service to come, of each component, on one or several paths.

    Attributes
    ----------
    factor
        Growth of the faults beside what the paths say of it [-].
    hours
        Hours of service in the steps of each path, ``(p, s)`` [h]; a path goes on as in the mean
        of its steps.
    growth
        Hours of growth in them, ``(7, p, s)`` [h].
    words
        What is assumed, beside the factor.

    Raises
    ------
    ValueError
        When the factor is not a number above 0.
    """

    factor: float
    hours: NDArray[np.float64]
    growth: NDArray[np.float64]
    words: str = "future use as in the past"

    def __post_init__(self) -> None:
        if not 0.0 < self.factor < np.inf:
            raise ValueError(f"duty = {self.factor!r}: expected a number above 0")

    @classmethod
    def of(cls, duty: "FutureDuty | float") -> "FutureDuty":
        """Return a duty as it is, or that of a factor alone."""
        if isinstance(duty, FutureDuty):
            return duty
        return cls.steady(duty)

    @classmethod
    def steady(cls, factor: float = 1.0, words: str = "future use as in the past") -> Self:
        """Return that of a steady use as in the past, but for a factor of all growth."""
        return cls(factor, np.ones((1, 1)), np.ones((len(COMPONENTS), 1, 1)), words)

    def __str__(self) -> str:
        if self.factor == 1.0:
            return self.words
        faster = f"faults grow {self.factor:g} times as fast in each future flight hour as "
        own = "in the past" if self.words == "future use as in the past" else f"by {self.words}"
        return faster + own

    @property
    def rates(self) -> NDArray[np.float64]:
        """Mean hours of growth in an hour of service, without the factor, ``(7,)`` [-]."""
        return self.growth.sum(axis=(1, 2)) / self.hours.sum()

    def hours_of(self, own: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the hours of service in which some hours of growth pass [h], ``(7, n)``.

        Parameters
        ----------
        own
            Hours of growth [h], ``(7, n)``; those of a number are on the same path in all.
        """
        own = own / self.factor
        if self._is_as_past:
            return own
        path = np.arange(own.shape[1]) % len(self.hours)
        return _passed(own, self._after(self.growth)[:, path], self._after(self.hours)[path])

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
        if self._is_as_past:
            return (hours * self.factor)[:, None, None]
        path = np.arange(n) % len(self.hours)
        own = _passed(hours[:, None, None], self._after(self.hours), self._after(self.growth))
        return self.factor * own[..., path]

    @property
    def _is_as_past(self) -> bool:
        return self.hours.size == 1 and bool(np.all(self.growth == self.hours))

    @staticmethod
    def _after(steps: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what has passed before each step and after the last, ``(..., s + 1)``."""
        return np.concatenate([np.zeros((*steps.shape[:-1], 1)), np.cumsum(steps, -1)], axis=-1)


def _passed(
    given: NDArray[np.float64], known: NDArray[np.float64], wanted: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Interpolate between the steps of paths, and go on behind them at the mean of each.

    Parameters
    ----------
    given
        What has passed of the one quantity, at least 0, ``(...)``.
    known, wanted
        What has passed of it, and of the other one, before and after the steps, ``(..., s + 1)``.
    """
    steps = known.shape[-1] - 1
    step = np.sum(known[..., 1:] < given[..., None], axis=-1)
    known, wanted, _ = np.broadcast_arrays(known, wanted, step[..., None])
    before = np.minimum(step, steps - 1)[..., None]
    is_behind = step == steps

    def ends(of: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        first = np.where(is_behind, 0.0, np.take_along_axis(of, before, -1)[..., 0])
        last = np.where(is_behind, of[..., -1], np.take_along_axis(of, before + 1, -1)[..., 0])
        return first, last

    (from_known, to_known), (from_wanted, to_wanted) = ends(known), ends(wanted)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (given - from_known) / (to_known - from_known)
        passed = from_wanted + share * (to_wanted - from_wanted)
    return np.where(given <= 0.0, 0.0, passed)
