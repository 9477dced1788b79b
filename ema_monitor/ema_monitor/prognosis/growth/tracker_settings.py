# SPDX-License-Identifier: Apache-2.0
"""Assumptions of a tracker about growth: known laws, a fleet prior, and noise."""

import math
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType, NoneType
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np

from ema_core.arrays import Array
from ema_core.expecting import require_type
from ema_core.faults import COMPONENTS, KINDS, TYPICAL, kind_of, settings_by_kind
from ema_core.growth_laws import GROWING_LAWS, hours_until
from ema_core.quantity import Checked, quantity, text
from ema_core.wording import counted, unknown_name
from ema_monitor.health import HealthLimits

FORM: Final = "LAW[:RATE[:SHAPE]]"
"""Syntax of a growth law in user input."""

LIFE_HOURS: Final = np.geomspace(50.0, 30_000.0, 97)
"""Grid of hours from healthy to the limit [h]; every second value is used if the law is unknown."""


@runtime_checkable
class GrowthLaw(Protocol):
    """Interface of a user-defined growth law, for ``KnownLaw``.

    Let x >= 0 be the distance from healthy [-]. Growth must be deterministic and must start from x
    = 0 without a trigger. Its time must be inversely proportional to the rate. The tracker adds
    process noise and rejects a law whose methods are inconsistent. Laws must be hashable, as are
    instances of frozen dataclasses and of classes without ``__eq__``.
    """

    def increment(self, x: Array, rate: Array, shape: Array, hours: Array) -> Array:
        """Return the growth from x over a number of hours.

        Parameters
        ----------
        x
            Distances from healthy [-]. All arguments are arrays and are broadcast.
        rate
            Rate of the law [1/h].
        shape
            Second parameter of the law, ``KnownLaw.shape`` [-].
        hours
            Growth time, at least 0 [h].

        Returns
        -------
        numpy.ndarray
            Increment of x in the broadcast shape [-]; infinite where the solution diverges.
        """
        ...

    def hours_until(self, x: Array, rate: Array, shape: Array, limit: Array) -> Array:
        """Return the time until growth from x first reaches the limit.

        Parameters
        ----------
        x
            Distances from healthy [-]. All arguments are arrays and are broadcast.
        rate
            Rate of the law [1/h].
        shape
            Second parameter of the law, ``KnownLaw.shape`` [-].
        limit
            Distance from healthy at which life ends [-].

        Returns
        -------
        numpy.ndarray
            Time in the broadcast shape [h]: at most 0 if x is at or beyond the limit, infinite if
            the limit is never reached.
        """
        ...


@dataclass(frozen=True)
class KnownLaw(Checked):
    """Known growth law of a component, with a prior of its rate.

    The rate prior is an equal mixture of a lognormal with these parameters and a log-uniform
    distribution over all rates of the tracker, which reach the limit in 50 h to 30,000 h. The
    latter allows for units whose faults grow unusually slowly or fast.

    Raises
    ------
    ValueError
        If the law is unknown or a parameter is invalid.

    Examples
    --------
    >>> from ema_monitor import KnownLaw, Tracker, TrackerSettings
    >>> wear = KnownLaw("power", rate=1500.0, shape=1.6)
    >>> tracker = Tracker(settings=TrackerSettings(laws={"friction": wear}))
    """

    law: str | GrowthLaw = "linear"
    """Name of a law (P3), or a ``GrowthLaw``.

    The names are ``"linear"``, ``"exponential"``, ``"archard"``, ``"self_heating"``, ``"power"``
    and ``"drift"``.
    """
    rate: float = quantity(1e-3, "1/h", 1e-9, 1e6, "median of the rate; for law power, of c in h")
    """Median of the rate a [1/h], or of the time scale c [h] for law ``power``."""
    rate_sigma: float = quantity(0.5, "-", 0.05, 3.0, "sigma of the rate's logarithm")
    """Standard deviation of the logarithm of the rate [-]."""
    shape: float = quantity(0.0, "-", 0.0, 100.0, "second parameter of the law: x_0, b or p")
    """Second parameter of the law [-]: x_0 of ``exponential``, b of ``archard`` and
    ``self_heating``, p of ``power``, or ``shape`` of a ``GrowthLaw``."""
    diffusion: float = quantity(1e-3, "1/sqrt(h)", 1e-9, 1.0, "s of law drift")
    """Diffusion s, for law ``drift`` [1/sqrt(h)]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.law, str):
            if self.law not in GROWING_LAWS:
                raise ValueError(f"law = {self.law!r}: expected one of {', '.join(GROWING_LAWS)}")
        elif isinstance(self.law, type) or not (
            isinstance(self.law, GrowthLaw) and isinstance(self.law, Hashable)
        ):
            raise ValueError(
                f"law = {self.law!r}: expected one of {', '.join(GROWING_LAWS)}, or a hashable "
                "object with the methods increment and hours_until of GrowthLaw"
            )
        if self.law == "power" and self.shape == 0.0:
            raise ValueError("shape = 0: the law power requires an exponent p above 0")
        if self.law == "exponential" and self.shape == 0.0:
            raise ValueError(
                "shape = 0: law exponential needs an x_0 above 0, or growth never begins"
            )

    @classmethod
    def of(cls, law: str, rate: float, second: float, rate_sigma: float = 0.5) -> "KnownLaw":
        """Return a known law; ``second`` is the diffusion of law ``drift``, else the shape."""
        if law == "drift":
            return cls(law, rate, rate_sigma, diffusion=second)
        return cls(law, rate, rate_sigma, shape=second)


NOMINAL_LAWS: Final[Mapping[str, KnownLaw]] = MappingProxyType(
    {
        name: KnownLaw.of(usual.law, usual.rate, usual.diffusion or usual.shape, usual.rate_sigma)
        for name in COMPONENTS
        for usual in [TYPICAL[kind_of(name)]]
    }
)
"""Laws and median rates of the simulated lives, for trackers with known laws."""


def known_law(fault: str, written: str) -> KnownLaw:
    """Return the growth law specified by a string.

    Parameters
    ----------
    fault
        Component of the fault vector.
    written
        ``LAW[:RATE[:SHAPE]]``. RATE is the median rate a [1/h]; for ``power``, it is the time scale
        c [h]. SHAPE is ``KnownLaw.shape`` [-]; for ``drift``, it is the diffusion s [1/sqrt(h)];
        ``linear`` has none. LAW alone is allowed only if it is the fault's law in
        ``NOMINAL_LAWS``; the parameters are then taken from there.

    Raises
    ------
    ValueError
        If the fault or law is unknown, a parameter is missing or invalid, or the growth rate is
        outside the tracker's range.
    """
    if fault not in COMPONENTS:
        raise ValueError(unknown_name("fault", fault, COMPONENTS))
    law, *numbers = written.split(":")
    if law not in GROWING_LAWS:
        raise ValueError(unknown_name(f"law of {fault}", law, GROWING_LAWS))
    nominal = NOMINAL_LAWS[fault]
    if not numbers:
        if law != nominal.law:
            raise ValueError(
                f"{written!r}: a default rate of {fault} exists for law {nominal.law} only; "
                f"specify the rate as {FORM}"
            )
        return nominal
    try:
        if len(numbers) > 2:
            raise ValueError(f"{len(numbers)} parameters: expected at most two")
        rate, *second = [float(number) for number in numbers]
        if not second and law != "linear":
            raise ValueError(f"law {law} needs a second parameter")
        prior = KnownLaw.of(law, rate, second[0] if second else 0.0)
        limit = HealthLimits().of(fault)
        hours = float(hours_until(law, 0.0, rate, prior.shape, limit))
        if not LIFE_HOURS[0] <= hours <= LIFE_HOURS[-1]:
            raise ValueError(
                f"from healthy to the default limit {limit:g} it takes {hours:.3g} h: expected "
                f"{LIFE_HOURS[0]:.0f} to {LIFE_HOURS[-1]:.0f} h"
            )
    except ValueError as error:
        raise ValueError(f"law {written!r} of {fault}: {error}; expected {FORM}") from error
    return prior


def _law_of(kind: str) -> Any:
    suffix = " of each phase" if len(KINDS[kind]) > 1 else ""
    return text("", f"growth law{suffix}, {FORM}; empty: unknown")


@dataclass(frozen=True)
class KnownLawTexts(settings_by_kind("_LawByKind", str, _law_of)):
    """Growth law of each kind of fault as ``LAW[:RATE[:SHAPE]]``; empty if unknown.

    Raises
    ------
    ValueError
        If a text is not a valid law; the error names the kind of fault.
    """

    def __post_init__(self) -> None:
        self.laws()

    def laws(self) -> Mapping[str, KnownLaw]:
        """Return the known laws by component."""
        laws = {}
        for name in COMPONENTS:
            kind = kind_of(name)
            written = getattr(self, kind)
            if not isinstance(written, str):
                raise ValueError(f"{kind} = {written!r}: expected a string, {FORM}")
            try:
                if written:
                    laws[name] = known_law(name, written)
            except ValueError as error:
                raise ValueError(f"{kind} = {written!r}: {error}") from error
        return laws


@dataclass(frozen=True)
class FleetPrior:
    """Distribution of growth curves and rates over the units of a fleet."""

    digest: str
    """Digest of the evidence from all units."""
    units: int
    """Number of units with a growing fault."""
    names: str = ""
    """Name of the fleet; may be empty."""
    counts: Mapping[str, int] = field(default_factory=dict, compare=False, repr=False)
    """Number of growing faults by kind."""
    shares: Mapping[str, Array] = field(default_factory=dict, compare=False, repr=False)
    """Probability of each curve and rate, by kind of fault, ``(curves, rates)``; each sums to 1.

    Kinds for which no unit has a growing fault are omitted.
    """

    def text(self) -> str:
        """Return a phrase that describes the origin of the prior."""
        origin = counted(self.units, "other unit")
        return f"growth prior from {origin}" + (f" ({self.names})" if self.names else "")


@dataclass(frozen=True)
class TrackerSettings(Checked):
    """Assumptions of a tracker about growth and measurement noise.

    For components not listed in ``laws``, the law is unknown and all laws are averaged. ``fleet``
    is a prior learnt from other units; known laws take precedence. ``forgetting`` discounts, at
    each test, the evidence for wandering rates, waves and the kinds of growth.

    Raises
    ------
    ValueError
        If a value is out of range or has a wrong type, or a component is unknown.
    """

    laws: Mapping[str, KnownLaw] = field(default_factory=dict)
    fleet: FleetPrior | None = None
    process_noise: float = quantity(0.3, "-", 0.0, 3.0, "sigma of an increment's lognormal factor")
    process_noise_hours: float = quantity(10.0, "h", 1e-3, 1e5, "hours for which a factor applies")
    onset_probability: float = quantity(
        5e-3, "-", 0.0, 0.5, "probability per test that growth begins"
    )
    change_probability: float = quantity(
        1e-3, "-", 0.0, 0.5, "probability per test that growth changes"
    )
    forgetting: float = quantity(0.98, "-", 0.5, 1.0, "exponent of the old evidence, per test")
    sigma_floor: float = quantity(1e-3, "-", 0.0, 0.1, "sigma added to the sigma of an estimate")
    occasional_error: float = quantity(0.01, "-", 0.0, 1.0, "sigma of an occasional error")
    occasional_probability: float = quantity(
        0.05, "-", 0.0, 0.5, "probability of an occasional error"
    )
    event_sigmas: float = quantity(5.0, "-", 3.0, 20.0, "deviation at which an event is suspected")
    horizon_hours: float = quantity(20_000.0, "h", 1.0, 1e7, "longest life that is published")
    horizon_factor: float = quantity(3.0, "-", 1.0, 1e3, "longest published life per observed hour")
    samples: int = quantity(
        2000, "-", 100, 100_000, "number of random samples of the future faults in a prediction"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        require_type("laws", self.laws, Mapping, "KnownLaw by name of the fault")
        for name, law in self.laws.items():
            if name not in COMPONENTS:
                raise ValueError(
                    f"law of unknown fault {name!r}: expected one of {', '.join(COMPONENTS)}"
                )
            require_type(f"law of {name}", law, KnownLaw)
        require_type("fleet", self.fleet, (FleetPrior, NoneType))

    @property
    def noise_hours(self) -> float:
        """Variance of the effective growth time per hour of service [h]."""
        return math.expm1(self.process_noise**2) * self.process_noise_hours
