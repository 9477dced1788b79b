"""Required performance: its limits, and how far an actuator with given faults is from them."""

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ema_core.arrays import Array
from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, HIGHEST, N_FAULTS
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_core.parameters import ActuatorParameters
from ema_core.quantity import Checked, quantity
from ema_monitor.health import ONE_SIDED_95, FaultHealth, HealthLimits
from ema_monitor.prognosis.requirements.performance import Performance, PerformanceModel, as_faults

REQUIREMENTS: Final = Performance._fields
"""Names of the requirements, in the order of `Performance`."""

MODELLED: Final = ("tracking_error", "bandwidth", "torque_margin")
"""Those for which the model must run; free play has a closed form."""

BELOW: Final = frozenset({"bandwidth", "torque_margin"})
"""Those that fail below their limit."""

SEEN: Final = (-0.5, 1.5)
"""Reserves to which the surrogate is clipped [-]."""

_SMALLEST_STEP = 0.01
_NEGLIGIBLE = 0.05
_ROUNDED_ZETA = 0.02
_MOST_UNITS = 256


@dataclass(frozen=True)
class RequirementLimits(Checked):
    """What an actuator must still perform.

    A healthy built-in actuator has a tracking error of 2.14 mrad, a bandwidth of 32.9 Hz, a free
    play of 0.01 mrad and a torque margin of 0.653.
    """

    tracking_error: float = quantity(
        1.5e-3, "rad", 1e-6, 1.0, "largest increase of the tracking error over healthy"
    )
    bandwidth: float = quantity(12.0, "Hz", 0.1, 1e3, "smallest bandwidth at -3 dB")
    free_play: float = quantity(5e-4, "rad", 1e-7, 1.0, "largest free play at the user shaft")
    torque_margin: float = quantity(0.5, "-", 0.0, 0.99, "least unused share of the torque")

    @classmethod
    def unit(cls, name: str) -> str:
        """Return the unit of a requirement as messages write it; "1" for a share or a fault."""
        units = {item.name: item.metadata["unit"] for item in fields(cls)}
        return units.get(name, "-").replace("-", "1")

    def criterion(self, name: str) -> str:
        """Return in words when a requirement fails, of an actuator that is not known."""
        if name == "tracking_error":
            more = f"{self.tracking_error:.4g} {self.unit(name)}"
            return f"tracking error exceeds the healthy actuator's by more than {more}"
        return _criterion(name, getattr(self, name))


WITHOUT_MODEL: Final = "requirements cannot be monitored without a calibration of a known drive"
"""Why no requirement is monitored where there is no model of the drive."""


@dataclass(frozen=True)
class Compliance:
    """How an actuator with given faults meets the requirements."""

    healths: tuple[FaultHealth, ...]
    """Health as to each requirement, in the units of ``RequirementLimits.unit``."""
    gradients: dict[str, Array]
    """How each performance changes with the faults, ``(8,)``, by name [its unit]; 0 if it is not
    observable."""


class Requirements:
    """The requirements of one actuator.

    Parameters
    ----------
    parameters
        Those of the unit: of ``Calibration.model()`` where there is a calibration.
    limits
        What is required.

    Attributes
    ----------
    healthy
        Performance of the healthy actuator by name.
    limit
        Value at which each requirement fails, by name; for the tracking error it is absolute.

    Raises
    ------
    ValueError
        When a healthy actuator misses a requirement.
    """

    def __init__(
        self, parameters: ActuatorParameters, limits: RequirementLimits | None = None
    ) -> None:
        self.limits = limits or RequirementLimits()
        self.model = PerformanceModel(parameters, self.limits.bandwidth)
        self.healthy = self.model.healthy
        self.limit = {name: float(getattr(self.limits, name)) for name in REQUIREMENTS}
        self.limit["tracking_error"] += self.healthy["tracking_error"]
        self._scale = {name: self.limit[name] - self.healthy[name] for name in REQUIREMENTS}
        for name, scale in self._scale.items():
            if (scale >= 0.0) if name in BELOW else (scale <= 0.0):
                unit = RequirementLimits.unit(name)
                raise ValueError(
                    f"{name}: a healthy actuator has {self.healthy[name]:.4g} {unit} and misses "
                    f"the limit of {self.limit[name]:.4g} {unit}; set one that it meets"
                )

    def reserve(self, name: str, values: Array) -> Array:
        """Return how much is left of the way from healthy to the limit: 1 when healthy, 0 there.

        The values of the performance are in its unit, of any shape.
        """
        return (self.limit[name] - values) / self._scale[name]

    def criterion(self, name: str) -> str:
        """Return in words when a requirement fails."""
        return _criterion(name, self.limit[name])

    def exact_reserves(self, names: tuple[str, ...], faults: ArrayLike) -> Array:
        """Return reserves of fault vectors, ``(m, 8)``, by the model, ``(m, len(names))``.

        Only the parts of the model that ``names`` need are run.
        """
        faults = as_faults(faults)
        performance: dict[str, Array] = {}
        if "tracking_error" in names or "torque_margin" in names:
            performance["tracking_error"], performance["torque_margin"] = self.model.chirp(faults)
        if "bandwidth" in names:
            performance["bandwidth"] = self.model.bandwidth(faults)
        if "free_play" in names:
            performance["free_play"] = self.model.free_play(faults)
        return np.stack([self.reserve(name, performance[name]) for name in names], axis=1)

    def judge(
        self,
        faults: ArrayLike,
        covariance: ArrayLike,
        warn_share: float = HealthLimits().warn_share,
    ) -> Compliance:
        """Return how far each requirement is met, and how that changes with the faults.

        Parameters
        ----------
        faults
            Estimated fault vector, ``(8,)``.
        covariance
            Its covariance, ``(8, 8)``; NaN rows and columns count as unobservable.
        warn_share
            Share of the way to a limit that the lower 95 % bound passes at a warning [-].

        Notes
        -----
        Standard deviations by the delta method, from differences over one standard deviation of
        each component, at least 0.01. Where an unobservable component over its whole range would
        change a performance by more than 5 % of the way to the limit, sigma is NaN and the level
        ``STALE``, unless the value is beyond the limit. A direction of eccentricity does not
        count below 0.02.
        """
        k = as_faults(faults)[0]
        P = np.array(covariance, dtype=np.float64)
        hidden = ~np.isfinite(np.diag(P))
        P[hidden], P[:, hidden] = 0.0, 0.0
        step = np.maximum(np.sqrt(np.maximum(np.diag(P), 0.0)), _SMALLEST_STEP)
        up = np.where(hidden, HIGHEST, np.minimum(k + step, HIGHEST))
        down = np.where(hidden, 0.0, np.maximum(k - step, 0.0))
        if hidden[ECCENTRICITY_PHASE]:
            # Both ends of its range are one direction: compare with the opposite one.
            down[ECCENTRICITY_PHASE] = k[ECCENTRICITY_PHASE]
            up[ECCENTRICITY_PHASE] = (k[ECCENTRICITY_PHASE] + 0.5) % 1.0
        points = np.tile(k, (1 + 2 * N_FAULTS, 1))
        np.fill_diagonal(points[1 : 1 + N_FAULTS], up)
        np.fill_diagonal(points[1 + N_FAULTS :], down)
        if k[ECCENTRICITY] < _ROUNDED_ZETA:
            points[1 + ECCENTRICITY_PHASE] = points[1 + N_FAULTS + ECCENTRICITY_PHASE] = k
        # The points around a vector with NaN are as unknown as itself.
        points[1:][np.isnan(k).any() | np.isnan(points[1:]).any(axis=1)] = np.nan
        # A component at the end of its range goes one way only: half of its points are no others.
        distinct, which = np.unique(points, axis=0, return_inverse=True)
        performance = self.model.performance(distinct)
        healths, gradients = [], {}
        for name in REQUIREMENTS:
            values = getattr(performance, name)[which]
            change = values[1 : 1 + N_FAULTS] - values[1 + N_FAULTS :]
            gradient = np.where(hidden, 0.0, change / (up - down))
            blind = np.any(hidden & (np.abs(change / self._scale[name]) > _NEGLIGIBLE))
            sigma = np.nan if blind else float(np.sqrt(max(gradient @ P @ gradient, 0.0)))
            healths.append(self._health(name, float(values[0]), sigma, warn_share))
            gradients[name] = gradient
        return Compliance(tuple(healths), gradients)

    def _health(self, name: str, value: float, sigma: float, warn_share: float) -> FaultHealth:
        share = 1.0 - float(self.reserve(name, np.array(value)))
        bound = share - ONE_SIDED_95 * sigma / abs(self._scale[name])
        if share > 1.0:
            level = ERROR
        elif np.isnan(bound):
            level = STALE
        else:
            level = WARN if bound > warn_share else OK
        limit = self.limit[name]
        ends = limit, limit - (1.0 - warn_share) * self._scale[name]
        return FaultHealth(name, level, value, sigma, *ends, name in BELOW, share)


@lru_cache(_MOST_UNITS)
def requirements_of(
    parameters: ActuatorParameters, limits: RequirementLimits
) -> Requirements | str:
    """Return the requirements of a unit, made once for each, or why they cannot be monitored."""
    try:
        return Requirements(parameters, limits)
    except ValueError as error:
        return f"requirements cannot be monitored: {error}"


def _criterion(name: str, limit: float) -> str:
    verb = "falls below" if name in BELOW else "exceeds"
    unit = RequirementLimits.unit(name).replace("1", "")
    return f"{name.replace('_', ' ')} {verb} {limit:.4g} {unit}".strip()
