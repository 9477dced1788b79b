"""The estimate of the faults in a window, or the refusal of one; as plain values for JSON, too."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Final

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.causes import CauseEstimate
from ema_core.display import Displayed
from ema_core.faults import FAULT_NAMES, FAULTS, INDICES, N_FAULTS, FaultVector, healthy_faults
from ema_core.wording import text_table
from ema_monitor.identification.alternatives import Alternative, alternative_of
from ema_monitor.identification.quantiles import LEVELS, quantiles_of
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.joint.comparison import Comparison
from ema_monitor.joint.window_figures import WindowFigures, figures_of_row, row_of
from ema_monitor.joint.wording import finding, summary, table_text
from ema_monitor.reason_texts import joined, text_of
from ema_monitor.reasons import OtherUnit, Reason
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

INVERSE_DYNAMICS: Final = "inverse_dynamics"
"""Algorithm of the estimates that rest on the comparison of a record with its baseline."""

VERDICTS: Final = ("valid", "degraded", "refused", "failed", "skipped", "departed")
"""Verdicts, in the order of their numbers in ``ema_interfaces/msg/FaultEstimate``."""

VALID, DEGRADED, REFUSED, FAILED, SKIPPED, DEPARTED = VERDICTS

_UNKNOWN: Final = FaultVector.of(np.full(N_FAULTS, math.nan))
_FLAGS: Final = ("unobservable", "insignificant")
_CAUSES: Final = ("causes", "measured")
# Fields that records of earlier versions do not have.
_LATER: Final = ("lacks_calibration", "parts", "comparison", "reasons")
_SHAPES: Final = {
    "covariance": (N_FAULTS, N_FAULTS),
    "quantiles": (len(LEVELS), N_FAULTS),
    "probability": (N_FAULTS,),
}


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Displayed):
    """The faults identified in a window, or in several stretches of ordinary motion combined.

    Of stretches, what is said of the window holds for all of them together (M29).

    Attributes
    ----------
    start_ns, end_ns
        Stamps of the window's first and last sample [ns].
    algorithm, seed
        Optimizer, and seed of its random numbers.
    calibration_id
        Identity of the calibration used.
    faults
        Fault vector, ``(8,)``; NaN when there is no estimate.
    covariance
        Its covariance, ``(8, 8)``; NaN in rows and columns of unobservable components.
    unobservable
        Components that the window does not determine, ``(8,)``.
    quantiles
        Quantiles of the faults at 5, 25, 50, 75 and 95 %, ``(5, 8)``; normal where none are given,
        NaN where unobservable.
    probability
        Probability of the explanations that have a fault, ``(8,)``; of the only one where none is
        given, NaN where unobservable.
    play_offset
        Position of the motor in its play at the start [half-widths].
    fitness
        Cost at the estimate [A^2.s]; of stretches the sum, which is that of one fit of all.
    goodness_of_fit
        Rms of the band-limited residual over that of a healthy actuator, the larger of current and
        speed [-]; NaN when the calibration does not know the latter.
    goodness_limit
        Goodness of fit up to which the faults explain the window [-].
    excitation
        Travel of the command [rad]; the largest of stretches.
    evaluations
        Windows of the model that were computed.
    computing_time
        Time from window to estimate [s].
    valid
        Whether the estimate may be used.
    reasons
        Why not, or reservations about it; of a record without what its comparison shows.
    insignificant
        Components that the window does not show to differ from healthy, ``(8,)``: set to healthy,
        or faults within one standard deviation of it, which are added here.
    warm_start
        Whether the search began at the faults of an earlier window.
    calibration_windows
        Number of healthy windows that the calibration rests on; 0 when there was none.
    verdict
        "valid"; "degraded": usable, with standard deviations that say how far, ``reasons`` why;
        "refused"; "failed": refused for a failure of drive or shaft; "skipped": not examined, as
        it was cut off or dropped; or "departed": valid or not, the window departs from the
        unit's healthy windows in what ``reasons`` name, and no fault explains it.
    unexplained_share
        What is left of the window's departure from healthy at the estimate [-]; NaN where the
        goodness of fit is.
    causes
        Hidden causes that are part of what explains the window; of stretches each one as in that in
        which it is most significant, with its range in ``reasons``.
    alternatives
        Parts of the explanation and what the window does not tell them from, by name; of
        stretches those that they together have not told apart.
    stretches
        Number of stretches of ordinary motion that it rests on, from the start of the first to the
        end of the last; 0 of a test cycle, which is one window.
    measured
        Hidden causes that were measured, as they were used; of stretches as ``causes``.
    lacks_calibration
        Whether the window is refused because there is no calibration, or it does not belong to the
        actuator or the command.
    parts
        Figures of the window, or of each stretch, if the calibration has a baseline of windows.
    comparison
        Comparison of the record with the baseline of its unit; None for a modelled drive, and for
        a record that could not be read.
    """

    start_ns: int
    end_ns: int
    algorithm: str
    seed: int
    calibration_id: str
    faults: FaultVector = _UNKNOWN
    covariance: Array = field(default_factory=lambda: np.full((N_FAULTS, N_FAULTS), math.nan))
    unobservable: Flags = field(default_factory=lambda: np.ones(N_FAULTS, dtype=bool))
    quantiles: Array = field(default_factory=lambda: np.full(_SHAPES["quantiles"], math.nan))
    probability: Array = field(default_factory=lambda: np.full(N_FAULTS, math.nan))
    play_offset: float = math.nan
    fitness: float = math.nan
    goodness_of_fit: float = math.nan
    goodness_limit: float = math.nan
    excitation: float = math.nan
    evaluations: int = 0
    computing_time: float = 0.0
    valid: bool = False
    reasons: tuple[Reason, ...] = ()
    insignificant: Flags = field(default_factory=lambda: np.zeros(N_FAULTS, dtype=bool))
    warm_start: bool = False
    calibration_windows: int = 0
    verdict: str = VALID
    unexplained_share: float = math.nan
    causes: tuple[CauseEstimate, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    stretches: int = 0
    measured: tuple[CauseEstimate, ...] = ()
    lacks_calibration: bool = False
    parts: tuple[WindowFigures, ...] = ()
    comparison: Comparison | None = None

    def __post_init__(self) -> None:
        is_within = np.abs(np.subtract(self.faults, healthy_faults())) <= np.asarray(self.sigma)
        insignificant = self.insignificant.copy()
        insignificant[INDICES] |= is_within[INDICES]
        object.__setattr__(self, "insignificant", insignificant)
        alone = {
            "quantiles": quantiles_of(np.ones(1), np.array([self.faults]), np.array([self.sigma])),
            "probability": ~insignificant,
        }
        for name, values in alone.items():
            given = getattr(self, name)
            known = np.where(np.isnan(given), values, given)
            object.__setattr__(self, name, np.where(self.unobservable, math.nan, known))

    @property
    def reason(self) -> str:
        """The reasons in words, with the findings of a record; empty without any."""
        if self.comparison is None or not self.valid:
            return joined(self.reasons)
        caveats = [one for one in self.reasons if isinstance(one, OtherUnit)]
        remarks = [one for one in self.reasons if one not in caveats]
        sentences = *map(text_of, caveats), summary(self.comparison), *map(text_of, remarks)
        return ". ".join(sentences)

    @property
    def sigma(self) -> FaultVector:
        """Standard deviations; NaN where unobservable."""
        return FaultVector.of(np.sqrt(np.diag(self.covariance)))

    @property
    def found(self) -> Flags:
        """Which components differ from healthy, ``(8,)``."""
        return ~(self.insignificant | self.unobservable)

    @property
    def meanings(self) -> tuple[str, ...]:
        """What each fault amounts to, in words."""
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
        """Whether the estimate is that of a record compared with a baseline, not of a window."""
        return self.algorithm == INVERSE_DYNAMICS

    @property
    def departure(self) -> str:
        """How the record departs from healthy ones, in words; "" if it does not."""
        if self.verdict != DEPARTED:
            return ""
        return self.reason if self.comparison is None else finding(self.comparison)

    @property
    def brief(self) -> str:
        """Verdict, and the faults that differ from healthy, in a few words."""
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
        """Return the estimate as a row of a table, a plain value a column."""
        row = {name: one for name, one in vars(self).items() if isinstance(one, int | float | str)}
        row["reason"] = self.reason
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
        known = f"measured: {'; '.join(map(str, self.measured))}" if self.measured else ""
        return "\n".join(filter(None, (table, f"{self.verdict}, {fit}", known, self.reason)))


def refusal(
    window: Window | Refusal,
    calibration: Any,
    settings: SearchSettings,
    reason: Reason,
    *,
    is_failure: bool = False,
    lacks_calibration: bool = False,
) -> Estimate:
    """Return the estimate of a window in which no faults can be identified.

    It has failed where the reason is a failure of drive or shaft; ``calibration`` is that of any
    drive, or why there is none.
    """
    verdict = FAILED if is_failure else REFUSED
    if isinstance(window, Refusal) and (window.is_dropped or window.is_cut_off):
        verdict = SKIPPED
    is_calibrated = not isinstance(calibration, str)
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
    """Return every field of an estimate as plain values, exactly, and ``reason``, their text.

    Faults are values by name, flags the names of those that have them.
    """
    values = {item.name: getattr(estimate, item.name) for item in fields(Estimate)}
    values["faults"] = estimate.faults._asdict()
    for name in _SHAPES:
        values[name] = values[name].tolist()
    for name in _FLAGS:
        values[name] = [FAULT_NAMES[number] for number in np.flatnonzero(values[name])]
    for name in _CAUSES:
        values[name] = [cause._asdict() for cause in values[name]]
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
    """Return ``estimate_values`` as JSON can hold them.

    What is not a number is None; infinite values are text: JSON has neither.
    """
    return plain(estimate_values(estimate))


def estimate_of(record: Mapping[str, Any]) -> Estimate:
    """Return the estimate of ``estimate_values`` or ``estimate_record``, or read from JSON.

    Raises
    ------
    ValueError, KeyError, TypeError
        When it is not the record of an estimate.
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
            raise ValueError(f"{name} has shape {values[name].shape}")
    for name in _FLAGS:
        values[name] = np.isin(FAULT_NAMES, record[name])
    for name in _CAUSES:
        values[name] = tuple(CauseEstimate(**cause) for cause in record[name])
    values["alternatives"] = tuple(map(alternative_of, record["alternatives"]))
    values["reasons"] = reasons_of(record)
    values["lacks_calibration"] = bool(record.get("lacks_calibration", False))
    values["parts"] = tuple(figures_of_row(row) for row in record.get("parts", ()))
    compared = record.get("comparison")
    values["comparison"] = None if compared is None else Comparison.of_mapping(compared)
    return Estimate(**values)


def reasons_of(record: Mapping[str, Any]) -> tuple[Reason, ...]:
    """Return the reasons of the record of an estimate, or of a test without one."""
    return tuple(map(Reason.of_record, record["reasons"]))


def by_fault(values: Iterable[float]) -> dict[str, Any]:
    """Return the eight values of the faults by name; those that are not a number become None."""
    return dict(zip(FAULT_NAMES, map(plain, values), strict=True))


def plain(value: Any) -> Any:
    """Return a value as JSON can hold it: None for NaN, text for an infinite number."""
    if isinstance(value, dict):
        return {name: plain(one) for name, one in value.items()}
    if isinstance(value, list):
        return [plain(one) for one in value]
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value


def read_number(value: float | str | None) -> float:
    """Return the number that ``plain`` wrote."""
    return math.nan if value is None else float(value)
