"""Damage that duty does: wear by load and travel, ageing by the temperature of the winding."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.faults import COMPONENTS
from ema_core.quantity import check_quantities, quantity, text
from ema_monitor.prognosis.duty.flown import FlownDuty

BOLTZMANN: Final = 8.617333e-5
"""Boltzmann's constant [eV/K]."""

_ZERO_CELSIUS: Final = 273.15
_REFERENCE_K: Final = 373.15
_WEAR: Final = ("friction", "backlash")
_AGEING: Final = ("short_circuit_a", "short_circuit_b", "short_circuit_c")

MEASURE: Final = np.array([0 if c in _WEAR else 1 if c in _AGEING else 2 for c in COMPONENTS])
"""Damage measure of each component: 0 wear, 1 ageing, 2 hours, ``(7,)``."""


@dataclass(frozen=True)
class DamageSettings:
    """How duty does damage (P23).

    Raises
    ------
    ValueError
        When a figure is outside its range; the message names it.
    """

    growth_per: str = text(
        "damage",
        "what growth is counted by: damage where the duty is known, hours else; or always hours",
        ("damage", "hours"),
    )
    wear_exponent: float = quantity(
        1.0, "-", 0.5, 10.0, "power of the load by which travel wears: 1 sliding, 3 rolling contact"
    )
    activation_energy: float = quantity(
        1.0,
        "eV",
        0.1,
        3.0,
        "of the ageing of the insulation; 1 halves its life by 10 K at 130 °C",
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

    def __post_init__(self) -> None:
        check_quantities(self)

    def wear(self, travel: ArrayLike, load: ArrayLike) -> float:
        """Return the wear by travels [rad] at loads: the sum of load^p times travel [rad].

        Archard (1953) has the power 1 for sliding contacts; the life of rolling contacts goes by
        the power 3 of their load (ISO 281, ISO 3408-5).
        """
        return float(np.sum(np.asarray(travel) * np.asarray(load) ** self.wear_exponent))

    def ageing(self, hours: ArrayLike, celsius: ArrayLike) -> float:
        """Return the ageing in hours at temperatures of the winding: those at 100 degC as bad [h].

        By Arrhenius: exp(-E/kT), T in kelvin (Dakin 1948).
        """
        kelvin = np.maximum(np.asarray(celsius) + _ZERO_CELSIUS, 1.0)
        away = self.activation_energy / BOLTZMANN * (1.0 / _REFERENCE_K - 1.0 / kelvin)
        return float(np.sum(np.asarray(hours) * np.exp(away)))

    def damage(self, flown: FlownDuty | None) -> NDArray[np.float64]:
        """Return hours of telemetry, travel, wear, hours of known temperature and ageing."""
        if flown is None:
            return np.zeros(5)
        (travel, load), (hours, rise) = (
            (amount, moment / np.where(amount > 0.0, amount, 1.0))
            for amount, moment in (flown.travel, flown.winding)
        )
        wear = self.wear(travel, load)
        ageing = self.ageing(hours, self.winding_temperature + rise)
        return np.array([flown.hours, travel.sum(), wear, hours.sum(), ageing])
