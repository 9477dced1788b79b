# SPDX-License-Identifier: Apache-2.0
"""Performance requirements, and compliance of an actuator with faults."""

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ema_core.arrays import Array
from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, HIGHEST, N_FAULTS
from ema_core.labels import label_of
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_core.parameters import ActuatorParameters
from ema_core.quantity import Checked, quantity
from ema_monitor.health import ONE_SIDED_95, FaultHealth, HealthLimits
from ema_monitor.prognosis.requirements.performance import Performance, PerformanceModel, as_faults

REQUIREMENTS: Final = Performance._fields
"""Names of the requirements, in the order of `Performance`."""

MODELLED: Final = ("tracking_error", "bandwidth", "torque_margin")
"""Requirements that need a run of the model; free play is computed in closed form."""

BELOW: Final = frozenset({"bandwidth", "torque_margin"})
"""Requirements that fail below their limit."""

SEEN: Final = (-0.5, 1.5)
"""Reserves to which the surrogate is clipped [-]."""

_SMALLEST_STEP = 0.01
_NEGLIGIBLE = 0.05
_ROUNDED_ZETA = 0.02
_MOST_UNITS = 256


@dataclass(frozen=True)
class RequirementLimits(Checked):
    """Limits of the required performance.

    A healthy built-in actuator has a tracking error of 2.14 mrad, a bandwidth of 32.9 Hz, a free
    play of 0.01 mrad and a torque margin of 0.653.
    """

    tracking_error: float = quantity(
        1.5e-3, "rad", 1e-6, 1.0, "largest increase of the tracking error over the healthy value"
    )
    bandwidth: float = quantity(12.0, "Hz", 0.1, 1e3, "smallest bandwidth at -3 dB")
    free_play: float = quantity(5e-4, "rad", 1e-7, 1.0, "largest free play at the user shaft")
    torque_margin: float = quantity(
        0.5, "-", 0.0, 0.99, "smallest unused share of the available torque"
    )

    @classmethod
    def unit(cls, name: str) -> str:
        """Return the unit of a requirement, as used in messages; "1" for a share or a fault."""
        units = {item.name: item.metadata["unit"] for item in fields(cls)}
        return units.get(name, "-").replace("-", "1")

    def criterion(self, name: str) -> str:
        """Return the failure criterion of a requirement as a phrase, for any actuator."""
        if name == "tracking_error":
            more = f"{self.tracking_error:.4g} {self.unit(name)}"
            return f"tracking error exceeds the healthy actuator's by more than {more}"
        return _criterion(name, getattr(self, name))


@dataclass(frozen=True)
class Unmonitored:
    """Requirements that cannot be monitored."""

    reason: str = ""
    """Reason as a sentence; empty for a joint without a drive model, which has no requirements."""


WITHOUT_MODEL: Final = Unmonitored(
    "requirements cannot be monitored without a calibration of a known drive"
)
"""Reason why no requirement is monitored without a model of the drive."""


@dataclass(frozen=True)
class Compliance:
    """Compliance of an actuator with its requirements."""

    healths: tuple[FaultHealth, ...]
    """Health with respect to each requirement, in the units of ``RequirementLimits.unit``."""
    gradients: dict[str, Array]
    """Gradient of each performance with respect to the faults, ``(8,)``, by name [unit of the
    performance]; 0 for unobservable components."""


class Requirements:
    """Performance requirements of an actuator, with a model that judges them.

    Parameters
    ----------
    parameters
        Parameters of the unit; ``Calibration.unit_parameters`` if there is a calibration.
    limits
        Limits of the required performance.

    Attributes
    ----------
    healthy
        Performance of the healthy actuator by name.
    limit
        Value at which each requirement fails, by name; for the tracking error it is absolute.

    Raises
    ------
    ValueError
        If a healthy actuator misses a requirement.
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
                    f"the limit of {self.limit[name]:.4g} {unit}; set a limit that it meets"
                )

    def reserve(self, name: str, values: Array) -> Array:
        """Return the reserve of a performance [-]: 1 when healthy, 0 at the limit.

        Parameters
        ----------
        name
            Name of the requirement.
        values
            Values of the performance in its unit, of any shape.
        """
        return (self.limit[name] - values) / self._scale[name]

    def criterion(self, name: str) -> str:
        """Return the failure criterion of a requirement as a phrase."""
        return _criterion(name, self.limit[name])

    def exact_reserves(self, names: tuple[str, ...], faults: ArrayLike) -> Array:
        """Return the reserves of fault vectors, ``(m, 8)``, from the model, ``(m, len(names))``.

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
        """Return the compliance with each requirement, with gradients by fault.

        Parameters
        ----------
        faults
            Estimated fault vector, ``(8,)``.
        covariance
            Covariance of the faults, ``(8, 8)``; NaN rows and columns count as unobservable.
        warn_share
            Share of the distance from healthy to a limit above which the lower 95 % bound gives a
            warning [-].

        Notes
        -----
        Standard deviations follow from the delta method, with differences over one standard
        deviation of each component, at least 0.01. If an unobservable component over its whole
        range would change a performance by more than 5 % of the distance from healthy to the limit,
        sigma is NaN and the level ``STALE``, unless the value is beyond the limit. The direction of
        an eccentricity below 0.02 is ignored.
        """
        k = as_faults(faults)[0]
        P = np.array(covariance, dtype=np.float64)
        hidden = ~np.isfinite(np.diag(P))
        P[hidden], P[:, hidden] = 0.0, 0.0
        step = np.maximum(np.sqrt(np.maximum(np.diag(P), 0.0)), _SMALLEST_STEP)
        up = np.where(hidden, HIGHEST, np.minimum(k + step, HIGHEST))
        down = np.where(hidden, 0.0, np.maximum(k - step, 0.0))
        if hidden[ECCENTRICITY_PHASE]:
            # Both ends of its range are the same direction: compare opposite directions.
            down[ECCENTRICITY_PHASE] = k[ECCENTRICITY_PHASE]
            up[ECCENTRICITY_PHASE] = (k[ECCENTRICITY_PHASE] + 0.5) % 1.0
        points = np.tile(k, (1 + 2 * N_FAULTS, 1))
        np.fill_diagonal(points[1 : 1 + N_FAULTS], up)
        np.fill_diagonal(points[1 + N_FAULTS :], down)
        if k[ECCENTRICITY] < _ROUNDED_ZETA:
            points[1 + ECCENTRICITY_PHASE] = points[1 + N_FAULTS + ECCENTRICITY_PHASE] = k
        # If the vector has a NaN, all points around it are unknown.
        points[1:][np.isnan(k).any() | np.isnan(points[1:]).any(axis=1)] = np.nan
        # A component at the end of its range varies in one direction only, which repeats points.
        distinct, inverse = np.unique(points, axis=0, return_inverse=True)
        performance = self.model.performance(distinct)
        healths, gradients = [], {}
        for name in REQUIREMENTS:
            values = getattr(performance, name)[inverse]
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
) -> Requirements | Unmonitored:
    """Return the (cached) requirements of a unit, or the reason why they cannot be monitored."""
    try:
        return Requirements(parameters, limits)
    except ValueError as error:
        return Unmonitored(f"requirements cannot be monitored: {error}")


def _criterion(name: str, limit: float) -> str:
    verb = "falls below" if name in BELOW else "exceeds"
    unit = RequirementLimits.unit(name).replace("1", "")
    return f"{label_of(name)} {verb} {limit:.4g} {unit}".strip()
