"""Actuators that a test is judged on: with single faults, and with several at once."""

from collections.abc import Mapping
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from ema_core.commands import Command
from ema_core.faults import (
    ECCENTRICITY,
    ECCENTRICITY_PHASE,
    FAULTS,
    SHORT_CIRCUITS,
    healthy_faults,
)
from ema_monitor.windows.window import Window

SHARE: Final = 0.5
"""Size of a single fault over its limit [-]."""

N_COMBINED: Final = len(SHORT_CIRCUITS)
"""How many actuators have several faults at once."""

_SHARES: Final = (0.25, 0.6)
_PHASE: Final = 0.7
_SEED: Final = 2018


class Recorder(Protocol):
    """Records windows of an actuator, a simulated one as a rule."""

    def __call__(
        self,
        command: Command,
        faults: NDArray[np.float64],
        cycles: int,
        causes: Mapping[str, float],
    ) -> list[Window]:
        """Return a window from each of some test cycles.

        Parameters
        ----------
        command
            Command of a cycle.
        faults
            Fault vector, ``(8,)``.
        cycles
            How many windows.
        causes
            Hidden causes by name, in the units of the registry.

        Raises
        ------
        ValueError
            When a cycle has no window.
        """
        ...


def single_faults() -> dict[str, NDArray[np.float64]]:
    """Return an actuator with each fault alone, half-way to its limit, by the fault's name."""
    result = {}
    for i, fault in enumerate(FAULTS):
        if fault.limit is not None:
            k = healthy_faults()
            k[i] += SHARE * fault.limit
            k[ECCENTRICITY_PHASE] = _PHASE
            result[fault.name] = k
    return result


def combined_faults(number: int) -> NDArray[np.float64]:
    """Return an actuator with several faults at once, a quarter to six tenths of their limits each.

    One phase is shorted: short circuits of all phases cannot be told from a weak magnet.

    Parameters
    ----------
    number
        Which of the ``N_COMBINED``; the gain of every other one is too low.
    """
    rng = np.random.default_rng([_SEED, number])
    k = healthy_faults()
    for i, fault in enumerate(FAULTS):
        share = rng.uniform(*_SHARES)
        if fault.limit is not None and (i not in SHORT_CIRCUITS or i == SHORT_CIRCUITS[number]):
            k[i] += (-1.0 if fault.is_two_sided and number % 2 else 1.0) * share * fault.limit
    k[ECCENTRICITY_PHASE] = rng.random()
    return k


def present(faults: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which components differ from healthy, ``(8,)``; the direction with the amount."""
    differs = faults != healthy_faults()
    differs[ECCENTRICITY_PHASE] = differs[ECCENTRICITY]
    return differs
