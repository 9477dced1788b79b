"""States that the owner has named: which of them a record looks like, or none."""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.figures import DIRECTED
from ema_monitor.joint.record import JointRecord
from ema_monitor.joint.single import Observation, SingleTest

HEALTHY: Final = "healthy"
"""State of the records of the baseline."""

NONE_OF_THESE: Final = "none of these"
"""State of a record that looks like no labelled one."""

FEWEST_RECORDS: Final = 3
"""Records below which a state is not named."""

_STRANGE: Final = 1e-3
_SHRINKAGE: Final = 0.05
_BETWEEN: Final = 0.03


def known_states(baseline: Baseline) -> dict[str, list[JointRecord]]:
    """Return the records of each state that has enough of them, the healthy ones first."""
    found: dict[str, list[JointRecord]] = {HEALTHY: list(baseline.records)}
    for one in baseline.labelled:
        found.setdefault(one.state, []).append(one.record)
    return {state: some for state, some in found.items() if len(some) >= FEWEST_RECORDS}


def state_probabilities(baseline: Baseline, record: JointRecord) -> Mapping[str, float]:
    """Return the probability of each state, the largest first; empty without labelled states.

    States are told apart by linear discriminants with shrinkage (Ledoit and Wolf), with equal
    priors. A record that departs from all of them is none of these.
    """
    known = known_states(baseline)
    records = [one for some in known.values() for one in some]
    names = [
        name
        for name in (*DIRECTED, "rest_effort")
        if name in record.figures and all(name in one.figures for one in records)
    ]
    if len(known) < 2 or not names:
        return {}
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    labels = [state for state, some in known.items() for _ in some]
    discriminants = LinearDiscriminantAnalysis(
        solver="lsqr", shrinkage=_SHRINKAGE, priors=np.full(len(known), 1.0 / len(known))
    )
    model = make_pipeline(StandardScaler(), discriminants)
    model.fit(_values(records, names), labels)
    shares = model.predict_proba(_values([record], names))[0]
    nearest = max(_likeness(record, some, names) for some in known.values())
    strange = _STRANGE / (_STRANGE + nearest)
    found = {
        str(state): float(share * (1.0 - strange))
        for state, share in zip(model.classes_, shares, strict=True)
    }
    return dict(sorted({**found, NONE_OF_THESE: strange}.items(), key=lambda one: -one[1]))


def _values(records: Sequence[JointRecord], names: Sequence[str]) -> Array:
    return np.array([[one.figures[name] for name in names] for one in records])


def _likeness(record: JointRecord, healthy: Sequence[JointRecord], names: Sequence[str]) -> float:
    """Return how likely a record of a state differs as much as this one in any figure."""
    least = 1.0
    for name in names:
        observed = [Observation(one.figures[name], 0.0, one.day) for one in healthy]
        size = abs(float(np.mean([one.value for one in observed])))
        between = _BETWEEN * (size if name in ("effort_forward", "effort_backward") else 1.0)
        own = Observation(record.figures[name], 0.0, record.day)
        test = SingleTest.of(own, observed, max(between, math.ulp(1.0)))
        least = min(least, test.probability)
    return min(1.0, len(names) * least)
