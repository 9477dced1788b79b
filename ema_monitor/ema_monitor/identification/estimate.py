# SPDX-License-Identifier: Apache-2.0
"""Estimate of the faults in a window, or a refusal, and its conversion to values for JSON."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import Any, Final

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.causes import CauseEstimate
from ema_core.display import Displayed
from ema_core.faults import FAULT_NAMES, FAULTS, INDICES, N_FAULTS, FaultVector, healthy_faults
from ema_core.wording import text_table
from ema_monitor.identification.alternatives import Alternative, alternative_of
from ema_monitor.identification.quantiles import LEVELS, quantiles_of
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.joint.comparison import Comparison
from ema_monitor.joint.window_figures import WindowFigures, figures_of_row, row_of
from ema_monitor.joint.wording import finding, summary, table_text
from ema_monitor.reason_texts import joined, text_of
from ema_monitor.reasons import Learning, OtherUnit, Reason
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

INVERSE_DYNAMICS: Final = "inverse_dynamics"
"""Algorithm name of estimates that compare a record with a baseline."""

_UNKNOWN: Final = FaultVector.of(np.full(N_FAULTS, math.nan))
_FLAGS: Final = ("unobservable", "insignificant")
_CAUSES: Final = ("causes", "measured")
# Fields that records of earlier versions may lack.
_LATER: Final = ("lacks_calibration", "parts", "comparison", "reasons")
_SHAPES: Final = {
    "covariance": (N_FAULTS, N_FAULTS),
    "quantiles": (len(LEVELS), N_FAULTS),
    "probability": (N_FAULTS,),
}


class Verdict(StrEnum):
    """Verdict on an estimate, in the order of its numbers in the message ``FaultEstimate``."""

    VALID = "valid"
    """Usable."""
    DEGRADED = "degraded"
    """Usable, with increased standard deviations; ``Estimate.reasons`` state the causes."""
    REFUSED = "refused"
    """Not usable."""
    FAILED = "failed"
    """Not usable because of a failure of drive or shaft."""
    SKIPPED = "skipped"
    """The window was cut off or dropped, and not examined; or it is the short end of a motion whose
    records were compared."""
    DEPARTED = "departed"
    """The window departs from the healthy windows of the unit as stated in
    ``Estimate.reasons``, and no fault explains the departure; the estimate may be valid or not."""


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Displayed):
    """The faults identified in a window, or in several combined stretches of ordinary motion.

    For an estimate from stretches, "window" means all stretches together.
    """

    start_ns: int
    """Timestamp of the first sample of the window [ns]."""
    end_ns: int
    """Timestamp of the last sample of the window [ns]."""
    algorithm: str
    """Name of the optimizer, or ``INVERSE_DYNAMICS``."""
    seed: int
    """Seed of the optimizer's random numbers."""
    calibration_id: str
    """Identifier of the calibration; empty without a calibration."""
    faults: FaultVector = _UNKNOWN
    """Fault vector, ``(8,)``; NaN without an estimate."""
    covariance: Array = field(default_factory=lambda: np.full((N_FAULTS, N_FAULTS), math.nan))
    """Covariance of the faults, ``(8, 8)``; NaN in rows and columns of unobservable components."""
    unobservable: Flags = field(default_factory=lambda: np.ones(N_FAULTS, dtype=bool))
    """Flags of the components that the window does not determine, ``(8,)``."""
    quantiles: Array = field(default_factory=lambda: np.full(_SHAPES["quantiles"], math.nan))
    """Quantiles of the faults at 5, 25, 50, 75 and 95 %, ``(5, 8)``; NaN if unobservable. Values
    that are not passed are computed from a normal distribution."""
    probability: Array = field(default_factory=lambda: np.full(N_FAULTS, math.nan))
    """Probability that each fault is present, ``(8,)``; NaN if unobservable. Values that are not
    passed are 0 or 1, depending on the significance."""
    play_offset: float = math.nan
    """Position of the motor within its play at the start [half-widths]."""
    fitness: float = math.nan
    """Cost at the estimate [A^2.s]; for stretches, the sum."""
    goodness_of_fit: float = math.nan
    """Band-limited rms residual relative to a healthy window; the larger value of current and speed
    [-]. NaN if the calibration does not include the residuals of a healthy window."""
    goodness_limit: float = math.nan
    """Largest goodness of fit at which the faults explain the window [-]."""
    excitation: float = math.nan
    """Peak-to-peak range of the command [rad], or of the position in a record or a window without a
    command; for stretches, the largest range. NaN for a refusal without a window."""
    evaluations: int = 0
    """Number of model evaluations."""
    computing_time: float = 0.0
    """Time from window to estimate [s]."""
    valid: bool = False
    """Whether the estimate may be used."""
    reasons: tuple[Reason, ...] = ()
    """Reasons for the verdict, and reservations. The findings of a record are in ``comparison``."""
    insignificant: Flags = field(default_factory=lambda: np.zeros(N_FAULTS, dtype=bool))
    """Flags of the components that do not differ significantly from healthy, ``(8,)``. Faults
    within one standard deviation of healthy are added on construction."""
    warm_start: bool = False
    """Whether the search began at the faults of an earlier window."""
    calibration_windows: int = 0
    """Number of healthy windows of the calibration; 0 without a calibration."""
    verdict: Verdict = Verdict.VALID
    """Verdict on the estimate."""
    unexplained_share: float = math.nan
    """Share of the window's departure from healthy that the estimate does not explain [-]; NaN if
    ``goodness_of_fit`` is NaN."""
    causes: tuple[CauseEstimate, ...] = ()
    """Hidden causes that are part of the explanation. For stretches, each value comes from the
    stretch in which the cause is most significant, and ``reasons`` state its range."""
    alternatives: tuple[Alternative, ...] = ()
    """Parts of the explanation, and replacements that the window cannot distinguish from them."""
    stretches: int = 0
    """Number of combined stretches of ordinary motion; 0 for a single test window."""
    measured: tuple[CauseEstimate, ...] = ()
    """Measured causes that were used. For stretches, each value comes from the stretch in which the
    cause is most significant."""
    lacks_calibration: bool = False
    """Whether the window was refused because no calibration matches the actuator and window."""
    parts: tuple[WindowFigures, ...] = ()
    """Figures of the window, or of each stretch, if the calibration has a baseline of windows."""
    comparison: Comparison | None = None
    """Comparison of the record with the baseline of its unit; None for a modelled drive or a record
    that could not be read."""

    @property
    def is_learning(self) -> bool:
        """Whether the unit has no baseline yet, and the record only contributes to it."""
        return any(isinstance(reason, Learning) for reason in self.reasons)

    def __post_init__(self) -> None:
        is_within = np.abs(np.subtract(self.faults, healthy_faults())) <= np.asarray(self.sigma)
        insignificant = self.insignificant.copy()
        insignificant[INDICES] |= is_within[INDICES]
        object.__setattr__(self, "insignificant", insignificant)
        defaults = {
            "quantiles": quantiles_of(np.ones(1), np.array([self.faults]), np.array([self.sigma])),
            "probability": ~insignificant,
        }
        for name, values in defaults.items():
            stated = getattr(self, name)
            filled = np.where(np.isnan(stated), values, stated)
            object.__setattr__(self, name, np.where(self.unobservable, math.nan, filled))

    @property
    def reason(self) -> str:
        """Reasons as one string, including the findings of a record; empty if there are none."""
        if self.comparison is None or not self.valid:
            return joined(self.reasons)
        caveats = [reason for reason in self.reasons if isinstance(reason, OtherUnit)]
        remarks = [reason for reason in self.reasons if reason not in caveats]
        sentences = *map(text_of, caveats), summary(self.comparison), *map(text_of, remarks)
        return ". ".join(sentences)

    @property
    def sigma(self) -> FaultVector:
        """Standard deviations of the faults; NaN if unobservable."""
        return FaultVector.of(np.sqrt(np.diag(self.covariance)))

    @property
    def found(self) -> Flags:
        """Flags of the components that differ significantly from healthy, ``(8,)``."""
        return ~(self.insignificant | self.unobservable)

    @property
    def meanings(self) -> tuple[str, ...]:
        """Description of the physical meaning of each fault."""
        return tuple(
            "not shown"
            if is_unknown
            else fault.physical(value)
            if is_found
            else "healthy (not significant)"
            for fault, value, is_found, is_unknown in zip(
                FAULTS, self.faults, self.found, self.unobservable, strict=True
            )
        )

    @property
    def is_of_record(self) -> bool:
        """Whether the estimate results from the comparison of a record with a baseline."""
        return self.algorithm == INVERSE_DYNAMICS

    @property
    def departure(self) -> str:
        """Description of the departure from the healthy tests of the unit; empty without one."""
        if self.verdict != Verdict.DEPARTED:
            return ""
        return self.reason if self.comparison is None else finding(self.comparison)

    @property
    def brief(self) -> str:
        """Short string with the verdict, and with the faults that differ from healthy.

        For a compared record it contains the findings instead, for a refusal the reason.
        """
        if self.comparison is not None:
            return f"{self.verdict}, {finding(self.comparison)}"
        if not self.valid:
            return f"{self.verdict}, {self.reason}"
        faults = [
            f"{fault.label} {value:.4f} ± {sigma:.2g}"
            for fault, value, sigma, is_found in zip(
                FAULTS, self.faults, self.sigma, self.found, strict=True
            )
            if is_found
        ]
        return f"{self.verdict}, {', '.join(faults) or 'no fault differs from healthy'}"

    def as_row(self) -> dict[str, Any]:
        """Return the estimate as a table row: plain values by column name."""
        row = {
            name: value
            for name, value in vars(self).items()
            if isinstance(value, int | float | str)
        }
        row["verdict"], row["reason"] = str(self.verdict), self.reason
        sigmas = {f"{name}_sigma": value for name, value in self.sigma._asdict().items()}
        return row | self.faults._asdict() | sigmas

    def __str__(self) -> str:
        if self.comparison is not None:
            table = table_text(self.comparison)
            return "\n".join(filter(None, (table, self.verdict, self.reason)))
        if not self.valid:
            return f"no valid estimate: {self.reason}"
        rows = [
            (
                fault.label,
                f"{value:.4f}",
                "unobservable" if np.isnan(low) else f"{low:.4f} to {high:.4f}",
                meaning,
            )
            for fault, value, low, high, meaning in zip(
                FAULTS, self.faults, *self.quantiles[[0, -1]], self.meanings, strict=True
            )
        ]
        table = text_table(("fault", "estimate", "90 % interval", "which means"), rows)
        fit = f"goodness of fit {self.goodness_of_fit:.2f} (limit {self.goodness_limit:.2f})"
        measured = f"measured: {'; '.join(map(str, self.measured))}" if self.measured else ""
        return "\n".join(filter(None, (table, f"{self.verdict}, {fit}", measured, self.reason)))


def refusal(
    window: Window | Refusal,
    calibration: Any,
    settings: SearchSettings,
    reason: Reason,
    *,
    is_failure: bool = False,
    lacks_calibration: bool = False,
) -> Estimate:
    """Return the estimate of a window whose faults cannot be identified.

    Parameters
    ----------
    window
        The window, or the refusal of the window.
    calibration
        Calibration of any kind, or the reason why there is none.
    settings
        Settings of the search.
    reason
        Reason why the faults cannot be identified.
    is_failure
        Whether drive or shaft has failed.
    lacks_calibration
        Whether no calibration matches the actuator and window.
    """
    verdict = Verdict.FAILED if is_failure else Verdict.REFUSED
    if isinstance(window, Refusal) and (window.is_dropped or window.is_cut_off):
        verdict = Verdict.SKIPPED
    is_calibrated = not isinstance(calibration, Reason)
    return Estimate(
        window.start_ns,
        window.end_ns,
        settings.algorithm,
        settings.seed,
        calibration.calibration_id if is_calibrated else "",
        goodness_limit=settings.goodness_limit,
        excitation=window.excitation if isinstance(window, Window) else math.nan,
        reasons=(reason,),
        calibration_windows=calibration.windows if is_calibrated else 0,
        verdict=verdict,
        lacks_calibration=lacks_calibration,
    )


def estimate_values(estimate: Estimate) -> dict[str, Any]:
    """Return all fields of an estimate, and its ``reason``, as plain Python values by name.

    Numbers are not rounded. Faults become a mapping by name; flags become a list of the flagged
    faults.
    """
    values = {item.name: getattr(estimate, item.name) for item in fields(Estimate)}
    values["faults"] = estimate.faults._asdict()
    for name in _SHAPES:
        values[name] = values[name].tolist()
    for name in _FLAGS:
        values[name] = [FAULT_NAMES[number] for number in np.flatnonzero(values[name])]
    for name in _CAUSES:
        values[name] = [cause._asdict() for cause in values[name]]
    values["verdict"] = str(estimate.verdict)
    values["alternatives"] = [pair.as_record() for pair in estimate.alternatives]
    values["reason"] = estimate.reason
    values["reasons"] = [reason.as_record() for reason in estimate.reasons]
    values["parts"] = [row_of(part) for part in estimate.parts]
    compared = estimate.comparison
    values["comparison"] = None if compared is None else compared.as_mapping()
    return {
        name: value.item() if isinstance(value, np.generic) else value
        for name, value in values.items()
    }


def estimate_record(estimate: Estimate) -> dict[str, Any]:
    """Return an estimate as values for JSON, which has neither NaN nor infinity.

    As in ``estimate_values``, but NaN becomes None, and infinite numbers become strings.
    """
    return plain(estimate_values(estimate))


def estimate_of(record: Mapping[str, Any]) -> Estimate:
    """Return an estimate from the result of ``estimate_values`` or ``estimate_record``.

    Raises
    ------
    ValueError, KeyError, TypeError
        If ``record`` does not describe an estimate.
    """
    values = {item.name: record[item.name] for item in fields(Estimate) if item.name not in _LATER}
    for item in fields(Estimate):
        if item.type is float:
            values[item.name] = read_number(values[item.name])
    values["faults"] = FaultVector(*(read_number(record["faults"][name]) for name in FAULT_NAMES))
    for name in _SHAPES:
        # None becomes NaN.
        values[name] = np.array(record[name], dtype=np.float64)
        if values[name].shape != _SHAPES[name]:
            raise ValueError(f"{name} has shape {values[name].shape}, expected {_SHAPES[name]}")
    for name in _FLAGS:
        values[name] = np.isin(FAULT_NAMES, record[name])
    for name in _CAUSES:
        values[name] = tuple(CauseEstimate(**cause) for cause in record[name])
    values["verdict"] = Verdict(record["verdict"])
    values["alternatives"] = tuple(map(alternative_of, record["alternatives"]))
    values["reasons"] = reasons_of(record)
    values["lacks_calibration"] = bool(record.get("lacks_calibration", False))
    values["parts"] = tuple(figures_of_row(row) for row in record.get("parts", ()))
    compared = record.get("comparison")
    values["comparison"] = None if compared is None else Comparison.of_mapping(compared)
    return Estimate(**values)


def reasons_of(record: Mapping[str, Any]) -> tuple[Reason, ...]:
    """Return the reasons in the record of an estimate, or of a test without an estimate."""
    return tuple(map(Reason.of_record, record["reasons"]))


def by_fault(values: Iterable[float]) -> dict[str, Any]:
    """Return the values of the eight faults by name; NaN becomes None."""
    return dict(zip(FAULT_NAMES, map(plain, values), strict=True))


def plain(value: Any) -> Any:
    """Return a value for JSON: None for NaN, a string for an infinite number."""
    if isinstance(value, dict):
        return {name: plain(item) for name, item in value.items()}
    if isinstance(value, list):
        return [plain(item) for item in value]
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value


def read_number(value: float | str | None) -> float:
    """Return the float from which ``plain`` made a JSON value: NaN for None."""
    return math.nan if value is None else float(value)
