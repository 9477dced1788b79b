# SPDX-License-Identifier: Apache-2.0
"""Rehearsal of a test: windows of actuators with known faults, and their estimates (M30)."""

import math
from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple, Protocol, runtime_checkable

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.commands import Command
from ema_core.description import ActuatorDescription
from ema_core.faults import (
    COMPONENTS,
    ECCENTRICITY,
    ECCENTRICITY_PHASE,
    FAULT_NAMES,
    FAULTS,
    SHORT_CIRCUITS,
    healthy_faults,
)
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.diagnosis import identify
from ema_monitor.identification.alternatives import Part
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.uncertainty import SIGNIFICANT_SIGMAS, STRONG_CORRELATION
from ema_monitor.windows.window import Window

HALF_WIDTH: Final = 1.645
"""Half-width of a 90 % interval [standard deviations]."""

RIG_HINT: Final = "a function of command, faults, cycles and causes that returns windows"
"""Hint for an error message about a rig."""

N_COMBINED: Final = len(SHORT_CIRCUITS)
"""Number of rehearsed actuators with several faults at once."""

_SHARE: Final = 0.5
_SHARES: Final = (0.25, 0.6)
_PHASE: Final = 0.7
_SEED: Final = 2018
_HEALTHY: Final = 12
_SINGLE: Final = 2
_COMBINED: Final = 6

REHEARSED_WINDOWS: Final = _HEALTHY + len(COMPONENTS) * _SINGLE + N_COMBINED * _COMBINED
"""Number of windows of a rehearsal."""


@runtime_checkable
class ActuatorRig(Protocol):
    """Runs tests of an actuator with chosen faults; the actuator is usually simulated."""

    def __call__(
        self, command: Command, faults: Array, cycles: int, causes: Mapping[str, float]
    ) -> list[Window]:
        """Return one window per test cycle.

        Parameters
        ----------
        command
            Command of a cycle.
        faults
            Fault vector, ``(8,)``.
        cycles
            Number of test cycles.
        causes
            Hidden causes by name, in the units of the registry.

        Raises
        ------
        ValueError
            If a cycle has no window.
        """
        ...


def single_faults() -> dict[str, Array]:
    """Return a fault vector for each fault alone, half-way to its limit, keyed by fault name."""
    result = {}
    for i, fault in enumerate(FAULTS):
        if fault.limit is not None:
            k = healthy_faults()
            k[i] += _SHARE * fault.limit
            k[ECCENTRICITY_PHASE] = _PHASE
            result[fault.name] = k
    return result


def combined_faults(number: int) -> Array:
    """Return the fault vector of one of ``N_COMBINED`` actuators with several faults at once.

    Each fault has 25 to 60 % of its limit. One phase is shorted, because short circuits of all
    phases cannot be distinguished from a weak magnet. Every second actuator has a gain that is too
    low.
    """
    rng = np.random.default_rng([_SEED, number])
    k = healthy_faults()
    for i, fault in enumerate(FAULTS):
        share = rng.uniform(*_SHARES)
        if fault.limit is not None and (i not in SHORT_CIRCUITS or i == SHORT_CIRCUITS[number]):
            k[i] += (-1.0 if fault.is_two_sided and number % 2 else 1.0) * share * fault.limit
    k[ECCENTRICITY_PHASE] = rng.random()
    return k


def present(faults: Array) -> Flags:
    """Return which components differ from healthy, ``(8,)``.

    The phase differs if the eccentricity does.
    """
    differs = faults != healthy_faults()
    differs[ECCENTRICITY_PHASE] = differs[ECCENTRICITY]
    return differs


class Prospect(NamedTuple):
    """A fault vector, ``(8,)``, and estimates from windows of an actuator with these faults."""

    faults: Array
    estimates: list[Estimate]

    @property
    def sigma(self) -> Array:
        """RMS of the standard deviations of the estimates, ``(8,)``; NaN if unobservable."""
        with np.errstate(invalid="ignore"):
            return np.sqrt(
                np.mean([np.square(estimate.sigma) for estimate in self.estimates], axis=0)
            )

    @property
    def shown(self) -> Flags:
        """Components that differ from healthy in every estimate, ``(8,)``."""
        return np.all([_claims(estimate) for estimate in self.estimates], axis=0)

    def error(self, number: int) -> float:
        """Return the RMS error of the estimates of a component other than the phase [-]."""
        errors = [estimate.faults[number] - self.faults[number] for estimate in self.estimates]
        return float(np.sqrt(np.mean(np.square(errors))))


class FaultProspect(NamedTuple):
    """Result of a rehearsal for one fault."""

    name: str
    """Name of the fault."""
    shown: bool
    """Whether a test detects the fault half-way to its limit."""
    sigma: float
    """Standard deviation of an estimate for the least favourable actuator; NaN if the fault is not
    detected."""
    error: float
    """RMS error of the estimates for the least favourable actuator [-]; NaN if the fault is not
    detected."""
    smallest: float
    """Smallest distance from healthy that a test detects [-]."""
    not_told_from: tuple[Part, ...]
    """Faults and causes that a test cannot separate from the fault, each a tuple of names."""

    @property
    def effective(self) -> float:
        """Standard deviation whose 90 % interval also contains the rehearsed errors [-]."""
        return max(self.sigma, self.error / HALF_WIDTH) if self.shown else math.nan

    @property
    def label(self) -> str:
        """Displayed name of the fault."""
        return FAULTS[FAULT_NAMES.index(self.name)].label

    @property
    def meaning(self) -> str:
        """Physical value of the smallest fault that is detected."""
        fault = FAULTS[FAULT_NAMES.index(self.name)]
        if not math.isfinite(self.smallest):
            return ""
        text = fault.physical(min(fault.healthy + self.smallest, fault.highest))
        if fault.is_two_sided:
            text += f" or {fault.at(max(fault.healthy - self.smallest, 0.0)):.3f}"
        return text


class Rehearsed(NamedTuple):
    """A rehearsed test."""

    calibration: Calibration
    """Calibration of the unit under the command."""
    window: Window
    """A healthy window."""
    healthy: Prospect
    """Prospect of a healthy actuator."""
    singles: dict[str, Prospect]
    """Prospects of actuators with a single fault, by name of the fault."""
    combined: list[Prospect]
    """Prospects of actuators with several faults."""

    @property
    def faults(self) -> tuple[FaultProspect, ...]:
        """Result of the rehearsal for each fault."""
        return tuple(self._fault(name) for name in COMPONENTS)

    def _fault(self, name: str) -> FaultProspect:
        i, single = FAULT_NAMES.index(name), self.singles[name]
        affected = [
            single,
            *(prospect for prospect in self.combined if present(prospect.faults)[i]),
        ]
        affected = [prospect for prospect in affected if single.shown[i] and prospect.shown[i]]
        confused: set[Part] = set()
        for estimate in single.estimates:
            confused |= confused_with(estimate, name)
            confused |= {(FAULT_NAMES[j],) for j in claimed(estimate) if j != i}
            confused |= {(cause.name,) for cause in estimate.causes}
        for estimate in self.combined:
            confused |= {(FAULT_NAMES[j],) for j in _correlated(estimate, i)}
        return FaultProspect(
            name,
            bool(single.shown[i]),
            max((float(prospect.sigma[i]) for prospect in affected), default=math.nan),
            max((prospect.error(i) for prospect in affected), default=math.nan),
            float(SIGNIFICANT_SIGMAS[i] * self.healthy.sigma[i]),
            fewest(confused),
        )


def rehearse(
    rig: ActuatorRig,
    command: Command,
    description: ActuatorDescription,
    calibration: Calibration | None = None,
) -> Rehearsed:
    """Rehearse a test and return the results; see `certify` for parameters and errors."""
    healthy = rig(command, healthy_faults(), _HEALTHY, {})
    used = calibration or calibrate_model(healthy, description)

    def judged(windows: list[Window], faults: Array) -> Prospect:
        estimates = [identify(window, description, used, previous=faults) for window in windows]
        return Prospect(faults, estimates)

    def of(faults: Array, count: int) -> Prospect:
        return judged(rig(command, faults, count, {}), faults)

    return Rehearsed(
        used,
        healthy[0],
        judged(healthy[:_SINGLE], healthy_faults()),
        {name: of(faults, _SINGLE) for name, faults in single_faults().items()},
        [of(combined_faults(number), _COMBINED) for number in range(N_COMBINED)],
    )


def confused_with(estimate: Estimate, name: str) -> set[Part]:
    """Return the faults and causes that an estimate cannot separate from a fault or cause."""
    pairs = [
        pair for part, stand_in in estimate.alternatives for pair in _either_order(part, stand_in)
    ]
    return {stand_in for part, stand_in in pairs if name in part}


def _either_order(part: Part, stand_in: Part) -> tuple[tuple[Part, Part], tuple[Part, Part]]:
    return (part, stand_in), (stand_in, part)


def fewest(parts: Iterable[Part]) -> tuple[Part, ...]:
    """Return the parts, sorted, except combinations whose names all occur as single parts."""
    single_names = {part[0] for part in parts if len(part) == 1}
    return tuple(
        sorted(part for part in parts if len(part) == 1 or not single_names.issuperset(part))
    )


def claimed(estimate: Estimate) -> list[int]:
    """Return the indices of the faults that a valid estimate detects."""
    return [int(i) for i in np.flatnonzero(_claims(estimate)) if FAULT_NAMES[i] in COMPONENTS]


def _claims(estimate: Estimate) -> Flags:
    return estimate.valid & estimate.found


def _correlated(prospect: Prospect, i: int) -> list[int]:
    """Return the indices of the faults whose estimates correlate strongly with fault ``i``."""
    correlated = np.zeros(len(FAULTS), dtype=bool)
    for estimate in prospect.estimates:
        sigma = np.sqrt(np.diag(estimate.covariance))
        correlated |= np.abs(estimate.covariance[i]) > STRONG_CORRELATION * sigma[i] * sigma
    return [
        j for j in np.flatnonzero(correlated).tolist() if j != i and FAULT_NAMES[j] in COMPONENTS
    ]
