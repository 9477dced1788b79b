"""What is known of the components of an explanation: their covariance (M18, M27, M29)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import N_FAULTS
from ema_monitor.identification.evidence import including
from ema_monitor.identification.knowledge import Knowledge, information
from ema_monitor.identification.objective import Linearisation, Objective
from ema_monitor.identification.uncertainty import (
    GROUPS,
    MISMATCH_FACTOR,
    covariance_of_effects,
    sandwich_covariance,
    shifts_of,
)


@dataclass(frozen=True, eq=False)
class Explanation:
    """Faults and causes that explain a window.

    Attributes
    ----------
    at
        Linearisation at the estimate, of all components.
    kept
        Components that differ from healthy, ``(d,)``.
    confused
        Components that could stand in for what is kept, ``(d,)``: they widen the covariance.
    alternatives
        Pairs of what is kept and what could stand in for it, both in words.
    spread
        Second moment of the explanations elsewhere that the window does not tell from this one,
        about the estimate, ``(d, d)``.
    """

    at: Linearisation
    kept: NDArray[np.bool_]
    confused: NDArray[np.bool_]
    alternatives: list[tuple[str, str]]
    spread: NDArray[np.float64]


class Precision:
    """How well a window determines the components of an explanation.

    Parameters
    ----------
    objective
        Of the window, with hidden causes as components.
    lags
        Number of residuals over which they are correlated.
    alone
        Components that need no evidence: all but hidden causes under suspicion, ``(d,)``.

    Attributes
    ----------
    alone
        These.
    """

    def __init__(self, objective: Objective, lags: int, alone: NDArray[np.bool_]) -> None:
        self._objective = objective
        self._lags = lags
        self.alone = alone
        self._causes = np.arange(objective.dimension) >= objective.dimension - len(
            objective.hidden_causes
        )
        self._effects: tuple[Linearisation, NDArray[np.float64]] | None = None

    def uncertainty(self, explanation: Explanation) -> NDArray[np.float64]:
        """Return the covariance of all components in the unit box, ``(d, d)``.

        Where causes take part, that of what is kept holds for the explanation as it is, with what
        it could be confused with; that of each other fault, for the explanation with it. What is
        not known of the unit is part of it.
        """
        at, kept = explanation.at, explanation.kept | explanation.confused
        effects = np.zeros((len(at.residuals), 0))
        # At the healthy point under a calibrated command there is no effect: it was measured.
        departs = np.any(explanation.kept[:N_FAULTS])
        departs |= np.any(explanation.kept[self._causes])
        if departs or self._objective.is_measured:
            effects = self.effects(at)
        if not np.any(kept & ~self.alone):
            return self._covarianceincluding(at, self.alone, effects) + explanation.spread
        if np.any(self._causes & self.alone):
            kept = kept | self.alone
        result = self._covarianceincluding(at, kept, effects)
        for group in GROUPS:
            if not kept[group[0]]:
                wider = self._covarianceincluding(at, including(kept, group), effects)
                result[np.ix_(group, group)] = wider[np.ix_(group, group)]
        return result + explanation.spread

    def effects(self, at: Linearisation) -> NDArray[np.float64]:
        """Return what is not known of the unit does to the residuals, ``(r, k)``.

        It does not follow the faults, as the mismatch does that widens the whole later.
        """
        if self._effects is None or self._effects[0] is not at:
            self._effects = at, self._objective.unit_effects(at.point) / MISMATCH_FACTOR
        return self._effects[1]

    def knowledge(self, explanation: Explanation) -> tuple[Knowledge, NDArray[np.float64]]:
        """Return what is known of the faults after the window, and its own information, ``(8, 8)``.

        None of the faults is set to healthy, and none held at the bounds of the box (M29).
        """
        objective, at = self._objective, explanation.at
        shown = explanation.kept | explanation.confused | self.alone
        jacobian = at.jacobian[:, shown]
        step, effects = (
            -shifts_of(jacobian, rows) for rows in (at.residuals[:, None], self.effects(at))
        )
        covariance = self.covariance(jacobian, at.residuals + jacobian @ step[:, 0])
        faults = slice(0, N_FAULTS)
        gained = information(np.delete(jacobian, objective.known_rows, axis=0), objective.noise)
        before = objective.known
        total = gained if before is None else before.gained + before.misfit**2 * gained
        known = Knowledge(
            at.point[faults] + step[faults, 0],
            covariance[faults, faults] + explanation.spread[faults, faults],
            effects[faults],
            max(1.0, objective.misfit(at.residuals)),
            total,
        )
        return known, gained

    def _covarianceincluding(
        self, at: Linearisation, shown: NDArray[np.bool_], effects: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        d, jacobian = len(shown), at.jacobian[:, shown]
        result = np.zeros((d, d))
        result[np.ix_(shown, shown)] = self.covariance(
            jacobian, at.residuals
        ) + covariance_of_effects(jacobian, effects)
        return result

    def covariance(
        self, jacobian: NDArray[np.float64], residuals: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the covariance of the components whose columns the Jacobian has."""
        return sandwich_covariance(
            jacobian, residuals, self._lags, self._objective.priors, self._objective.noise
        )
