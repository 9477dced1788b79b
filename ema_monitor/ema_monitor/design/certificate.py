"""What a test will show, in figures and in words."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from textwrap import wrap
from typing import Any, Final, NamedTuple

from ema_core.causes import CAUSE_BY_NAME
from ema_core.faults import FAULT_NAMES, FAULTS
from ema_core.wording import text_table
from ema_monitor.design.rehearsal import HALF_WIDTH, FaultProspect
from ema_monitor.identification.estimate import plain_number

_WIDTH: Final = 100


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
            + (
                f"{self.healthy_speed_rms:.4f} rad/s"
                if math.isfinite(self.healthy_speed_rms)
                else "none in speed"
            )
        )
        parts = [title, _fault_table(self.faults), *_summary(self.faults, self.causes)]
        if self.repeated:
            parts += ["", _repeated_table(self.repeated)]
        return "\n".join(parts)


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
