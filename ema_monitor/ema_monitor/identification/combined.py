"""From the stretches of ordinary motion to the one estimate of all of them (M29).

The last stretch has the faults, and what is known of them after all stretches. Everything else in
an estimate is of one stretch alone, and is put together here.
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
from ema_monitor.identification.inference import Finding
from ema_monitor.identification.knowledge import Knowledge
from ema_monitor.identification.quantiles import within_range
from ema_monitor.identification.uncertainty import PLANE, widening
from ema_monitor.identification.verdict import Misfit, assumed_goodness, judged
from ema_monitor.reasons import CauseFound, Contradicted, FaultsNotShown, Reason


def combined_estimate(
    parts: Sequence[Finding], known: Knowledge, wanted_sigma: float, ending: Reason | None = None
) -> Estimate | None:
    """Return the one estimate of several stretches; None when they show no fault as wanted.

    Parameters
    ----------
    parts
        What was found in the stretches, in their order, at least one.
    known
        What is known of the faults after them.
    wanted_sigma
        Standard deviation from which on a fault counts as not shown.
    ending
        Why there are no more of them; None for no reason to mention.
    """
    last = parts[-1].estimate
    estimates = [part.estimate for part in parts]
    # They are of about the same length.
    misfit = Misfit(np.mean([one.misfit.powers for one in parts if one.misfit], axis=0))
    found = _most_significant([one.causes for one in estimates])
    kept = np.array(last.faults) != healthy_faults()
    kept[PLANE] = np.any(kept[PLANE])
    alternatives = _not_told_apart(estimates, kept)
    faults = np.array(last.faults)
    scale = widening(assumed_goodness(faults, misfit.goodness))
    scale = max(1.0, scale / widening(assumed_goodness(faults, last.goodness_of_fit)))
    covariance, unknown = _with_confusions(
        last, scale**2 * last.covariance, estimates, alternatives
    )
    unknown |= known.sigma > wanted_sigma
    unknown[PLANE] |= np.any(known.sigma[PLANE] > wanted_sigma)
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
        *_causes_found([one.causes for one in estimates]),
    ]
    verdict = judged(
        "motion",
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
        fitness=sum(one.fitness for one in estimates),
        goodness_of_fit=misfit.goodness,
        unexplained_share=misfit.share,
        excitation=max(one.excitation for one in estimates),
        evaluations=sum(one.evaluations for one in estimates),
        computing_time=sum(one.computing_time for one in estimates),
        warm_start=estimates[0].warm_start,
        causes=found,
        measured=_most_significant([one.measured for one in estimates]),
        alternatives=alternatives,
        **verdict,
    )


def _by_name(of_stretches: Iterable[Iterable[CauseEstimate]]) -> dict[str, list[CauseEstimate]]:
    """Return causes of stretches by name, in the order in which they came up."""
    by_name: dict[str, list[CauseEstimate]] = {}
    for causes in of_stretches:
        for one in causes:
            by_name.setdefault(one.name, []).append(one)
    return by_name


def _most_significant(of_stretches: Iterable[Iterable[CauseEstimate]]) -> tuple[CauseEstimate, ...]:
    """Return each cause as the stretch has it in which it differs most from nothing."""
    by_name = _by_name(of_stretches)
    return tuple(
        max(found, key=lambda one: abs(one.value) / one.sigma) for found in by_name.values()
    )


def _causes_found(of_stretches: Sequence[Iterable[CauseEstimate]]) -> list[Reason]:
    """Return each cause with its range, and in how many of the stretches it took part."""
    reasons: list[Reason] = []
    for causes in _by_name(of_stretches).values():
        [most] = _most_significant([causes])
        values = [cause.value for cause in causes]
        ends = (min(values), max(values)) if len(values) > 1 else ()
        reasons.append(
            CauseFound(*most, *ends, stretches=len(causes), of_stretches=len(of_stretches))
        )
    return reasons


def _contradictions(parts: Sequence[Finding]) -> list[Reason]:
    """Return which measured causes were not used, and in how many of the stretches."""
    by_name = _by_name(part.contradicted for part in parts)
    return [
        Contradicted(
            "motion",
            *_most_significant([causes])[0],
            stretches=len(causes),
            of_stretches=len(parts),
        )
        for causes in by_name.values()
    ]


def _counted(of_stretches: Sequence[Sequence[Reason]]) -> list[Reason]:
    """Return reasons of stretches, each once, and in how many of them it holds unless in all."""
    numbers = Counter(reason for reasons in of_stretches for reason in dict.fromkeys(reasons))
    total = len(of_stretches)
    return [
        reason if number == total else replace(reason, stretches=number, of_stretches=total)
        for reason, number in numbers.items()
    ]


def _not_told_apart(estimates: Sequence[Estimate], kept: Flags) -> tuple[Alternative, ...]:
    """Return the pairs that the stretches cannot be said to have told apart.

    A later stretch that names no alternative has not told them apart: what was known before it
    weighs more in it than what it shows itself, and a cause may last as long as the faults do. A
    pair is none any more when its faults are not ``kept``, they have proved healthy, and its causes
    were rarely there.
    """
    by_name = _by_name(one.causes for one in estimates)
    lasting = {name for name, found in by_name.items() if 2 * len(found) > len(estimates)}

    def remains(part: Part) -> bool:
        faults = faults_of([part])
        return lasting.issuperset(part) or bool(faults and np.all(kept[faults]))

    pairs = dict.fromkeys(pair for one in estimates for pair in one.alternatives)
    return tuple(pair for pair in pairs if any(map(remains, pair)))


def _with_confusions(
    last: Estimate,
    covariance: Array,
    estimates: Iterable[Estimate],
    alternatives: Iterable[Alternative],
) -> tuple[Array, Flags]:
    """Return a covariance that knows a fault no better than the stretches did one by one.

    That holds for those that they did not tell from something else: it does not average out. The
    best of these stretches counts. The flags are those of components that none of them knew.
    """
    best = np.diag(covariance).copy()
    unknown = last.unobservable.copy()
    for pair in alternatives:
        confused = faults_of(pair)
        stated = np.array(
            [np.diag(one.covariance)[confused] for one in estimates if pair in one.alternatives]
        )
        least = np.min(np.where(np.isnan(stated), np.inf, stated), axis=0, initial=np.inf)
        best[confused] = np.fmax(best[confused], least)
    unknown |= np.isinf(best)
    grown = np.sqrt(np.where(unknown, 1.0, best / np.where(unknown, 1.0, np.diag(covariance))))
    return covariance * np.outer(grown, grown), unknown
