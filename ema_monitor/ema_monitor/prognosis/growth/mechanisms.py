"""What growth of unknown law may do beside following a steady law, and how probable that is."""

from dataclasses import dataclass
from typing import Final

from ema_monitor.prognosis.growth.laws import LAWS


@dataclass(frozen=True)
class Mechanisms:
    """Mechanisms of growth whose law is unknown, each with its prior.

    Attributes
    ----------
    laws
        Names of the laws that a fault may follow.
    wandering
        Probability that the rate of a component that grows wanders (P6a) [-].
    wave
        Probability of a wave (P6c) [-].
    changed
        Range of the factor by which the rate changes for good in the future (P10), log-uniform [-].
    """

    laws: tuple[str, ...] = tuple(LAWS)
    wandering: float = 0.7
    wave: float = 0.1
    changed: tuple[float, float] = (0.4, 15.0)


MECHANISMS: Final = Mechanisms()
"""The mechanisms that the tracker assumes."""
