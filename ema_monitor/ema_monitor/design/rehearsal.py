"""A test rehearsed: windows of actuators with known faults, and what is made of them (M30)."""

import math
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.causes import CAUSE_BY_NAME
from ema_core.commands import Command
from ema_core.description import ActuatorDescription
from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS, N_FAULTS, healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.design.prediction import Prospect, prospect
from ema_monitor.design.states import (
    N_COMBINED,
    Recorder,
    combined_faults,
    present,
    single_faults,
)
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.uncertainty import SIGNIFICANT_SIGMAS, STRONG_CORRELATION
from ema_monitor.windows.window import Window

_HEALTHY: Final = 12
_SINGLE: Final = 2
_COMBINED: Final = 6

HALF_WIDTH: Final = 1.645
"""Half-width of a 90 % interval [standard deviations]."""

REHEARSED_WINDOWS: Final = _HEALTHY + len(COMPONENTS) * _SINGLE + N_COMBINED * _COMBINED
"""How many windows a rehearsal takes."""


class FaultProspect(NamedTuple):
    """What a test shows of one fault.

    Attributes
    ----------
    name
        The fault.
    shown
        Whether a test finds it when it is half-way to its limit.
    sigma
        Standard deviation that an estimate states, in the least favourable actuator; NaN where the
        fault is not shown.
    scatter
        Standard deviation over repeated tests of one actuator [-].
    error
        Rms error of the estimates of the rehearsed windows [-].
    smallest
        Distance from healthy beyond which a test shows it [-].
    not_told_from
        What a test does not tell it from, in words.
    """

    name: str
    shown: bool
    sigma: float
    scatter: float
    error: float
    smallest: float
    not_told_from: tuple[str, ...]

    @property
    def effective(self) -> float:
        """Standard deviation with which 90 % intervals would hold the rehearsed errors, too [-]."""
        return max(self.sigma, self.error / HALF_WIDTH) if self.shown else math.nan

    @property
    def meaning(self) -> str:
        """The smallest fault that shows, in physical terms."""
        fault = FAULTS[FAULT_NAMES.index(self.name)]
        if not math.isfinite(self.smallest):
            return ""
        text = fault.physical(min(fault.healthy + self.smallest, fault.highest))
        if fault.is_two_sided:
            text += f" or {fault.at(max(fault.healthy - self.smallest, 0.0)):.3f}"
        return text


class Rehearsed(NamedTuple):
    """A rehearsed test.

    Attributes
    ----------
    calibration
        That of the unit under the command.
    window
        A healthy window.
    healthy, singles, combined
        Prospects of a healthy actuator, of those with single faults by name, and of those with
        several.
    """

    calibration: Calibration
    window: Window
    healthy: Prospect
    singles: dict[str, Prospect]
    combined: list[Prospect]

    @property
    def faults(self) -> tuple[FaultProspect, ...]:
        """What the test shows of each fault."""
        return tuple(
            _fault(name, self.healthy, self.singles[name], self.combined) for name in COMPONENTS
        )


def rehearse(
    record: Recorder,
    command: Command,
    description: ActuatorDescription,
    calibration: Calibration | None = None,
) -> Rehearsed:
    """Rehearse a test.

    Parameters
    ----------
    record
        Records the windows, by simulation as a rule.
    command
        Command of the test.
    description
        The actuator.
    calibration
        That of the unit; one is made of healthy windows when None.

    Raises
    ------
    ValueError
        When the motion makes no window, or does not allow a calibration.
    """
    healthy = record(command, healthy_faults(), _HEALTHY, {})
    known = calibration or calibrate_model(healthy, description)

    def of(faults: NDArray[np.float64], count: int) -> Prospect:
        return prospect(record(command, faults, count, {}), faults, description, known)

    return Rehearsed(
        known,
        healthy[0],
        prospect(healthy[:_SINGLE], healthy_faults(), description, known),
        {name: of(faults, _SINGLE) for name, faults in single_faults().items()},
        [of(combined_faults(number), _COMBINED) for number in range(N_COMBINED)],
    )


def _fault(
    name: str, healthy: Prospect, single: Prospect, combined: Sequence[Prospect]
) -> FaultProspect:
    i = FAULT_NAMES.index(name)
    having = [single, *(one for one in combined if present(one.faults)[i])]
    shown = bool(single.shown[i])
    sigma = max((float(one.sigma[i]) for one in having if one.shown[i]), default=math.nan)
    scatter = max((float(one.scatter[i]) for one in having if one.shown[i]), default=math.nan)
    error = max((one.error(i) for one in having if one.shown[i]), default=math.nan)
    others = {
        other
        for estimate in single.estimates
        for pair in estimate.alternatives
        for one, other in (pair, pair[::-1])
        if FAULTS[i].label in one
    }
    for estimate in single.estimates:
        others |= {f"{FAULTS[j].label}" for j in claimed(estimate) if j != i}
        others |= {CAUSE_BY_NAME[cause.name].label for cause in estimate.causes}
    for one in combined:
        others |= {FAULTS[j].label for j in _correlated(one, i)}
    return FaultProspect(
        name,
        shown,
        sigma if shown else math.nan,
        scatter if shown else math.nan,
        error if shown else math.nan,
        float(SIGNIFICANT_SIGMAS[i] * healthy.sigma[i]),
        fewest(others),
    )


def fewest(others: Iterable[str]) -> tuple[str, ...]:
    """Return names without those of pairs whose parts are among them."""
    return tuple(
        sorted(
            name
            for name in set(others)
            if " and " not in name or not set(name.split(" and ")) <= set(others)
        )
    )


def claimed(estimate: Estimate) -> list[int]:
    """Return the faults that a usable estimate gives as present."""
    claimed = estimate.valid & ~estimate.insignificant & ~estimate.unobservable
    return [int(i) for i in np.flatnonzero(claimed) if FAULT_NAMES[i] in COMPONENTS]


def _correlated(one: Prospect, i: int) -> list[int]:
    """Return the faults whose estimates are strongly correlated with one."""
    found = []
    for j in range(N_FAULTS):
        if j == i or FAULT_NAMES[j] not in COMPONENTS:
            continue
        for estimate in one.estimates:
            sigma = np.sqrt(np.diag(estimate.covariance))
            if abs(estimate.covariance[i, j]) > STRONG_CORRELATION * sigma[i] * sigma[j]:
                found.append(j)
                break
    return found
