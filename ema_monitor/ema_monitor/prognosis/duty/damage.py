# SPDX-License-Identifier: Apache-2.0
"""Recorded duty and its damage: wear from load and travel, ageing from temperature."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ema_core.arrays import Array
from ema_core.faults import FAULTS
from ema_core.quantity import Checked, quantity, text

LOAD_CLASSES: Final = 10
"""Number of load classes. The load is the ratio of the current magnitude to its limit; each class
covers a tenth, and the last is open."""

LEAST_RISE: Final = -100.0
CLASS_KELVIN: Final = 10.0
WINDING_CLASSES: Final = 32
"""Number of classes of the winding's temperature rise over the calibrated state: 10 K each from
-100 K on; the first and the last are open."""

BOLTZMANN: Final = 8.617333e-5
"""Boltzmann's constant [eV/K]."""

_ZERO_CELSIUS: Final = 273.15
_REFERENCE_K: Final = 373.15

MEASURE: Final = np.array([fault.damage for fault in FAULTS if fault.damage is not None])
"""Damage measure of each component, a ``Damage``, ``(7,)``."""


@dataclass(frozen=True, slots=True, eq=False)
class FlownDuty:
    """Duty of a unit over a period, from telemetry and topics; zero by default."""

    hours: float = 0.0
    """Time that telemetry covers [h]."""
    travel: Array = field(default_factory=lambda: np.zeros((2, LOAD_CLASSES)))
    """Travel of the user shaft [rad], and sum of travel times load [rad], by load class, ``(2,
    LOAD_CLASSES)``."""
    winding: Array = field(default_factory=lambda: np.zeros((2, WINDING_CLASSES)))
    """Hours of known winding temperature [h], and sum of hours times temperature rise [h K], by
    class of the rise over the calibrated state, ``(2, WINDING_CLASSES)``."""

    def __add__(self, other: "FlownDuty") -> "FlownDuty":
        return FlownDuty(
            self.hours + other.hours, self.travel + other.travel, self.winding + other.winding
        )


NOTHING_FLOWN: Final = FlownDuty()
"""Duty without any telemetry."""


@dataclass(frozen=True)
class DamageSettings(Checked):
    """Relation of damage to duty (P23)."""

    growth_per: str = text(
        "damage",
        "damage: growth per damage (wear under load, ageing by heat) if the duty is known, else "
        "per hour; hours: growth per hour",
        ("damage", "hours"),
    )
    wear_exponent: float = quantity(
        1.0, "-", 0.5, 10.0, "power of the load in the wear: 1 for sliding, 3 for rolling contact"
    )
    activation_energy: float = quantity(
        1.0,
        "eV",
        0.1,
        3.0,
        "activation energy of insulation ageing; 1 halves its life per 10 K at 130 °C",
    )
    winding_temperature: float = quantity(
        20.0,
        "degC",
        -60.0,
        250.0,
        "winding temperature in the calibrated state, to which measured rises are added",
    )
    least_coverage: float = quantity(
        0.2, "-", 1e-6, 1.0, "smallest share of the service hours that telemetry must cover"
    )

    def wear(self, travel: ArrayLike, load: ArrayLike) -> float:
        """Return the wear [rad]: the sum of load^p times travel [rad].

        The power is 1 for sliding contacts (Archard 1953), and 3 for the life of rolling contacts
        (ISO 281, ISO 3408-5).
        """
        return float(np.sum(np.asarray(travel) * np.asarray(load) ** self.wear_exponent))

    def ageing(self, hours: ArrayLike, celsius: ArrayLike) -> float:
        """Return the ageing as equivalent hours at a winding temperature of 100 degC [h].

        The ageing rate follows the Arrhenius law exp(-E/kT), T in kelvin (Dakin 1948).
        """
        kelvin = np.maximum(np.asarray(celsius) + _ZERO_CELSIUS, 1.0)
        away = self.activation_energy / BOLTZMANN * (1.0 / _REFERENCE_K - 1.0 / kelvin)
        return float(np.sum(np.asarray(hours) * np.exp(away)))

    def damage(self, flown: FlownDuty) -> Array:
        """Return the damage done by a duty, ``(5,)``.

        The values are the hours of telemetry [h], travel [rad], wear [rad], hours of known winding
        temperature [h], and ageing [h].
        """
        (travel, load), (hours, rise) = (
            (amount, moment / np.where(amount > 0.0, amount, 1.0))
            for amount, moment in (flown.travel, flown.winding)
        )
        wear = self.wear(travel, load)
        ageing = self.ageing(hours, self.winding_temperature + rise)
        return np.array([flown.hours, travel.sum(), wear, hours.sum(), ageing])
