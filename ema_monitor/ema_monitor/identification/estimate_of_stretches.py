# SPDX-License-Identifier: Apache-2.0
"""Combined estimate of several stretches of ordinary motion.

The estimate of the last stretch contains the faults and their covariance after all stretches. All
other fields of the estimates refer to single stretches, and are combined in this module.

The method is described in ``docs/identification.md``, M29.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.causes import CauseEstimate
from ema_core.faults import ECCENTRICITY_PHASE, FAULTS, N_FAULTS, healthy_faults
from ema_monitor.identification.alternatives import Alternative, Part, faults_of
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.inference import WindowResult
from ema_monitor.identification.knowledge import Knowledge
from ema_monitor.identification.quantiles import within_range
from ema_monitor.identification.uncertainty import PLANE, widening
from ema_monitor.identification.verdict import Misfit, assumed_goodness, judged
from ema_monitor.reasons import CauseFound, Contradicted, FaultsNotShown, Reason, Subject


def combined_estimate(
    parts: Sequence[WindowResult],
    knowledge: Knowledge,
    wanted_sigma: float,
    ending: Reason | None = None,
) -> Estimate | None:
    """Return the estimate of several stretches, or None if no fault is accurate enough.

    Parameters
    ----------
    parts
        Results of the stretches in chronological order, at least one.
    knowledge
        Knowledge of the faults after the last stretch.
    wanted_sigma
        Target standard deviation. A fault with a larger standard deviation is unobservable.
    ending
        Reason for the end of the combination, if it is to be reported.
    """
    last = parts[-1].estimate
    estimates = [part.estimate for part in parts]
    # The stretches are of similar length, so that they have equal weights.
    misfit = Misfit(np.mean([part.misfit.powers for part in parts if part.misfit], axis=0))
    causes = [estimate.causes for estimate in estimates]
    kept = np.array(last.faults) != healthy_faults()
    kept[PLANE] = np.any(kept[PLANE])
    alternatives = _not_separated(estimates, kept)
    faults = np.array(last.faults)
    scale = widening(assumed_goodness(faults, misfit.goodness))
    scale = max(1.0, scale / widening(assumed_goodness(faults, last.goodness_of_fit)))
    covariance, unknown = _with_confusions(
        last, scale**2 * last.covariance, estimates, alternatives
    )
    unknown |= knowledge.sigma > wanted_sigma
    unknown[PLANE] |= np.any(knowledge.sigma[PLANE] > wanted_sigma)
    with np.errstate(invalid="ignore"):
        confused = faults_of(part for pair in alternatives for part in pair)
        unknown[confused] |= np.sqrt(np.diag(covariance))[confused] > wanted_sigma
    if np.all(unknown | (np.arange(N_FAULTS) == ECCENTRICITY_PHASE)):
        return None
    covariance[unknown, :] = np.nan
    covariance[:, unknown] = np.nan
    grown = np.sqrt(np.diag(covariance) / np.diag(last.covariance))
    quantiles = within_range(faults + grown * (last.quantiles - faults))
    hidden = tuple(
        fault.name
        for fault, is_unknown in zip(FAULTS, unknown, strict=True)
        if is_unknown and fault.limit is not None
    )
    reservations = [
        ending,
        FaultsNotShown(hidden) if hidden else None,
        *_contradictions(parts),
        *_counted([part.caveats for part in parts]),
        *_causes_found(causes),
    ]
    verdict = judged(
        Subject.MOTION,
        misfit,
        last.goodness_limit,
        unknown,
        alternatives,
        [reason for reason in reservations if reason is not None],
        last.calibration_windows,
    )
    return replace(
        last,
        start_ns=estimates[0].start_ns,
        stretches=len(parts),
        covariance=covariance,
        unobservable=unknown,
        quantiles=quantiles,
        play_offset=estimates[0].play_offset,
        fitness=sum(estimate.fitness for estimate in estimates),
        goodness_of_fit=misfit.goodness,
        unexplained_share=misfit.share,
        excitation=max(estimate.excitation for estimate in estimates),
        evaluations=sum(estimate.evaluations for estimate in estimates),
        computing_time=sum(estimate.computing_time for estimate in estimates),
        warm_start=estimates[0].warm_start,
        causes=_most_significant(causes),
        measured=_most_significant([estimate.measured for estimate in estimates]),
        alternatives=alternatives,
        **verdict,
    )


def _by_name(of_stretches: Iterable[Iterable[CauseEstimate]]) -> dict[str, list[CauseEstimate]]:
    """Return the causes of stretches by name, in the order of their first occurrence."""
    by_name: dict[str, list[CauseEstimate]] = {}
    for causes in of_stretches:
        for cause in causes:
            by_name.setdefault(cause.name, []).append(cause)
    return by_name


def _most_significant(of_stretches: Iterable[Iterable[CauseEstimate]]) -> tuple[CauseEstimate, ...]:
    """Return each cause from the stretch in which it is most significant."""
    by_name = _by_name(of_stretches)
    return tuple(
        max(causes, key=lambda cause: abs(cause.value) / cause.sigma) for causes in by_name.values()
    )


def _causes_found(of_stretches: Sequence[Iterable[CauseEstimate]]) -> list[Reason]:
    """Return one reason per hidden cause, with its range and number of stretches."""
    reasons: list[Reason] = []
    for causes in _by_name(of_stretches).values():
        [most] = _most_significant([causes])
        values = [cause.value for cause in causes]
        ends = (min(values), max(values)) if len(values) > 1 else ()
        reasons.append(
            CauseFound(*most, *ends, stretches=len(causes), of_stretches=len(of_stretches))
        )
    return reasons


def _contradictions(parts: Sequence[WindowResult]) -> list[Reason]:
    """Return one reason per measured cause that was not used, with its number of stretches."""
    by_name = _by_name(part.contradicted for part in parts)
    return [
        Contradicted(
            Subject.MOTION,
            *_most_significant([causes])[0],
            stretches=len(causes),
            of_stretches=len(parts),
        )
        for causes in by_name.values()
    ]


def _counted(of_stretches: Sequence[Sequence[Reason]]) -> list[Reason]:
    """Return each reason once, with the number of affected stretches unless all are affected."""
    numbers = Counter(reason for reasons in of_stretches for reason in dict.fromkeys(reasons))
    total = len(of_stretches)
    return [
        reason if number == total else replace(reason, stretches=number, of_stretches=total)
        for reason, number in numbers.items()
    ]


def _not_separated(estimates: Sequence[Estimate], kept: Flags) -> tuple[Alternative, ...]:
    """Return the alternatives that all stretches together cannot distinguish.

    A later stretch without an alternative does not rule the alternative out: its result depends
    more on the prior knowledge than on its samples, and a cause may last as long as the faults. An
    alternative is dropped if its faults are not ``kept``, because they turned out to be healthy,
    and its causes occur in at most half of the stretches.
    """
    by_name = _by_name(estimate.causes for estimate in estimates)
    lasting = {name for name, causes in by_name.items() if 2 * len(causes) > len(estimates)}

    def remains(part: Part) -> bool:
        faults = faults_of([part])
        return lasting.issuperset(part) or bool(faults and np.all(kept[faults]))

    pairs = dict.fromkeys(pair for estimate in estimates for pair in estimate.alternatives)
    return tuple(pair for pair in pairs if any(map(remains, pair)))


def _with_confusions(
    last: Estimate,
    covariance: Array,
    estimates: Iterable[Estimate],
    alternatives: Iterable[Alternative],
) -> tuple[Array, Flags]:
    """Return the covariance increased for confused faults, and flags of unobservable components.

    Averaging over stretches does not resolve the confusion of a fault with an alternative: the
    variance of a confused fault is at least its smallest variance in the stretches with this
    alternative. A fault that is unobservable in all these stretches is flagged.
    """
    best = np.diag(covariance).copy()
    unknown = last.unobservable.copy()
    for pair in alternatives:
        confused = faults_of(pair)
        stated = np.array(
            [
                np.diag(estimate.covariance)[confused]
                for estimate in estimates
                if pair in estimate.alternatives
            ]
        )
        least = np.min(np.where(np.isnan(stated), np.inf, stated), axis=0, initial=np.inf)
        best[confused] = np.fmax(best[confused], least)
    unknown |= np.isinf(best)
    grown = np.sqrt(np.where(unknown, 1.0, best / np.where(unknown, 1.0, np.diag(covariance))))
    return covariance * np.outer(grown, grown), unknown
