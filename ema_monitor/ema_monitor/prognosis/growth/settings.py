"""What a tracker assumes of growth."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

from ema_core.faults import COMPONENTS, TYPICAL, kind_of
from ema_core.growth_laws import LAWS
from ema_core.quantity import check_quantities, quantity, text
from ema_monitor.prognosis.growth.fleet_prior import FleetPrior


@dataclass(frozen=True)
class KnownLaw:
    """Law by which a component is known to grow, with the prior of its rate.

    The prior of the rate is half a lognormal of these figures and half log-uniform over all rates
    of the tracker: an actuator may grow slower or faster than its type does.

    Attributes
    ----------
    law
        One of ``ema_core.growth_laws.LAWS`` but ``constant``.
    rate
        Median of the rate a [1/h], of ``power`` of the time scale c [h].
    rate_sigma
        Standard deviation of the rate's logarithm [-].
    shape
        Second figure of the law [-].
    diffusion
        Of ``drift`` its s [1/sqrt(h)].

    Raises
    ------
    ValueError
        When a figure is impossible.
    """

    law: str = text("linear", "law by which the fault grows", LAWS[1:])
    rate: float = quantity(1e-3, "1/h", 1e-9, 1e6, "median of the rate, of law power of c in h")
    rate_sigma: float = quantity(0.5, "-", 0.05, 3.0, "sigma of the rate's logarithm")
    shape: float = quantity(0.0, "-", 0.0, 100.0, "second parameter of the law: x_0, b or p")
    diffusion: float = quantity(1e-3, "1/sqrt(h)", 1e-9, 1.0, "s of law drift")

    def __post_init__(self) -> None:
        check_quantities(self)
        if self.law == "power" and self.shape == 0.0:
            raise ValueError("shape = 0: law power needs an exponent p above 0")
        if self.law == "exponential" and self.shape == 0.0:
            raise ValueError("shape = 0: law exponential needs an x_0 above 0 to begin at all")


def _nominal(component: str) -> KnownLaw:
    typical = TYPICAL[kind_of(component)]
    if typical.law == "drift":
        return KnownLaw(typical.law, typical.rate, typical.rate_sigma, diffusion=typical.diffusion)
    return KnownLaw(typical.law, typical.rate, typical.rate_sigma, shape=typical.shape)


NOMINAL_LAWS: Final[Mapping[str, KnownLaw]] = MappingProxyType(
    {component: _nominal(component) for component in COMPONENTS}
)
"""Laws and median rates of the simulated lives, for a tracker that knows the law."""


@dataclass(frozen=True)
class TrackerSettings:
    """What a tracker assumes.

    Attributes
    ----------
    laws
        Law by component; of what is not named the law is unknown, and all are averaged.
    fleet
        How other units grew; None when that is unknown. A known law is used all the same.
    process_noise
        Sigma of the lognormal factor of an increment over ``process_noise_hours`` [-].
    process_noise_hours
        Hours over which such a factor holds [h].
    onset_probability
        Probability that a component which does not grow begins to, each test [-].
    change_probability
        Probability that the growth of a component changes altogether, each test [-].
    forgetting
        Power to which the probabilities of rates that wander, of waves, and of the kinds of growth
        are kept at each test, towards their prior [-].
    sigma_floor
        Error of an estimate beside its covariance [-].
    occasional_error, occasional_probability
        Larger error that some estimates have beside it [-], and how often [-].
    event_sigmas
        Standard deviations beyond which a value is not explained by growth [-].
    horizon_hours
        Longest life that is reported [h].
    horizon_factor
        Longest life that is reported, in hours over which a component has been observed [-].
    samples
        Number of samples of a prediction.

    Raises
    ------
    ValueError
        When a figure is outside its range, or a component is unknown.
    """

    laws: Mapping[str, KnownLaw] = field(default_factory=dict)
    fleet: FleetPrior | None = None
    process_noise: float = quantity(0.3, "-", 0.0, 3.0, "sigma of an increment's lognormal factor")
    process_noise_hours: float = quantity(10.0, "h", 1e-3, 1e5, "hours for which a factor holds")
    onset_probability: float = quantity(5e-3, "-", 0.0, 0.5, "probability of onset, each test")
    change_probability: float = quantity(1e-3, "-", 0.0, 0.5, "probability of change, each test")
    forgetting: float = quantity(0.98, "-", 0.5, 1.0, "power of what was learnt, each test")
    sigma_floor: float = quantity(1e-3, "-", 0.0, 0.1, "sigma added to that of an estimate")
    occasional_error: float = quantity(0.01, "-", 0.0, 1.0, "sigma of an occasional error")
    occasional_probability: float = quantity(0.05, "-", 0.0, 0.5, "its probability")
    event_sigmas: float = quantity(5.0, "-", 3.0, 20.0, "deviation at which an event is suspected")
    horizon_hours: float = quantity(20_000.0, "h", 1.0, 1e7, "longest life that is published")
    horizon_factor: float = quantity(3.0, "-", 1.0, 1e3, "the same, over hours observed")
    samples: int = quantity(2000, "-", 100, 100_000, "samples of a prediction")

    def __post_init__(self) -> None:
        check_quantities(self)
        for name in self.laws:
            if name not in COMPONENTS:
                raise ValueError(f"law of unknown fault {name!r}; known: {', '.join(COMPONENTS)}")

    @property
    def noise_hours(self) -> float:
        """Variance of the effective time of growth per hour in service [h]."""
        return math.expm1(self.process_noise**2) * self.process_noise_hours
