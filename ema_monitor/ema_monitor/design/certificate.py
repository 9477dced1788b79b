# SPDX-License-Identifier: Apache-2.0
"""Certificate of a test: its expected results, from a rehearsal (M30)."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from textwrap import wrap
from types import NoneType
from typing import Any, Final, NamedTuple

from ema_core.causes import CAUSE_BY_NAME
from ema_core.commands import Command
from ema_core.description import ActuatorDescription
from ema_core.expecting import require_type, value_or_default
from ema_core.faults import FAULT_NAMES, FAULTS, healthy_faults
from ema_core.labels import label_of
from ema_core.wording import text_table
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.design.rehearsal import (
    HALF_WIDTH,
    REHEARSED_WINDOWS,
    RIG_HINT,
    ActuatorRig,
    FaultProspect,
    Rehearsed,
    claimed,
    confused_with,
    fewest,
    rehearse,
)
from ema_monitor.diagnosis import identify
from ema_monitor.identification.alternatives import Part
from ema_monitor.identification.estimate import Estimate, plain
from ema_monitor.model.deviations import HIDDEN_CAUSES, Prior
from ema_monitor.model.measured import expected_causes
from ema_monitor.reason_texts import part_label

CERTIFIED_WINDOWS: Final = REHEARSED_WINDOWS + len(HIDDEN_CAUSES)
"""Number of windows of a certificate."""

_WIDTH: Final = 100


class Naming(StrEnum):
    """Attribution of a hidden cause by an estimate."""

    NAMED = "named"
    """The estimate names the cause."""
    NOT_SEPARATED = "not separated"
    """The estimate names something from which the window cannot separate the cause."""
    MISTAKEN = "mistaken"
    """The estimate explains the window by other causes or faults."""
    HIDDEN = "hidden"
    """The estimate shows a healthy actuator."""
    REFUSED = "refused"
    """There is no valid estimate."""


class CauseProspect(NamedTuple):
    """Expected test result of a healthy actuator with one hidden cause of a usual size."""

    name: str
    """Name of the cause."""
    size: float
    """Size of the cause in its unit."""
    naming: Naming
    """Attribution of the cause by the estimate."""
    not_told_from: tuple[Part, ...] = ()
    """Faults and causes that the test cannot separate from the cause, each a tuple of names."""
    beside: tuple[str, ...] = ()
    """Names of the other causes and faults in the estimate."""

    @property
    def meaning(self) -> str:
        """Sentence fragment that describes the attribution of the cause."""
        confused = ", ".join(map(part_label, self.not_told_from))
        faults = [name for name in self.beside if name in FAULT_NAMES]
        match self.naming:
            case Naming.NAMED if confused:
                return f"named, not separated from {confused}"
            case Naming.NAMED if faults:
                return f"named, with {', '.join(map(label_of, faults))}"
            case Naming.NOT_SEPARATED:
                return f"not separated from {confused}"
            case Naming.MISTAKEN:
                return f"mistaken for {', '.join(map(label_of, self.beside))}"
            case Naming.HIDDEN:
                return "does not show"
        return self.naming.value


@dataclass(frozen=True)
class Certificate:
    """Expected results of a test of an actuator."""

    actuator_id: str
    serial_number: str
    travel: float
    """Travel of the command, from end to end [rad]."""
    duration: float
    """Duration of the command [s]."""
    sample_period: float
    """Sample period of the telemetry [s]."""
    healthy_rms: float
    """Standard deviation of the band-limited current of healthy windows [A]."""
    healthy_speed_rms: float
    """Standard deviation of the band-limited speed of healthy windows [rad/s]."""
    faults: tuple[FaultProspect, ...]
    """Expected result for each fault."""
    causes: tuple[CauseProspect, ...]
    """Expected result for each hidden cause."""

    def sigma(self, name: str) -> float:
        """Return the expected standard deviation of a fault; NaN if it is not detected."""
        return next(fault.sigma for fault in self.faults if fault.name == name)

    def unmet(self, wanted: Mapping[str, float]) -> list[str]:
        """Return a message for each fault that misses its wanted standard deviation [-].

        This includes faults that the test does not detect, whose standard deviation is NaN.
        """
        messages = []
        for name, sigma in wanted.items():
            reached = self.sigma(name)
            label = FAULTS[FAULT_NAMES.index(name)].label
            if not math.isfinite(reached):
                messages.append(f"{label} is not shown, expected sigma {sigma:g} or less")
            elif reached > sigma:
                messages.append(f"{label} has sigma {reached:.4f}, expected {sigma:g} or less")
        return messages

    def record(self) -> dict[str, Any]:
        """Return all fields as plain values; NaN becomes None."""
        rows = {
            name: [fault._asdict() for fault in getattr(self, name)]
            for name in ("faults", "causes")
        }
        for row, fault in zip(rows["faults"], self.faults, strict=True):
            row |= {"half_width": HALF_WIDTH * fault.sigma, "smallest_means": fault.meaning}
        for row, cause in zip(rows["causes"], self.causes, strict=True):
            row["meaning"] = cause.meaning
        return plain(asdict(self) | rows)

    def __str__(self) -> str:
        title = (
            f"{self.actuator_id} ({self.serial_number}): {self.duration:.3g} s of command, "
            f"travel {1e3 * self.travel:.1f} mrad, {1.0 / self.sample_period:.6g} samples/s, "
            f"scatter of a healthy window {_scatter(self.healthy_rms, 'A')} and "
            f"{_scatter(self.healthy_speed_rms, 'rad/s')}"
        )
        return "\n".join([title, self._fault_table(), *self._summary()])

    def _fault_table(self) -> str:
        rows = [
            (
                fault.label,
                f"{fault.sigma:.4f}" if fault.shown else "not shown",
                f"{HALF_WIDTH * fault.sigma:.4f}" if fault.shown else "",
                f"{fault.error:.4f}" if fault.shown else "",
                f"{fault.smallest:.4f}" if math.isfinite(fault.smallest) else "",
                fault.meaning,
                ", ".join(map(part_label, fault.not_told_from)),
            )
            for fault in self.faults
        ]
        headings = ("fault", "sigma", "90 % ±", "error", "smallest seen")
        return text_table((*headings, "which means", "not separated from"), rows)

    def _summary(self) -> list[str]:
        hidden = [fault.label for fault in self.faults if not fault.shown]
        lines = [
            f"This motion does not show: {', '.join(hidden)}."
            if hidden
            else "This motion shows every fault."
        ]
        wrong = [fault.label for fault in self.faults if fault.error > HALF_WIDTH * fault.sigma]
        if wrong:
            lines.append(
                "The errors of the rehearsed estimates are larger than their intervals for: "
                f"{', '.join(wrong)}."
            )
        by_meaning: dict[str, list[str]] = {}
        for prospect in self.causes:
            cause = CAUSE_BY_NAME[prospect.name]
            scale, unit = (100.0, "%") if cause.unit == "-" else (1.0, cause.unit)
            size = f"{scale * prospect.size:.3g} {unit}"
            by_meaning.setdefault(prospect.meaning, []).append(f"{cause.label} ({size})")
        lines.append("Hidden causes of usual size, alone:")
        for meaning, names in by_meaning.items():
            text = f"{meaning}: {', '.join(names)}"
            lines += wrap(text, _WIDTH, initial_indent="  ", subsequent_indent="    ")
        return lines


def _scatter(value: float, unit: str) -> str:
    return f"{value:.4f} {unit}" if math.isfinite(value) else f"unknown [{unit}]"


def certify(
    rig: ActuatorRig,
    command: Command,
    description: ActuatorDescription | None = None,
    calibration: Calibration | None = None,
    *,
    rehearsed: Rehearsed | None = None,
) -> Certificate:
    """Return the certificate of a test: which faults it shows, and with which standard deviation.

    It is computed from windows of actuators with known faults.

    Parameters
    ----------
    rig
        Runs the tests, usually in simulation.
    command
        Command of the test.
    description
        The actuator; None for the built-in actuator.
    calibration
        Calibration of the unit; None to calibrate on healthy windows.
    rehearsed
        Rehearsal of the test; None to rehearse it.

    Raises
    ------
    ValueError
        If an argument has a wrong type, or the motion gives no window or does not permit a
        calibration.
    """
    require_type("rig", rig, ActuatorRig, RIG_HINT)
    require_type("command", command, Command)
    description = value_or_default(
        "description", description, ActuatorDescription, ActuatorDescription
    )
    require_type("calibration", calibration, (Calibration, NoneType))
    rehearsed = rehearsed or rehearse(rig, command, description, calibration)
    calibration, window = rehearsed.calibration, rehearsed.window
    causes = [
        _cause(
            cause,
            identify(
                rig(command, healthy_faults(), 1, {cause.name: cause.sigma})[0],
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
    )


def _cause(cause: Prior, estimate: Estimate) -> CauseProspect:
    named = [item.name for item in estimate.causes]
    confused = tuple(fewest(confused_with(estimate, cause.name)))
    beside = tuple(name for name in named if name != cause.name)
    beside += tuple(FAULT_NAMES[number] for number in claimed(estimate))
    if not estimate.valid:
        naming = Naming.REFUSED
    elif cause.name in named:
        naming = Naming.NAMED
    elif confused:
        naming = Naming.NOT_SEPARATED
    else:
        naming = Naming.MISTAKEN if beside else Naming.HIDDEN
    return CauseProspect(cause.name, cause.sigma, naming, confused, beside)
