# SPDX-License-Identifier: Apache-2.0
"""Estimates drawn with the measured errors of the real estimator.

A test takes its sigmas and correlations from one of the measured windows with the nearest faults.
Its errors, in units of sigma, are the errors of a random window, which preserves their tails and
correlations. Errors of a component are pooled from windows that show it clearly; in other windows
the estimate is healthy and carries no information on the error. Finally, insignificant components
are reset to healthy, as by the estimator.
"""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, HIGHEST, N_FAULTS, healthy_faults
from ema_monitor.identification.uncertainty import SIGNIFICANT_SIGMAS
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_sim.lives import SimulatedLife
from prognosis.lives import ScoredLife

FILE: Final = Path(__file__).with_name("estimator_errors.jsonl")
_UPPER: Final = np.triu_indices(N_FAULTS, 1)
_CLEAR_SIGMAS: Final = 4.0
_NEIGHBOURS: Final = 5
# The direction of eccentricity hardly affects the errors of the other components.
_WEIGHTS: Final = np.where(np.arange(N_FAULTS) == ECCENTRICITY_PHASE, 0.1, 1.0)


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """Errors of the estimator in the measured windows."""

    truth: NDArray[np.float64]  # true faults, (n, 8)
    sigma: NDArray[np.float64]  # standard deviations, (n, 8); NaN where unobservable
    correlation: NDArray[np.float64]  # of the errors, (n, 8, 8)
    standardised: NDArray[np.float64]  # errors in sigma, NaN unless shown clearly, (n, 8)

    @classmethod
    def of(cls, path: Path = FILE) -> "ErrorModel":
        """Read a file of ``estimator_errors.py``.

        Raises
        ------
        ValueError
            If windows with high noise have valid estimates, which this model cannot draw.
        """
        records = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
        spoiled = [record["valid"] for record in records if record["spoiled"]]
        good = [record for record in records if record["valid"] and not record["spoiled"]]
        truth, faults, sigma = (
            np.array([record[name] for record in good], dtype=np.float64)
            for name in ("truth", "faults", "sigma")
        )
        correlation = np.tile(np.eye(N_FAULTS), (len(good), 1, 1))
        upper = np.array([record["correlation"] for record in good])
        correlation[:, *_UPPER] = correlation[:, _UPPER[1], _UPPER[0]] = upper
        error = faults - truth
        error[:, ECCENTRICITY_PHASE] -= np.round(error[:, ECCENTRICITY_PHASE])
        away = np.abs(truth - healthy_faults())
        away[:, ECCENTRICITY_PHASE] = away[:, ECCENTRICITY]
        need = sigma.copy()
        need[:, ECCENTRICITY_PHASE] = sigma[:, ECCENTRICITY]
        clear = away > _CLEAR_SIGMAS * need
        standardised = np.where(clear, error / sigma, np.nan)
        if any(spoiled):
            raise ValueError(f"{path}: {sum(spoiled)} spoiled windows have a valid estimate")
        return cls(truth, sigma, correlation, standardised)

    def draw_correlated(
        self,
        hours: NDArray[np.float64],
        faults: NDArray[np.float64],
        correlation: float,
        rng: np.random.Generator,
    ) -> list[Measurement]:
        """Return estimates of tests, with errors that follow an AR(1) process in units of sigma.

        ``faults`` are ``(n, 8)`` at ``hours``, ``(n,)``. ``correlation`` is the correlation of
        successive errors.
        """
        fresh = np.sqrt(1.0 - correlation**2)
        z, estimates = self._errors(rng), []
        for hour, vector in zip(hours, faults, strict=True):
            estimates.append(self.draw(float(hour), vector, rng, z))
            z = correlation * z + fresh * self._errors(rng)
        return estimates

    def draw(
        self,
        hours: float,
        faults: NDArray[np.float64],
        rng: np.random.Generator,
        standardised: NDArray[np.float64] | None = None,
    ) -> Measurement:
        """Return a random estimate of a test with true ``faults``, ``(8,)``, at a service hour.

        ``standardised`` are its errors in units of sigma, ``(8,)``; drawn if None.
        """
        gap = np.sqrt(np.abs(self.truth - healthy_faults()))
        wanted = np.sqrt(np.abs(faults - healthy_faults()))
        distance = np.sum(_WEIGHTS * (gap - wanted) ** 2, axis=1)
        like = int(rng.choice(np.argsort(distance)[:_NEIGHBOURS]))
        sigma = self.sigma[like].copy()
        hidden = ~np.isfinite(sigma)
        if hidden[ECCENTRICITY_PHASE]:
            # The direction shows if the eccentricity does: use the median of its known sigmas.
            sigma[ECCENTRICITY_PHASE] = np.nanmedian(self.sigma[:, ECCENTRICITY_PHASE])
        error = (self._errors(rng) if standardised is None else standardised) * sigma
        estimate = faults + error
        away = np.abs(estimate - healthy_faults())
        back = away < SIGNIFICANT_SIGMAS * sigma
        back[ECCENTRICITY_PHASE] = back[ECCENTRICITY]
        estimate = np.where(back, healthy_faults(), estimate)
        estimate[ECCENTRICITY_PHASE] %= 1.0
        estimate = np.clip(estimate, 0.0, HIGHEST)
        hidden[ECCENTRICITY_PHASE] = back[ECCENTRICITY]
        covariance = self.correlation[like] * np.outer(sigma, sigma)
        covariance[hidden], covariance[:, hidden] = np.nan, np.nan
        return Measurement(hours, estimate, covariance, hidden)

    def _errors(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return the errors of a random window in units of sigma, ``(8,)``.

        The error of a component that the window does not show clearly is the error of another
        window.
        """
        z = self.standardised[rng.integers(len(self.standardised))].copy()
        for number in np.flatnonzero(np.isnan(z)):
            pool = self.standardised[:, number]
            z[number] = rng.choice(pool[np.isfinite(pool)])
        return z


@cache
def error_model() -> ErrorModel:
    """Return the measured error model, which is read once per process."""
    return ErrorModel.of()


def drawn(scored: ScoredLife, life: SimulatedLife) -> list[Measurement]:
    """Return the estimates of a life's tests with a usable window, with reproducible errors."""
    rng = scored.rng(1)
    return [
        error_model().draw(float(hours), faults, rng)
        for hours, faults, window in zip(life.hours, life.faults, life.windows, strict=True)
        if window == "good"
    ]
