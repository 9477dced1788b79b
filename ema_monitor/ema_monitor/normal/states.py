"""States that the owner has named: which of them a test looks like, or none."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array
from ema_monitor.normal.features import FEATURES, Feature
from ema_monitor.normal.normal import FEWEST_TESTS, NONE_OF_THESE, HealthyTest, Normal

_STRANGE: Final = 1e-3
_SHRINKAGE: Final = 0.05


class LabelledTest(NamedTuple):
    """A test whose state its owner has named: its means, and the figures of its parts by name."""

    state: str
    test: HealthyTest
    parts: Sequence[Mapping[str, float]]


class States:
    """Tells two or more states, as of `known_states`, apart by linear discriminants with shrinkage.

    A test that departs from all of them, each taken as a normal of its own, is none of these.

    Raises
    ------
    ValueError
        When the tests share no figure.
    """

    def __init__(
        self,
        known: Mapping[str, Sequence[LabelledTest]],
        features: Mapping[str, Feature] = FEATURES,
    ) -> None:
        from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler

        self._normals = [Normal([one.test for one in found], features) for found in known.values()]
        parts = [part for found in known.values() for one in found for part in one.parts]
        self.names = [name for name in features if all(name in part for part in parts)]
        labels = [state for state, found in known.items() for one in found for _ in one.parts]
        # Equal priors: how often a state was labelled says nothing of how often it comes.
        discriminants = LinearDiscriminantAnalysis(
            solver="lsqr", shrinkage=_SHRINKAGE, priors=np.full(len(known), 1.0 / len(known))
        )
        self._model = make_pipeline(StandardScaler(), discriminants)
        self._model.fit(self._values(parts), labels)

    def probabilities(self, test: HealthyTest) -> dict[str, float]:
        """Return the probability of each state, ``NONE_OF_THESE`` among them, the largest first.

        Raises
        ------
        ValueError
            When a figure of the labelled tests is missing.
        """
        missing = [name for name in self.names if name not in test.features]
        if missing:
            raise ValueError(f"the test lacks {', '.join(missing)}, which the labelled ones have")
        shares = self._model.predict_proba(self._values([test.features]))[0]
        known = max(one.departure(test).probability for one in self._normals)
        none = _STRANGE / (_STRANGE + known)
        found = {
            str(name): float(share * (1.0 - none))
            for name, share in zip(self._model.classes_, shares, strict=True)
        }
        return dict(sorted({**found, NONE_OF_THESE: none}.items(), key=lambda item: -item[1]))

    def _values(self, parts: Iterable[Mapping[str, float]]) -> Array:
        return np.array([[part[name] for name in self.names] for part in parts])


def known_states(tests: Iterable[LabelledTest]) -> dict[str, list[LabelledTest]]:
    """Return tests by their state, if it has ``FEWEST_TESTS`` of them."""
    found: dict[str, list[LabelledTest]] = {}
    for one in tests:
        found.setdefault(one.state, []).append(one)
    return {state: some for state, some in found.items() if len(some) >= FEWEST_TESTS}
