# SPDX-License-Identifier: Apache-2.0
"""Identification of the windows of cases, and comparison of the estimates with the truth."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, Final, NamedTuple

import numpy as np
from cases import Case
from numpy.typing import ArrayLike, NDArray
from script import Workers

from ema_core.description import ActuatorDescription
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
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.identification.quantiles import LEVELS
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.windows.window import Window

ACTUATOR: Final = ActuatorDescription()
"""Description that the monitor receives for every actuator, for any true plant."""

LEVEL: Final = 0.9
"""Nominal coverage of an interval [-]."""

Z: Final = NormalDist().inv_cdf((1.0 + LEVEL) / 2.0)
"""Half-width of an interval with the coverage ``LEVEL`` [standard deviations]."""

HEALTHY_WINDOWS: Final = 20
"""Number of healthy windows for the calibration of the nominal unit with noisy sensors."""

WRONG: Final = 0.02
"""Error above which a component is wrong [-]; it is also too confident above 3 sigma."""

_CONFIDENT_SIGMA: Final = 3.0
_SMALLEST_ZETA: Final = 0.05
_GROWTH: Final = 1.015


@dataclass(frozen=True, eq=False)
class Variant:
    """A variant of the identification: calibration, ideal or noisy sensors, and settings."""

    calibration: Calibration
    noisy: bool = False
    settings: SearchSettings = SearchSettings()  # noqa: RUF009 - frozen
    description: ActuatorDescription = ACTUATOR


class Job(NamedTuple):
    """A case, and the variants of its identification."""

    case: Case
    variants: Sequence[Variant]

    def estimates(self) -> list[Estimate]:
        """Return the estimate of each variant."""
        telemetry = self.case.telemetry()
        return [
            identify(
                self.case.window(telemetry, noisy=variant.noisy),
                variant.description,
                variant.calibration,
                variant.settings,
            )
            for variant in self.variants
        ]


@dataclass(frozen=True, eq=False)
class Trial:
    """True fault vectors, ``(n, 8)``, and their estimates."""

    truth: NDArray[np.float64]
    estimates: Sequence[Estimate]

    @classmethod
    def of(cls, truth: Iterable[ArrayLike], estimates: Sequence[Estimate]) -> "Trial":
        """Return the trial of true fault vectors, ``(8,)`` each, and estimates."""
        return cls(np.array([*truth], dtype=float).reshape(-1, N_FAULTS), estimates)

    @property
    def used(self) -> "Trial":
        """Trial of the estimates that are valid or degraded."""
        kept = [
            estimate.verdict in (Verdict.VALID, Verdict.DEGRADED) for estimate in self.estimates
        ]
        return self.select(np.array(kept, dtype=bool))

    def select(self, chosen: Any) -> "Trial":
        """Return the trial of the estimates that an index or a mask selects."""
        numbers = np.arange(len(self.estimates))[chosen]
        return Trial(self.truth[numbers], [self.estimates[n] for n in numbers])

    @property
    def errors_percent(self) -> NDArray[np.float64]:
        """Errors in percent of the range, ``(n,)``; inf without an estimate."""
        return np.array(
            [
                estimation_error(estimate.faults, k)
                if np.all(np.isfinite(estimate.faults))
                else np.inf
                for estimate, k in zip(self.estimates, self.truth, strict=True)
            ]
        )

    @property
    def faults(self) -> NDArray[np.float64]:
        """Estimated fault vectors, ``(n, 8)``."""
        return np.array([estimate.faults for estimate in self.estimates]).reshape(-1, N_FAULTS)

    @property
    def sigma(self) -> NDArray[np.float64]:
        """Standard deviations of the estimates, ``(n, 8)``; NaN where unobservable."""
        return np.array([estimate.sigma for estimate in self.estimates], dtype=float).reshape(
            -1, N_FAULTS
        )

    @property
    def away(self) -> NDArray[np.float64]:
        """Distance from estimate to truth, ``(n, 8)``, with the phase wrapped to half a turn."""
        result = self.faults - self.truth
        result[:, ECCENTRICITY_PHASE] -= np.round(result[:, ECCENTRICITY_PHASE])
        return np.abs(result)

    @property
    def judged(self) -> NDArray[np.bool_]:
        """Mask of components to judge, ``(n, 8)``.

        The phase is judged only for an eccentricity above 0.05.
        """
        result = np.ones(self.truth.shape, dtype=bool)
        result[:, ECCENTRICITY_PHASE] = self.truth[:, ECCENTRICITY] > _SMALLEST_ZETA
        return result

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask of judged components that have an interval, ``(n, 8)``."""
        return self.judged & np.isfinite(self.sigma)

    @property
    def quantiles(self) -> NDArray[np.float64]:
        """Quantiles minus the truth, ``(5, n, 8)``; the phase is wrapped to the nearest turn."""
        stated = np.array([estimate.quantiles for estimate in self.estimates]).reshape(
            -1, 5, N_FAULTS
        )
        result = stated - self.truth[:, None]
        turns = np.round(self.faults - self.truth)[:, ECCENTRICITY_PHASE]
        result[..., ECCENTRICITY_PHASE] -= turns[:, None]
        return np.moveaxis(result, 1, 0)

    def coverage(self, columns: Any = slice(None), level: float = LEVEL) -> float:
        """Return the share of known components whose interval covers the truth [-].

        ``level`` is ``LEVEL`` for the 90 % interval, any other value for the 50 % interval.
        """
        low, _, high = self.quantiles[[0, 2, 4] if level == LEVEL else [1, 2, 3]][..., columns]
        return mean(((low <= 0.0) & (high >= 0.0))[self.known[:, columns]])

    def coverage_by_component(self, level: float = LEVEL) -> dict[str, float]:
        """Return the coverage by component [-]."""
        return {name: self.coverage(n, level) for n, name in enumerate(FAULT_NAMES)}

    def crps_percent(self) -> float:
        """Return the mean CRPS of known components, from their quantiles [% of the range]."""
        levels = np.array(LEVELS)
        away, mask = self.quantiles, self.known
        # Each level represents the probabilities that are nearest to it.
        edges = np.concatenate([[0.0], (levels[1:] + levels[:-1]) / 2.0, [1.0]])
        shares = levels[:, None] - (away[:, mask] > 0.0)
        return 100.0 * mean(-2.0 * np.diff(edges) @ (shares * away[:, mask]))

    def log_score(self) -> float:
        """Return the mean of -ln(density) at the truth [nat].

        The density follows from the quantiles, with exponential tails.
        """
        at = np.sort(self.quantiles[:, self.known], axis=0)
        widths = np.maximum(np.diff(at, axis=0)[[0, 0, 1, 2, 3, 3]], 1e-3)
        part = np.sum(at <= 0.0, axis=0)
        width = widths[part, np.arange(len(part))]
        beyond = np.maximum(np.maximum(at[0], -at[-1]), 0.0) / width
        return mean(beyond - np.log(np.diff([0.0, *LEVELS, 1.0])[part] / width))

    def wrong_and_confident(self) -> int:
        """Return the number of used estimates with an error above both 3 sigma and 2 %.

        For the 2 %, the error of the phase is multiplied by the eccentricity.
        """
        used = self.used
        size = used.away
        beyond = size > _CONFIDENT_SIGMA * used.sigma
        size[:, ECCENTRICITY_PHASE] *= used.faults[:, ECCENTRICITY]
        return int(np.sum(np.any(beyond & (size > WRONG), axis=1)))

    def verdicts(self) -> dict[Verdict, int]:
        """Return the number of estimates by verdict; failures count as refused."""
        verdicts = [estimate.verdict for estimate in self.estimates]
        used = {name: verdicts.count(name) for name in (Verdict.VALID, Verdict.DEGRADED)}
        return used | {Verdict.REFUSED: len(verdicts) - sum(used.values())}

    def summary(self) -> dict[str, Any]:
        """Return the statistics of errors, scores, verdicts and evaluations."""
        return {
            **quantiles(self.errors_percent),
            "crps": self.crps_percent(),
            "log_score": self.log_score(),
            "cases": len(self.estimates),
            "verdicts": self.verdicts(),
            "evaluations_median": median([estimate.evaluations for estimate in self.estimates]),
        }


def trials(
    pool: Workers, what: str, cases: Sequence[Case], variants: Sequence[Variant]
) -> list[Trial]:
    """Identify the cases with each variant. Return one trial per variant."""
    results = pool.map(what, Job.estimates, [Job(case, variants) for case in cases])
    truth = [case.faults for case in cases]
    return [Trial.of(truth, estimates) for estimates in zip(*results, strict=True)]


def quantiles(values: Sequence[float] | NDArray[Any]) -> dict[str, float]:
    """Return mean, median, 90th percentile and maximum; NaN without values."""
    if not np.size(values):
        return dict.fromkeys(("mean", "median", "p90", "max"), float("nan"))
    return {
        "mean": float(np.mean(values)),
        "median": float(np.median(values)),
        "p90": float(np.quantile(values, 0.9)),
        "max": float(np.max(values)),
    }


def mean(values: Sequence[float] | NDArray[Any]) -> float:
    """Return the mean; NaN without values."""
    return float(np.mean(values)) if np.size(values) else float("nan")


def median(values: Sequence[float] | NDArray[Any]) -> float:
    """Return the median; NaN without values."""
    return float(np.median(values)) if np.size(values) else float("nan")


def before(faults: ArrayLike) -> NDArray[np.float64]:
    """Return the faults of the previous window for a warm start: slightly smaller faults."""
    k, healthy = np.array(faults, dtype=float), healthy_faults()
    result = healthy + (k - healthy) / _GROWTH
    result[ECCENTRICITY_PHASE] = k[ECCENTRICITY_PHASE]
    return result


def noisy_window(case: Case) -> Window:
    """Return the window of a case with noisy sensors."""
    return case.window(case.telemetry(), noisy=True)


def calibration_on(cases: Sequence[Case]) -> Calibration:
    """Calibrate a unit with the windows of its healthy cases, recorded by noisy sensors."""
    return calibrate_model([noisy_window(case) for case in cases], ACTUATOR)
