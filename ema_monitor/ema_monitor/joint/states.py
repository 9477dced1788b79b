"""States that the owner has labelled: which of them a test or record looks like, or none."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array
from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.departure import (
    FEWEST,
    HEALTHY,
    NONE_OF_THESE,
    DatedFigures,
    JudgedFigure,
    departure_of,
)
from ema_monitor.joint.parts import LEVELS, LOGARITHMS, mean_of
from ema_monitor.joint.record import JointRecord, LabelledRecord

_STRANGE: Final = 1e-3
_SHRINKAGE: Final = 0.05
_BETWEEN: Final = 0.03
_OF_RECORDS: Final = {
    **{name: JudgedFigure(name.replace("_", " "), _BETWEEN, is_logarithm=False) for name in LEVELS},
    **{name: JudgedFigure(name.replace("_", " "), _BETWEEN) for name in LOGARITHMS},
}


class Example(NamedTuple):
    """A test or record in a known state.

    Attributes
    ----------
    state
        The state.
    test
        Its figures, and its day.
    stretches
        Figures of each of its stretches by name; of a record, of each of its parts.
    """

    state: str
    test: DatedFigures
    stretches: Sequence[Mapping[str, float]]


def known_states(examples: Iterable[Example]) -> dict[str, list[Example]]:
    """Return the examples of each state that has enough of them."""
    found: dict[str, list[Example]] = {}
    for one in examples:
        found.setdefault(one.state, []).append(one)
    return {state: some for state, some in found.items() if len(some) >= FEWEST}


def probabilities(
    known: Mapping[str, Sequence[Example]], own: DatedFigures, figures: Mapping[str, JudgedFigure]
) -> Mapping[str, float]:
    """Return the probability of each known state, the largest first; empty if nothing is compared.

    States are told apart by linear discriminants with shrinkage, with equal priors: how often a
    state was labelled does not show how often it occurs. A test that departs from each of them is
    none of these.
    """
    stretches = [row for some in known.values() for one in some for row in one.stretches]
    names = [
        name for name in figures if name in own.values and all(name in row for row in stretches)
    ]
    if len(known) < 2 or not names:
        return {}
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    labels = [state for state, some in known.items() for one in some for _ in one.stretches]
    discriminants = LinearDiscriminantAnalysis(
        solver="lsqr", shrinkage=_SHRINKAGE, priors=np.full(len(known), 1.0 / len(known))
    )
    model = make_pipeline(StandardScaler(), discriminants)
    model.fit(_values(stretches, names), labels)
    shares = model.predict_proba(_values([own.values], names))[0]
    chosen = {name: figures[name] for name in names}
    nearest = max(
        departure_of(own, [one.test for one in some], chosen).probability for some in known.values()
    )
    strange = _STRANGE / (_STRANGE + nearest)
    found = {
        str(state): float(share * (1.0 - strange))
        for state, share in zip(model.classes_, shares, strict=True)
    }
    return dict(sorted({**found, NONE_OF_THESE: strange}.items(), key=lambda one: -one[1]))


def state_probabilities(baseline: Baseline, record: JointRecord) -> Mapping[str, float]:
    """Return the probability of each state of a record; empty without labelled states."""
    if not baseline.labelled:
        return {}
    examples = [*(LabelledRecord(HEALTHY, one) for one in baseline.records), *baseline.labelled]
    # A record without steady motion in both directions has no parts.
    known = known_states(_example(one.state, one.record) for one in examples if one.record.parts)
    own = DatedFigures(record.day_to_predict, mean_of(record.parts))
    return probabilities(known, own, _OF_RECORDS)


def _example(state: str, record: JointRecord) -> Example:
    return Example(state, DatedFigures(record.day, mean_of(record.parts)), record.parts)


def _values(rows: Iterable[Mapping[str, float]], names: Sequence[str]) -> Array:
    return np.array([[one[name] for name in names] for one in rows])
