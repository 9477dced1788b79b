"""Mechanisms of growth of unknown law, with their prior probabilities."""

from dataclasses import dataclass
from typing import Final

from ema_monitor.prognosis.growth.laws import TRACKED_LAWS


@dataclass(frozen=True)
class Mechanisms:
    """Mechanisms of growth whose law is unknown, each with its prior."""

    laws: tuple[str, ...] = tuple(TRACKED_LAWS)
    """Names of the laws that a fault may follow."""
    wandering: float = 0.7
    """Probability that the rate of a component that grows wanders (P6a) [-]."""
    wave: float = 0.1
    """Probability of a wave (P6c) [-]."""
    changed: tuple[float, float] = (0.4, 15.0)
    """Range of the factor of a permanent change of rate in the future (P10), log-uniform [-]."""


MECHANISMS: Final = Mechanisms()
"""The mechanisms that the tracker assumes."""
