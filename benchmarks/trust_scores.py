"""How far an estimate can be trusted: its verdict, what it claims and names, and its intervals."""

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, Final

import numpy as np
from cases import DETECTABLE
from numpy.typing import NDArray
from trials import difference
from trust_cases import Task

from ema_core.causes import CAUSES
from ema_core.faults import (
    ECCENTRICITY,
    ECCENTRICITY_PHASE,
    FAULT_NAMES,
    N_FAULTS,
    estimation_error,
    healthy_faults,
)
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.diagnosis import identify
from ema_monitor.identification.estimate import Estimate

RIGHT_PERCENT: Final = 2.0
"""Error up to which an estimate is right [%]."""

CONFIDENT_SIGMA: Final = 3.0
"""Error in standard deviations beyond which an estimate is too confident [-]."""

LEVEL: Final = 0.9
"""Probability that an interval is meant to cover the truth with [-]."""

GROWTH: Final = 1.015
"""Distance of the faults from healthy, over what a warm start begins with [-]."""

_Z: Final = NormalDist().inv_cdf((1.0 + LEVEL) / 2.0)
_SMALLEST_ZETA: Final = 0.05
_REFUSED: Final = "refused"


@dataclass(frozen=True)
class Judged:
    """What is judged of one estimate, in plain values.

    Attributes
    ----------
    unit
        Kind and number of the unit.
    truth, faults, sigma
        Fault vectors, eight values each; NaN where there is none.
    causes, named
        Hidden causes that there were, and names of those that the estimate names.
    claimed
        Faults that it claims on top of those that there are: significant, and beyond healthy by
        its 95 % bound.
    verdict
        "valid", "degraded" or "refused".
    reason
        What the estimate says.
    goodness_of_fit, seconds
        Its goodness of fit [-] and computing time [s].
    """

    unit: tuple[str, int]
    truth: tuple[float, ...]
    faults: tuple[float, ...]
    sigma: tuple[float, ...]
    causes: dict[str, float]
    named: tuple[str, ...]
    claimed: tuple[str, ...]
    verdict: str
    reason: str
    goodness_of_fit: float
    seconds: float

    @property
    def error_percent(self) -> float:
        """Error in percent of the range; inf where there is no estimate."""
        if not np.all(np.isfinite(self.faults)):
            return float("inf")
        return estimation_error(self.faults, self.truth)

    @property
    def is_wrong_and_confident(self) -> bool:
        """Whether a component of an estimate in use is off by more than 3 sigma and by 2 %."""
        if self.verdict == _REFUSED:
            return False
        away = np.abs(difference(self.faults, self.truth))
        size = away.copy()
        size[ECCENTRICITY_PHASE] *= self.faults[ECCENTRICITY]
        beyond = away > CONFIDENT_SIGMA * np.array(self.sigma)
        return bool(np.any(beyond & (size > RIGHT_PERCENT / 100.0)))


def calibrations(task: Task) -> Calibration:
    """Return the calibration of a task's unit, on its own healthy windows."""
    return calibrate_model([healthy.window() for healthy in task.healthy()], task.description)


def judged(work: tuple[Task, Calibration, bool]) -> list[Judged]:
    """Record a task's window; return what is judged of a cold and, if asked, a warm estimate."""
    task, calibration, with_warm = work
    window = task.window()
    starts: list[NDArray[np.float64] | None] = [None]
    if with_warm:
        healthy = healthy_faults()
        before = healthy + (np.array(task.faults) - healthy) / GROWTH
        before[ECCENTRICITY_PHASE] = task.faults[ECCENTRICITY_PHASE]
        starts.append(before)
    result = []
    for previous in starts:
        started = time.perf_counter()
        estimate = identify(window, task.description, calibration, previous=previous)
        seconds = time.perf_counter() - started
        result.append(
            Judged(
                (task.unit.kind, task.unit.number),
                task.faults,
                tuple(estimate.faults),
                tuple(estimate.sigma),
                dict(task.causes),
                tuple(sorted(named_causes(estimate))),
                claimed_faults(estimate, task.faults),
                verdict(estimate),
                estimate.reason,
                estimate.goodness_of_fit,
                seconds,
            )
        )
    return result


def verdict(estimate: Estimate) -> str:
    """Return the verdict on an estimate: valid, degraded or refused."""
    found = getattr(estimate, "verdict", None)
    if found is None:
        return "valid" if estimate.valid else _REFUSED
    return str(found)


def named_causes(estimate: Estimate) -> set[str]:
    """Return the names of the hidden causes that an estimate gives, in its causes or its reason."""
    found = getattr(estimate, "causes", ())
    names = {getattr(cause, "name", cause) for cause in found}
    # Longer labels first: some contain others.
    text = estimate.reason
    for cause in sorted(CAUSES, key=lambda cause: -len(cause.label)):
        if cause.label in text:
            names.add(cause.name)
            text = text.replace(cause.label, "")
    return names


def claimed_faults(estimate: Estimate, truth: Sequence[float]) -> tuple[str, ...]:
    """Return the faults that an estimate in use claims and that are healthy in truth."""
    if verdict(estimate) == _REFUSED:
        return ()
    healthy = healthy_faults()
    away = np.abs(np.array(estimate.faults) - healthy)
    beyond = away - _Z * np.array(estimate.sigma) > 0.0
    return tuple(
        FAULT_NAMES[n]
        for n in DETECTABLE
        if beyond[n] and not estimate.insignificant[n] and truth[n] == healthy[n]
    )


def accuracy(found: Sequence[Judged]) -> dict[str, Any]:
    """Return the figures of windows with faults."""
    errors = np.array([one.error_percent for one in found])
    made = errors[np.isfinite(errors)]
    right = [one for one in found if one.error_percent <= RIGHT_PERCENT]
    quantile = {
        name: float(np.quantile(made, q)) if made.size else float("nan")
        for name, q in (("median", 0.5), ("p90", 0.9), ("max", 1.0))
    }
    return {
        "windows": len(found),
        "without_estimate": int(len(errors) - made.size),
        **quantile,
        "verdicts": verdicts(found),
        "right": len(right),
        "right_refused": _share(one.verdict == _REFUSED for one in right),
        "wrong_and_confident": _share(one.is_wrong_and_confident for one in found),
        "seconds_median": float(np.median([one.seconds for one in found])),
        **coverage(found),
    }


def coverage(found: Sequence[Judged]) -> dict[str, Any]:
    """Return how often 90 % intervals of estimates in use cover the truth, by component and unit.

    The phase of an eccentricity counts where there is one of more than 0.05.
    """
    used = [one for one in found if one.verdict != _REFUSED]
    shape = (len(used), N_FAULTS)
    sigma = np.array([one.sigma for one in used]).reshape(shape)
    away = np.array([np.abs(difference(one.faults, one.truth)) for one in used]).reshape(shape)
    known = np.isfinite(sigma)
    zeta = np.array([one.truth[ECCENTRICITY] for one in used])
    known[:, ECCENTRICITY_PHASE] &= zeta > _SMALLEST_ZETA
    inside = away <= _Z * sigma
    of = np.array([one.unit[1] for one in used])
    by_unit = {int(n): _share(inside[of == n][known[of == n]]) for n in np.unique(of)}
    return {
        "coverage": _share(inside[known]),
        "coverage_by_component": {
            FAULT_NAMES[n]: _share(inside[known[:, n], n]) for n in range(N_FAULTS)
        },
        "coverage_by_unit": by_unit,
    }


def hidden(found: Sequence[Judged], causes: Mapping[str, float]) -> dict[str, Any]:
    """Return the figures of healthy windows with hidden causes."""
    sizes = [
        max(abs(one.faults[n] - healthy_faults()[n]) for n in range(N_FAULTS) if _claims(one, n))
        for one in found
        if one.claimed
    ]
    return {
        "windows": len(found),
        "verdicts": verdicts(found),
        "claimed": _share(bool(one.claimed) for one in found),
        "largest_claimed_median": float(np.median(sizes)) if sizes else 0.0,
        "claims": {
            name: count
            for name in FAULT_NAMES
            if (count := sum(name in one.claimed for one in found))
        },
        "named": _share(
            set(causes) <= set(one.named) if causes else not one.named for one in found
        ),
        "goodness_of_fit": float(np.median([one.goodness_of_fit for one in found])),
    }


def verdicts(found: Sequence[Judged]) -> dict[str, int]:
    """Return how many estimates have each verdict."""
    return {
        name: sum(one.verdict == name for one in found) for name in ("valid", "degraded", _REFUSED)
    }


def _claims(one: Judged, n: int) -> bool:
    return FAULT_NAMES[n] in one.claimed


def _share(flags: Iterable[Any]) -> float:
    """Return the share of those that hold; NaN of none."""
    held = [bool(flag) for flag in flags]
    return sum(held) / len(held) if held else float("nan")
