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
    by_state: dict[str, list[Example]] = {}
    for example in examples:
        by_state.setdefault(example.state, []).append(example)
    return {state: some for state, some in by_state.items() if len(some) >= FEWEST}


def probabilities(
    examples: Mapping[str, Sequence[Example]],
    tested: DatedFigures,
    figures: Mapping[str, JudgedFigure],
) -> Mapping[str, float]:
    """Return the probability of each known state, the largest first; empty if nothing is compared.

    States are told apart by linear discriminants with shrinkage, with equal priors: how often a
    state was labelled does not show how often it occurs. A test that departs from each of them is
    none of these.
    """
    stretches = [row for some in examples.values() for example in some for row in example.stretches]
    names = [
        name for name in figures if name in tested.values and all(name in row for row in stretches)
    ]
    if len(examples) < 2 or not names:
        return {}
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    labels = [
        state for state, some in examples.items() for example in some for _ in example.stretches
    ]
    discriminants = LinearDiscriminantAnalysis(
        solver="lsqr", shrinkage=_SHRINKAGE, priors=np.full(len(examples), 1.0 / len(examples))
    )
    model = make_pipeline(StandardScaler(), discriminants)
    model.fit(_values(stretches, names), labels)
    shares = model.predict_proba(_values([tested.values], names))[0]
    chosen = {name: figures[name] for name in names}
    nearest = max(
        departure_of(tested, [example.test for example in some], chosen).probability
        for some in examples.values()
    )
    strange = _STRANGE / (_STRANGE + nearest)
    probability = {
        str(state): float(share * (1.0 - strange))
        for state, share in zip(model.classes_, shares, strict=True)
    }
    return dict(sorted({**probability, NONE_OF_THESE: strange}.items(), key=lambda item: -item[1]))


def state_probabilities(baseline: Baseline, record: JointRecord) -> Mapping[str, float]:
    """Return the probability of each state of a record; empty without labelled states."""
    if not baseline.labelled:
        return {}
    examples = [
        *(LabelledRecord(HEALTHY, record) for record in baseline.records),
        *baseline.labelled,
    ]
    # A record without steady motion in both directions has no parts.
    by_state = known_states(
        _example(example.state, example.record) for example in examples if example.record.parts
    )
    tested = DatedFigures(record.day_to_predict, mean_of(record.parts))
    return probabilities(by_state, tested, _OF_RECORDS)


def _example(state: str, record: JointRecord) -> Example:
    return Example(state, DatedFigures(record.day, mean_of(record.parts)), record.parts)


def _values(rows: Iterable[Mapping[str, float]], names: Sequence[str]) -> Array:
    return np.array([[row[name] for name in names] for row in rows])
