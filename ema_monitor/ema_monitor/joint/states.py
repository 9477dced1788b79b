# SPDX-License-Identifier: Apache-2.0
"""Classification of a test or record into labelled states."""

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

_NOVEL: Final = 1e-3
_SHRINKAGE: Final = 0.05
_BETWEEN: Final = 0.03
_OF_RECORDS: Final = {
    **dict.fromkeys(LEVELS, JudgedFigure(_BETWEEN, is_logarithm=False)),
    **dict.fromkeys(LOGARITHMS, JudgedFigure(_BETWEEN)),
}


class Example(NamedTuple):
    """A test or record with a known state, to train the classifier."""

    state: str
    """``HEALTHY``, or the label of the test or record."""
    test: DatedFigures
    """Mean figures and day of the test."""
    stretches: Sequence[Mapping[str, float]]
    """Figures by name, for each stretch of a test or each part of a record."""


def examples_by_state(examples: Iterable[Example]) -> dict[str, list[Example]]:
    """Return examples grouped by state, without states that have fewer than ``FEWEST``."""
    by_state: dict[str, list[Example]] = {}
    for example in examples:
        by_state.setdefault(example.state, []).append(example)
    return {state: group for state, group in by_state.items() if len(group) >= FEWEST}


def probabilities(
    examples: Mapping[str, Sequence[Example]],
    tested: DatedFigures,
    figures: Mapping[str, JudgedFigure],
) -> Mapping[str, float]:
    """Return the probability of each state, the most probable first.

    The classifier is a linear discriminant analysis with shrinkage. All states have the same prior
    probability, because the number of labels does not show how often a state occurs. If the test
    departs from every state, ``NONE_OF_THESE`` is the most probable.

    Parameters
    ----------
    examples
        Examples of each state.
    tested
        Mean figures and day of the test.
    figures
        Figures to compare, by name. Figures that the test or an example lacks are ignored.

    Returns
    -------
    Mapping
        Probabilities by state; empty for fewer than two states, or without a common figure.
    """
    stretches = [row for group in examples.values() for item in group for row in item.stretches]
    names = [
        name for name in figures if name in tested.values and all(name in row for row in stretches)
    ]
    if len(examples) < 2 or not names:
        return {}
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    labels = [state for state, group in examples.items() for item in group for _ in item.stretches]
    discriminants = LinearDiscriminantAnalysis(
        solver="lsqr", shrinkage=_SHRINKAGE, priors=np.full(len(examples), 1.0 / len(examples))
    )
    model = make_pipeline(StandardScaler(), discriminants)
    model.fit(_values(stretches, names), labels)
    shares = model.predict_proba(_values([tested.values], names))[0]
    chosen = {name: figures[name] for name in names}
    nearest = max(
        departure_of(tested, [example.test for example in group], chosen).probability
        for group in examples.values()
    )
    novelty = _NOVEL / (_NOVEL + nearest)
    probability = {
        str(state): float(share * (1.0 - novelty))
        for state, share in zip(model.classes_, shares, strict=True)
    }
    return dict(sorted({**probability, NONE_OF_THESE: novelty}.items(), key=lambda item: -item[1]))


def state_probabilities(baseline: Baseline, record: JointRecord) -> Mapping[str, float]:
    """Return the probability of each state for a record, the most probable first.

    The result is empty if the baseline has no labelled states, fewer than two states have enough
    examples, or the parts have no common figure.
    """
    if not baseline.labelled:
        return {}
    examples = [
        *(LabelledRecord(HEALTHY, record) for record in baseline.records),
        *baseline.labelled,
    ]
    # A record without steady motion in both directions has no parts.
    by_state = examples_by_state(
        _example(example.state, example.record) for example in examples if example.record.parts
    )
    tested = DatedFigures(record.day_to_predict, mean_of(record.parts))
    return probabilities(by_state, tested, _OF_RECORDS)


def _example(state: str, record: JointRecord) -> Example:
    return Example(state, DatedFigures(record.day, mean_of(record.parts)), record.parts)


def _values(rows: Iterable[Mapping[str, float]], names: Sequence[str]) -> Array:
    return np.array([[row[name] for name in names] for row in rows])
