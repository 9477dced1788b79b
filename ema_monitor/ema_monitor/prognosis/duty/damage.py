"""Recorded duty and its damage: wear from load and travel, ageing from temperature."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ema_core.arrays import Array
from ema_core.faults import FAULTS
from ema_core.quantity import Checked, quantity, text

LOAD_CLASSES: Final = 10
"""Classes of the load, the magnitude of the current over its limit: a tenth each, the last open."""

LEAST_RISE: Final = -100.0
CLASS_KELVIN: Final = 10.0
WINDING_CLASSES: Final = 32
"""Classes of the rise of the winding over its calibrated state: 10 K each from -100 K on, first and
last open."""

BOLTZMANN: Final = 8.617333e-5
"""Boltzmann's constant [eV/K]."""

_ZERO_CELSIUS: Final = 273.15
_REFERENCE_K: Final = 373.15

MEASURE: Final = np.array([fault.damage for fault in FAULTS if fault.damage is not None])
"""Measure of each component, a ``Damage``, ``(7,)``."""


@dataclass(frozen=True, slots=True, eq=False)
class FlownDuty:
    """Usage of a unit over a period, from telemetry and topics; zero by default."""

    hours: float = 0.0
    """Time that telemetry covers [h]."""
    travel: Array = field(default_factory=lambda: np.zeros((2, LOAD_CLASSES)))
    """Travel of the user shaft [rad], and the sum of travel times load [rad], by class of the load,
    ``(2, LOAD_CLASSES)``."""
    winding: Array = field(default_factory=lambda: np.zeros((2, WINDING_CLASSES)))
    """Hours [h], and the sum of hours times rise [h K], by class of the rise of the winding over
    its calibrated state, as far as that is known, ``(2, WINDING_CLASSES)``."""

    def __add__(self, other: "FlownDuty") -> "FlownDuty":
        return FlownDuty(
            self.hours + other.hours, self.travel + other.travel, self.winding + other.winding
        )


NOTHING_FLOWN: Final = FlownDuty()
"""An unknown duty."""


@dataclass(frozen=True)
class DamageSettings(Checked):
    """Relation of damage to duty (P23)."""

    growth_per: str = text(
        "damage",
        "what growth is counted by: damage where the duty is known, hours else; or always hours",
        ("damage", "hours"),
    )
    wear_exponent: float = quantity(
        1.0, "-", 0.5, 10.0, "power of the load by which travel wears: 1 sliding, 3 rolling contact"
    )
    activation_energy: float = quantity(
        1.0, "eV", 0.1, 3.0, "of the ageing of the insulation; 1 halves its life by 10 K at 130 °C"
    )
    winding_temperature: float = quantity(
        20.0,
        "degC",
        -60.0,
        250.0,
        "temperature of the winding in the calibrated state, from which measured rises count",
    )
    least_coverage: float = quantity(
        0.2, "-", 1e-6, 1.0, "share of the service hours that telemetry has to cover"
    )

    def wear(self, travel: ArrayLike, load: ArrayLike) -> float:
        """Return the wear by travels [rad] at loads: the sum of load^p times travel [rad].

        The power is 1 for sliding contacts (Archard 1953), and 3 for the life of rolling contacts
        (ISO 281, ISO 3408-5).
        """
        return float(np.sum(np.asarray(travel) * np.asarray(load) ** self.wear_exponent))

    def ageing(self, hours: ArrayLike, celsius: ArrayLike) -> float:
        """Return the ageing in hours at winding temperatures, as equivalent hours at 100 degC [h].

        Arrhenius law exp(-E/kT), T in kelvin (Dakin 1948).
        """
        kelvin = np.maximum(np.asarray(celsius) + _ZERO_CELSIUS, 1.0)
        away = self.activation_energy / BOLTZMANN * (1.0 / _REFERENCE_K - 1.0 / kelvin)
        return float(np.sum(np.asarray(hours) * np.exp(away)))

    def damage(self, flown: FlownDuty) -> Array:
        """Return hours of telemetry, travel, wear, hours of known temperature and ageing."""
        (travel, load), (hours, rise) = (
            (amount, moment / np.where(amount > 0.0, amount, 1.0))
            for amount, moment in (flown.travel, flown.winding)
        )
        wear = self.wear(travel, load)
        ageing = self.ageing(hours, self.winding_temperature + rise)
        return np.array([flown.hours, travel.sum(), wear, hours.sum(), ageing])
