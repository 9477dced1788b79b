"""What a test will show, told before any is made: by rehearsing it (M30)."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from textwrap import wrap
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.causes import CAUSE_BY_NAME
from ema_core.commands import Command
from ema_core.description import ActuatorDescription
from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS, N_FAULTS, healthy_faults
from ema_core.wording import text_table
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate
from ema_monitor.design.prediction import Prospect, prospect
from ema_monitor.design.states import (
    N_COMBINED,
    Recorder,
    combined_faults,
    present,
    single_faults,
)
from ema_monitor.identification.estimate import Estimate, plain_number
from ema_monitor.identification.search import identify
from ema_monitor.identification.uncertainty import SIGNIFICANT_SIGMAS
from ema_monitor.model.deviations import Prior, hidden_causes

HALF_WIDTH: Final = 1.645
"""Half-width of a 90 % interval [standard deviations]."""

_HEALTHY: Final = 12
_SINGLE: Final = 2
_COMBINED: Final = 6
_STRONG_CORRELATION: Final = 0.95
_WIDTH: Final = 100


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
    def meaning(self) -> str:
        """The smallest fault that shows, in physical terms."""
        fault = FAULTS[FAULT_NAMES.index(self.name)]
        if not math.isfinite(self.smallest):
            return ""
        text = fault.physical(min(fault.healthy + self.smallest, fault.highest))
        if fault.is_two_sided:
            text += f" or {fault.at(max(fault.healthy - self.smallest, 0.0)):.3f}"
        return text


class CauseProspect(NamedTuple):
    """What a healthy actuator with one hidden cause of a usual size is taken for.

    ``size`` is in the unit of the cause, ``verdict`` in words: "named", "does not show",
    "named, not told from ...", "taken for ..." or "refused".
    """

    name: str
    size: float
    verdict: str


class Repeated(NamedTuple):
    """What many simulated tests of actuators with several faults gave for one fault.

    Attributes
    ----------
    name, windows
        The fault, and in how many windows it was present and found.
    predicted_sigma, predicted_scatter
        What was predicted for these actuators, root mean square over them [-].
    sigma, scatter, error
        Standard deviation that the estimates stated, that they have about the mean of each
        actuator, and rms of their errors [-].
    covers
        Share of the stated 90 % intervals that hold the truth [-].
    """

    name: str
    windows: int
    predicted_sigma: float
    sigma: float
    predicted_scatter: float
    scatter: float
    error: float
    covers: float


@dataclass(frozen=True)
class Certificate:
    """What a test of an actuator will show.

    Attributes
    ----------
    actuator_id, serial_number
        The actuator.
    travel, duration, sample_period
        Of the command [rad, s], and of the telemetry [s].
    healthy_rms, healthy_speed_rms
        Scatter of a healthy window in its band [A, rad/s].
    faults, causes
        What is expected of each fault and each hidden cause.
    repeated
        What many simulated tests gave; empty where there were none.
    """

    actuator_id: str
    serial_number: str
    travel: float
    duration: float
    sample_period: float
    healthy_rms: float
    healthy_speed_rms: float
    faults: tuple[FaultProspect, ...]
    causes: tuple[CauseProspect, ...]
    repeated: tuple[Repeated, ...] = ()

    def sigma(self, name: str) -> float:
        """Return the standard deviation that is expected of a fault; NaN where it is not shown."""
        return next(one.sigma for one in self.faults if one.name == name)

    def unmet(self, wanted: Mapping[str, float]) -> list[str]:
        """Return in words which wanted standard deviations are not reached.

        Parameters
        ----------
        wanted
            Largest standard deviations by fault [-].
        """
        words = []
        for name, sigma in wanted.items():
            reached = self.sigma(name)
            label = FAULTS[FAULT_NAMES.index(name)].label
            if not math.isfinite(reached):
                words.append(f"{label} is not shown, sigma {sigma:g} is wanted")
            elif reached > sigma:
                words.append(f"{label} has sigma {reached:.4f}, {sigma:g} is wanted")
        return words

    def record(self) -> dict[str, Any]:
        """Return all fields as plain values; what is not a number is None."""
        rows = {
            name: [
                {key: plain_number(value) for key, value in one._asdict().items()}
                for one in getattr(self, name)
            ]
            for name in ("faults", "causes", "repeated")
        }
        for row, one in zip(rows["faults"], self.faults, strict=True):
            row["half_width"] = plain_number(HALF_WIDTH * one.sigma)
            row["smallest_means"] = one.meaning
        return {name: plain_number(value) for name, value in asdict(self).items()} | rows

    def __str__(self) -> str:
        title = (
            f"{self.actuator_id} ({self.serial_number}): {self.duration:.3g} s of command, "
            f"travel {1e3 * self.travel:.1f} mrad, {1.0 / self.sample_period:.6g} samples/s, "
            f"scatter of a healthy window {self.healthy_rms:.4f} A and "
            f"{self.healthy_speed_rms:.4f} rad/s"
        )
        parts = [title, _fault_table(self.faults), *_summary(self.faults, self.causes)]
        if self.repeated:
            parts += ["", _repeated_table(self.repeated)]
        return "\n".join(parts)


def certify(
    record: Recorder,
    command: Command,
    description: ActuatorDescription,
    calibration: Calibration | None = None,
    *,
    repetitions: int = 0,
) -> Certificate:
    """Return what a test will show, from windows of actuators with known faults.

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
    repetitions
        Number of further tests that the prediction is compared with, of actuators with several
        faults.

    Raises
    ------
    ValueError
        When the motion makes no window, or the calibration does not fit.
    """
    healthy = record(command, healthy_faults(), _HEALTHY, {})
    calibration = calibration or calibrate(healthy, description)

    def of(faults: NDArray[np.float64], count: int) -> Prospect:
        return prospect(record(command, faults, count, {}), faults, description, calibration)

    at_rest = prospect(healthy[:_SINGLE], healthy_faults(), description, calibration)
    singles = {name: of(faults, _SINGLE) for name, faults in single_faults().items()}
    combined = [of(combined_faults(number), _COMBINED) for number in range(N_COMBINED)]
    travel = healthy[0].excitation
    causes = [
        _cause(
            cause,
            identify(
                record(command, healthy_faults(), 1, {cause.name: cause.sigma})[0],
                description,
                calibration,
            ),
        )
        for cause in hidden_causes(description.parameters, travel)
    ]
    scatter, speed_scatter = calibration.scatter(healthy[0])
    return Certificate(
        description.actuator_id,
        description.serial_number,
        travel,
        healthy[0].sample_period * len(healthy[0]),
        healthy[0].sample_period,
        scatter,
        speed_scatter,
        tuple(_fault(name, at_rest, singles[name], combined) for name in COMPONENTS),
        tuple(causes),
        _repeated(record, command, description, calibration, combined, repetitions)
        if repetitions
        else (),
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
        others |= {f"{FAULTS[j].label}" for j in _claimed(estimate) if j != i}
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
        _fewest(others),
    )


def _fewest(others: Iterable[str]) -> tuple[str, ...]:
    """Return names without those of pairs whose parts are among them."""
    return tuple(
        sorted(
            name
            for name in set(others)
            if " and " not in name or not set(name.split(" and ")) <= set(others)
        )
    )


def _claimed(estimate: Estimate) -> list[int]:
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
            if abs(estimate.covariance[i, j]) > _STRONG_CORRELATION * sigma[i] * sigma[j]:
                found.append(j)
                break
    return found


def _cause(cause: Prior, estimate: Estimate) -> CauseProspect:
    claimed = [FAULTS[i].label for i in _claimed(estimate)]
    label = cause.cause.label
    others = {
        other for pair in estimate.alternatives for one, other in (pair, pair[::-1]) if one == label
    }
    named = [one.name for one in estimate.causes]
    wrong = [CAUSE_BY_NAME[name].label for name in named if name != cause.name] + claimed
    if not estimate.valid:
        verdict = "refused"
    elif cause.name in named:
        verdict = "named"
        if others:
            verdict += f", not told from {', '.join(_fewest(others))}"
        elif claimed:
            verdict += f", with {', '.join(claimed)}"
    elif others:
        verdict = f"not told from {', '.join(_fewest(others))}"
    else:
        verdict = f"taken for {', '.join(wrong)}" if wrong else "does not show"
    return CauseProspect(cause.name, cause.sigma, verdict)


def _repeated(
    record: Recorder,
    command: Command,
    description: ActuatorDescription,
    calibration: Calibration,
    prospects: Sequence[Prospect],
    repetitions: int,
) -> tuple[Repeated, ...]:
    """Return what tests of some actuators give, identified without knowing their faults."""
    found = []
    for number, one in enumerate(prospects):
        count = (repetitions + number) // len(prospects)
        windows = record(command, one.faults, count, {})
        found.append([identify(window, description, calibration) for window in windows])
    rows = []
    for name in COMPONENTS:
        i = FAULT_NAMES.index(name)
        groups = [
            (one, [estimate for estimate in estimates if i in _claimed(estimate)])
            for one, estimates in zip(prospects, found, strict=True)
            if present(one.faults)[i]
        ]
        groups = [(one, estimates) for one, estimates in groups if len(estimates) > 1]
        errors = [np.array([e.faults[i] for e in those]) - one.faults[i] for one, those in groups]
        sigmas = [np.array([e.sigma[i] for e in those]) for _, those in groups]
        rows.append(
            Repeated(
                name,
                sum(map(len, errors)),
                _rms([one.sigma[i] for one, _ in groups]),
                _rms([_rms(values) for values in sigmas]),
                _rms([one.scatter[i] for one, _ in groups]),
                _rms([np.std(values, ddof=1) for values in errors]),
                _rms([_rms(values) for values in errors]),
                float(
                    np.mean(np.abs(np.concatenate(errors)) <= HALF_WIDTH * np.concatenate(sigmas))
                )
                if groups
                else math.nan,
            )
        )
    return tuple(rows)


def _rms(values: ArrayLike) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else math.nan


def _fault_table(faults: Sequence[FaultProspect]) -> str:
    rows = [
        (
            FAULTS[FAULT_NAMES.index(one.name)].label,
            f"{one.sigma:.4f}" if one.shown else "not shown",
            f"{HALF_WIDTH * one.sigma:.4f}" if one.shown else "",
            f"{one.error:.4f}" if one.shown else "",
            f"{one.smallest:.4f}" if math.isfinite(one.smallest) else "",
            one.meaning,
            ", ".join(one.not_told_from),
        )
        for one in faults
    ]
    headings = (
        "fault",
        "sigma",
        "90 % ±",
        "error",
        "smallest seen",
        "which means",
        "not told from",
    )
    return text_table(headings, rows)


def _summary(faults: Sequence[FaultProspect], causes: Sequence[CauseProspect]) -> list[str]:
    labels = {one: FAULTS[FAULT_NAMES.index(one.name)].label for one in faults}
    hidden = [label for one, label in labels.items() if not one.shown]
    lines = [
        f"This motion does not show: {', '.join(hidden)}."
        if hidden
        else "This motion shows every fault."
    ]
    wrong = [label for one, label in labels.items() if one.error > HALF_WIDTH * one.sigma]
    if wrong:
        lines.append(
            "The errors of the rehearsed estimates are larger than their intervals for: "
            f"{', '.join(wrong)}."
        )
    by_verdict: dict[str, list[str]] = {}
    for one in causes:
        cause = CAUSE_BY_NAME[one.name]
        scale, unit = (100.0, "%") if cause.unit == "-" else (1.0, cause.unit)
        size = f"{scale * one.size:.3g} {unit}"
        by_verdict.setdefault(one.verdict, []).append(f"{cause.label} ({size})")
    lines.append("Hidden causes of usual size, alone:")
    for verdict, names in by_verdict.items():
        text = f"{verdict}: {', '.join(names)}"
        lines += wrap(text, _WIDTH, initial_indent="  ", subsequent_indent="    ")
    return lines


def _repeated_table(repeated: Sequence[Repeated]) -> str:
    rows = []
    for one in repeated:
        figures = [str(one.windows)]
        for predicted, found in (
            (one.predicted_sigma, one.sigma),
            (one.predicted_scatter, one.scatter),
        ):
            figures += [_figure(found, 5), _figure(predicted / found if found else math.nan, 2)]
        figures += [_figure(one.error, 5), _figure(100.0 * one.covers, 0)]
        rows.append((FAULTS[FAULT_NAMES.index(one.name)].label, *figures))
    headings = ("simulated tests", "windows", "sigma", "predicted", "scatter", "predicted")
    return text_table((*headings, "error", "90 % covers %"), rows)


def _figure(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"
