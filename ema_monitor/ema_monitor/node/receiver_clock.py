"""The time of a node that receives: by the clock of stamps, and by a clock that never goes back."""

import time
from collections.abc import Callable
from typing import Final, NamedTuple

_LEAST_STEP_NS: Final = 1_000_000_000
"""Smallest backward step of the clock that is noticed [ns]; adjustments by NTP are slower."""


class Moment(NamedTuple):
    """A time.

    Attributes
    ----------
    clock_ns
        By the clock of stamps [ns].
    steady_ns
        By a clock that never goes back [ns]; 0 as long as simulated time has not begun.
    """

    clock_ns: int
    steady_ns: int


class ReceiverClock:
    """Reads the clock of a node beside a steady one, and notices backward steps.

    In simulated time the steady clock is the simulated one without its backward steps.

    Parameters
    ----------
    read_ns
        Returns the time of the clock of stamps [ns].
    is_simulated
        Whether that is simulated time.
    steady_ns
        Returns the time of a steady clock [ns].
    """

    def __init__(
        self,
        read_ns: Callable[[], int],
        *,
        is_simulated: bool = False,
        steady_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._read_ns, self._steady_ns = read_ns, steady_ns
        self.is_simulated = is_simulated
        self._offset_ns: int | None = None

    def read(self) -> tuple[Moment, int]:
        """Return the time, and by how much the clock has stepped back since the last call [ns]."""
        clock_ns = self._read_ns()
        if self.is_simulated:
            return self._read_simulated(clock_ns)
        steady_ns = self._steady_ns()
        offset_ns = clock_ns - steady_ns
        before_ns = offset_ns if self._offset_ns is None else self._offset_ns
        self._offset_ns = offset_ns
        back_ns = before_ns - offset_ns
        return Moment(clock_ns, steady_ns), back_ns if back_ns >= _LEAST_STEP_NS else 0

    def _read_simulated(self, clock_ns: int) -> tuple[Moment, int]:
        # Here the offset is the sum of the backward steps, and the latest time is kept beside it.
        before_ns, offset_ns = self._simulated
        back_ns = max(before_ns - clock_ns, 0)
        self._simulated = clock_ns, offset_ns + back_ns
        steady_ns = clock_ns + self._simulated[1] if clock_ns or self._simulated[1] else 0
        return Moment(clock_ns, steady_ns), back_ns if back_ns >= _LEAST_STEP_NS else 0

    _simulated: tuple[int, int] = 0, 0
