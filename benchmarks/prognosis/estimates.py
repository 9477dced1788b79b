# SPDX-License-Identifier: Apache-2.0
"""Estimates drawn with the errors that the real estimator was measured to make.

A test takes sigmas and correlations from one of the measured windows whose faults are nearest to
its own, and errors, in units of sigma, from any: with their tails, and correlated as they were.
Errors are pooled from windows that show the component clearly; where they do not, an estimate is
healthy and says nothing of the error. Afterwards what differs from healthy by less than the
estimator's own test asks for is put back to healthy, as it does.
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
# The direction says little of how the others are seen.
_WEIGHTS: Final = np.where(np.arange(N_FAULTS) == ECCENTRICITY_PHASE, 0.1, 1.0)


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """The measured windows."""

    truth: NDArray[np.float64]  # true faults, (n, 8)
    sigma: NDArray[np.float64]  # standard deviations, (n, 8); NaN where unobservable
    correlation: NDArray[np.float64]  # of the errors, (n, 8, 8)
    standardised: NDArray[np.float64]  # errors in sigma, NaN where they do not show, (n, 8)

    @classmethod
    def of(cls, path: Path = FILE) -> "ErrorModel":
        """Read what ``estimator_errors.py`` wrote.

        Raises
        ------
        ValueError
            When windows with much noise have valid estimates: those would have to be drawn too.
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
        """Return estimates whose errors, in units of sigma, follow an AR(1) process."""
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
        """Return what the estimator could say of a test; errors are drawn where none are given."""
        gap = np.sqrt(np.abs(self.truth - healthy_faults()))
        own = np.sqrt(np.abs(faults - healthy_faults()))
        distance = np.sum(_WEIGHTS * (gap - own) ** 2, axis=1)
        like = int(rng.choice(np.argsort(distance)[:_NEIGHBOURS]))
        sigma = self.sigma[like].copy()
        hidden = ~np.isfinite(sigma)
        if hidden[ECCENTRICITY_PHASE]:
            # It may be seen all the same, if the eccentricity is: about as those that are.
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
        """Return the errors of a window in units of sigma; what it does not show, of others."""
        z = self.standardised[rng.integers(len(self.standardised))].copy()
        for number in np.flatnonzero(np.isnan(z)):
            pool = self.standardised[:, number]
            z[number] = rng.choice(pool[np.isfinite(pool)])
        return z


@cache
def error_model() -> ErrorModel:
    """Return the measured error model, read once a process."""
    return ErrorModel.of()


def drawn(scored: ScoredLife, life: SimulatedLife) -> list[Measurement]:
    """Return the estimates of a life's tests with a usable window, always the same."""
    rng = scored.rng(1)
    return [
        error_model().draw(float(hours), faults, rng)
        for hours, faults, window in zip(life.hours, life.faults, life.windows, strict=True)
        if window == "good"
    ]
