"""What a test will show, before it is made: by rehearsing it (M30)."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from textwrap import wrap
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ema_core.causes import CAUSE_BY_NAME
from ema_core.commands import Command
from ema_core.description import ActuatorDescription
from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS, healthy_faults
from ema_core.wording import text_table
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.design.rehearsal import (
    HALF_WIDTH,
    REHEARSED_WINDOWS,
    FaultProspect,
    Recorder,
    Rehearsed,
    claimed,
    confused_with,
    fewest,
    present,
    rehearse,
)
from ema_monitor.diagnosis import identify
from ema_monitor.identification.estimate import Estimate, plain
from ema_monitor.model.deviations import HIDDEN_CAUSES, Prior
from ema_monitor.model.measured import expected_causes

CERTIFIED_WINDOWS: Final = REHEARSED_WINDOWS + len(HIDDEN_CAUSES)
"""How many windows a certificate takes."""

_WIDTH: Final = 100


class CauseProspect(NamedTuple):
    """What a healthy actuator with one hidden cause of a usual size is taken for.

    ``size`` is in the unit of the cause, ``verdict`` in words: "named", "does not show",
    "named, not separated from ...", "taken for ..." or "refused".
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
    predicted_sigma
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
        """Return in words which of the largest standard deviations wanted, by fault, are passed."""
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
            name: [one._asdict() for one in getattr(self, name)]
            for name in ("faults", "causes", "repeated")
        }
        for row, one in zip(rows["faults"], self.faults, strict=True):
            row |= {"half_width": HALF_WIDTH * one.sigma, "smallest_means": one.meaning}
        return plain(asdict(self) | rows)

    def __str__(self) -> str:
        title = (
            f"{self.actuator_id} ({self.serial_number}): {self.duration:.3g} s of command, "
            f"travel {1e3 * self.travel:.1f} mrad, {1.0 / self.sample_period:.6g} samples/s, "
            f"scatter of a healthy window {_scatter(self.healthy_rms, 'A')} and "
            f"{_scatter(self.healthy_speed_rms, 'rad/s')}"
        )
        parts = [title, self._fault_table(), *self._summary()]
        if self.repeated:
            parts += ["", self._repeated_table()]
        return "\n".join(parts)

    def _fault_table(self) -> str:
        rows = [
            (
                one.label,
                f"{one.sigma:.4f}" if one.shown else "not shown",
                f"{HALF_WIDTH * one.sigma:.4f}" if one.shown else "",
                f"{one.error:.4f}" if one.shown else "",
                f"{one.smallest:.4f}" if math.isfinite(one.smallest) else "",
                one.meaning,
                ", ".join(one.not_told_from),
            )
            for one in self.faults
        ]
        headings = ("fault", "sigma", "90 % ±", "error", "smallest seen")
        return text_table((*headings, "which means", "not separated from"), rows)

    def _summary(self) -> list[str]:
        hidden = [one.label for one in self.faults if not one.shown]
        lines = [
            f"This motion does not show: {', '.join(hidden)}."
            if hidden
            else "This motion shows every fault."
        ]
        wrong = [one.label for one in self.faults if one.error > HALF_WIDTH * one.sigma]
        if wrong:
            lines.append(
                "The errors of the rehearsed estimates are larger than their intervals for: "
                f"{', '.join(wrong)}."
            )
        by_verdict: dict[str, list[str]] = {}
        for one in self.causes:
            cause = CAUSE_BY_NAME[one.name]
            scale, unit = (100.0, "%") if cause.unit == "-" else (1.0, cause.unit)
            size = f"{scale * one.size:.3g} {unit}"
            by_verdict.setdefault(one.verdict, []).append(f"{cause.label} ({size})")
        lines.append("Hidden causes of usual size, alone:")
        for verdict, names in by_verdict.items():
            text = f"{verdict}: {', '.join(names)}"
            lines += wrap(text, _WIDTH, initial_indent="  ", subsequent_indent="    ")
        return lines

    def _repeated_table(self) -> str:
        rows = [
            (
                FAULTS[FAULT_NAMES.index(one.name)].label,
                str(one.windows),
                _figure(one.sigma, 5),
                _figure(one.predicted_sigma / one.sigma if one.sigma else math.nan, 2),
                _figure(one.scatter, 5),
                _figure(one.error, 5),
                _figure(100.0 * one.covers, 0),
            )
            for one in self.repeated
        ]
        headings = ("simulated tests", "windows", "sigma", "predicted", "scatter", "error")
        return text_table((*headings, "90 % covers %"), rows)


def _scatter(value: float, unit: str) -> str:
    return f"{value:.4f} {unit}" if math.isfinite(value) else f"unknown [{unit}]"


def _figure(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def certify(
    record: Recorder,
    command: Command,
    description: ActuatorDescription | None = None,
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
        The actuator; the built-in one when None.
    calibration
        That of the unit; one is made of healthy windows when None.
    repetitions
        Number of further tests that the prediction is compared with, of actuators with several
        faults.

    Raises
    ------
    ValueError
        When the motion makes no window, or does not allow a calibration.
    """
    description = description or ActuatorDescription()
    rehearsed = rehearse(record, command, description, calibration)
    return certificate_of(rehearsed, record, command, description, repetitions=repetitions)


def certificate_of(
    rehearsed: Rehearsed,
    record: Recorder,
    command: Command,
    description: ActuatorDescription,
    *,
    repetitions: int = 0,
) -> Certificate:
    """Return the certificate of a rehearsed test; parameters are as of `certify`."""
    calibration, window = rehearsed.calibration, rehearsed.window
    causes = [
        _cause(
            cause,
            identify(
                record(command, healthy_faults(), 1, {cause.name: cause.sigma})[0],
                description,
                calibration,
            ),
        )
        for cause in expected_causes(description.parameters, window)
    ]
    return Certificate(
        description.actuator_id,
        description.serial_number,
        window.excitation,
        window.sample_period * len(window),
        window.sample_period,
        *calibration.reference(window).scatter,
        rehearsed.faults,
        tuple(causes),
        _repeated(rehearsed, record, command, description, repetitions) if repetitions else (),
    )


def _cause(cause: Prior, estimate: Estimate) -> CauseProspect:
    faults = [FAULTS[i].label for i in claimed(estimate)]
    others = fewest(confused_with(estimate, cause.cause.label))
    named = [one.name for one in estimate.causes]
    wrong = [CAUSE_BY_NAME[name].label for name in named if name != cause.name] + faults
    if not estimate.valid:
        verdict = "refused"
    elif cause.name in named:
        verdict = "named"
        if others:
            verdict += f", not separated from {', '.join(others)}"
        elif faults:
            verdict += f", with {', '.join(faults)}"
    elif others:
        verdict = f"not separated from {', '.join(others)}"
    else:
        verdict = f"taken for {', '.join(wrong)}" if wrong else "does not show"
    return CauseProspect(cause.name, cause.sigma, verdict)


def _repeated(
    rehearsed: Rehearsed,
    record: Recorder,
    command: Command,
    description: ActuatorDescription,
    repetitions: int,
) -> tuple[Repeated, ...]:
    """Return what tests of some actuators give, identified without knowing their faults."""
    prospects = rehearsed.combined
    found = []
    for number, one in enumerate(prospects):
        count = (repetitions + number) // len(prospects)
        windows = record(command, one.faults, count, {})
        found.append([identify(window, description, rehearsed.calibration) for window in windows])
    rows = []
    for name in COMPONENTS:
        i = FAULT_NAMES.index(name)
        groups = [
            (one, [estimate for estimate in estimates if i in claimed(estimate)])
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
