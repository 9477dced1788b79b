# SPDX-License-Identifier: Apache-2.0
"""Growth mechanisms considered for faults of unknown law, with their priors."""

from dataclasses import dataclass
from typing import Final

from ema_monitor.prognosis.growth.laws import TRACKED_LAWS


@dataclass(frozen=True)
class Mechanisms:
    """Growth mechanisms considered for faults of unknown law, with their prior probabilities."""

    laws: tuple[str, ...] = tuple(TRACKED_LAWS)
    """Names of the candidate laws."""
    wandering: float = 0.7
    """Probability that the rate of a growing component wanders (P6a) [-]."""
    wave: float = 0.1
    """Probability of a wave (P6c) [-]."""
    changed: tuple[float, float] = (0.4, 15.0)
    """Range of the log-uniform factor by which the rate may change permanently (P10) [-]."""


MECHANISMS: Final = Mechanisms()
"""Default mechanisms."""
