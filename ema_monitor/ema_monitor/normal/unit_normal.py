"""Windows of a unit in a known state, healthy above all, by which later ones are judged (M47)."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import Any, Final, NamedTuple, Self

import numpy as np

from ema_core.telemetry import Telemetry
from ema_core.wording import unknown_name
from ema_monitor.normal.features import (
    FEATURES,
    LEVEL,
    Motion,
    Part,
    figures_of,
    mean_of,
    part_of,
    row_of,
)
from ema_monitor.normal.normal import FEWEST_TESTS, HEALTHY, Departure, HealthyTest, Normal
from ema_monitor.normal.states import LabelledTest, States, known_states

_REPEATED: Final = 0.5
_SAME_LOAD: Final = 0.05
_LARGE_LOAD: Final = 0.1
_BOTH_WAYS: Final = ("current_forward", "current_backward")


class KnownWindow(NamedTuple):
    """Figures of a window, its state, when it began [ns], and the number of its test.

    A healthy window is a test of its own; all of them have number 0.
    """

    state: str
    stamp_ns: int
    part: Part
    test: int = 0


@dataclass(frozen=True)
class UnitNormal:
    """The windows of a unit whose state is known."""

    windows: tuple[KnownWindow, ...] = ()

    @classmethod
    def of(cls, windows: Iterable[Telemetry]) -> Self:
        """Return the figures of healthy windows that have a stroke in each direction."""
        found = ((one.stamp_ns, part) for one in windows for part in figures_of(one))
        return cls(tuple(KnownWindow(HEALTHY, *one) for one in found))

    def with_test(self, state: str, stamp_ns: int, parts: Sequence[Part]) -> Self:
        """Return it with the stretches of a test in a state; one that is known has its new state.

        Raises
        ------
        ValueError
            When there is no stretch, one of them is healthy by the calibration, or no healthy
            window has its motion and load.
        """
        if not parts:
            raise ValueError("it has no stretch in each direction with a measured current")
        self._require_known(parts)
        if any(one.part in parts for one in self.healthy):
            raise ValueError("it is one of the healthy tests of the calibration")
        kept = [one for one in self.windows if not one.test or one.part not in parts]
        number = 1 + max((one.test for one in self.windows), default=0)
        return type(self)((*kept, *(KnownWindow(state, stamp_ns, one, number) for one in parts)))

    def _require_known(self, parts: Sequence[Part]) -> None:
        for one in parts:
            if not (healthy := self._like(one.motion)):
                raise ValueError(f"no healthy window has its motion, {one.motion}")
            away = _distance(healthy, _load(one.features))
            if away > _LARGE_LOAD * _running(healthy):
                raise ValueError(
                    f"its load is {away:.2g} A away from the healthy windows: `ema "
                    "calibrate` needs healthy bags of that load, too"
                )

    def with_labels_of(self, other: Self) -> Self:
        """Return it with those labelled tests of another normal that have a motion of its own."""
        mine = [one.part for one in self.healthy]
        labelled = [one for one in other.windows if one.test and one.part not in mine]
        kept = (one for one in labelled if self._like(one.part.motion))
        return type(self)((*self.healthy, *kept))

    def without(self, state: str) -> Self:
        """Return it without the labelled tests of a state; ValueError when there are none."""
        kept = tuple(one for one in self.windows if not one.test or one.state != state)
        if len(kept) == len(self.windows):
            raise ValueError(unknown_name("state", state, self.tests().keys() - {HEALTHY}))
        return type(self)(kept)

    def _like(self, motion: Motion, *, labelled: bool = False) -> list[KnownWindow]:
        windows = (one for one in self.windows if bool(one.test) == labelled)
        return [one for one in windows if one.part.motion.is_like(motion)]

    @cached_property
    def _repeats_motions(self) -> bool:
        """Whether half of the healthy windows repeat a motion; by chance, only a few are alike."""
        alike = [len(self._like(one.part.motion)) >= FEWEST_TESTS for one in self.healthy]
        return sum(alike) >= _REPEATED * len(alike)

    @property
    def healthy(self) -> tuple[KnownWindow, ...]:
        """The windows that are the unit's normal."""
        return tuple(one for one in self.windows if not one.test)

    def tests(self) -> dict[str, int]:
        """Return how many tests there are of each state."""
        return Counter(one.state for one in _tests(self.windows, 1))

    @property
    def loads(self) -> tuple[float, float]:
        """The least and largest load of a healthy window, from their mean [A]."""
        loads = [_load(one.part.features) for one in self.healthy] or [0.0]
        mean = sum(loads) / len(loads)
        return min(loads) - mean, max(loads) - mean

    def beyond(self, motion: Motion) -> tuple[float, float]:
        """Return how many times as fast, and as far, a motion is as the nearest healthy window."""
        known = [one.part.motion for one in self.healthy]
        if not known:
            return 1.0, 1.0
        speeds, shortest = [one.speed for one in known], min(one.travel for one in known)
        nearest = min(max(motion.speed, min(speeds)), max(speeds))
        return motion.speed / nearest, min(1.0, motion.travel / shortest)

    def departure(self, stamp_ns: int, parts: Sequence[Part]) -> Departure | None:
        """Return how unlikely a test is for the healthy unit, by its stretches.

        Stretches of each motion and load are compared with healthy windows of both, or of the
        nearest load: with the means of as many in a row, so that like scatters are compared; of
        fewer, where there would not be ``FEWEST_TESTS`` means. None where it is unknown and no
        state is labelled: there is no stretch, no motion or load has ``FEWEST_TESTS`` windows, or
        the healthy windows do not repeat motions.
        """
        if not self._repeats_motions:
            return None
        found: list[Departure | str] = []
        for own in _by_motion(parts):
            healthy = self._like(own[0].motion)
            if len(healthy) < FEWEST_TESTS:
                found.append(f"no healthy window has the motion, {own[0].motion}")
                continue
            loads = _by_load(healthy, _SAME_LOAD * _running(healthy))
            under: dict[int, list[Part]] = {}
            for part in own:
                under.setdefault(_nearest(loads, _load(part.features)), []).append(part)
            # A test that was labelled is not judged by itself.
            labelled = [
                one for one in self._like(own[0].motion, labelled=True) if one.part not in parts
            ]
            for near, some in under.items():
                beside = [
                    one for one in labelled if _nearest(loads, _load(one.part.features)) == near
                ]
                found.append(_judged(stamp_ns, some, loads[near], beside, _running(healthy)))
        has_labels = len(self.healthy) < len(self.windows)
        judged = [one for one in found if isinstance(one, Departure)]
        if not judged:
            reasons = [f"no state is named: {one}" for one in found if has_labels]
            return Departure(1.0, (), unnamed=reasons[0]) if reasons else None
        worst = min(judged, key=lambda one: one.probability)
        if has_labels and not (worst.states or worst.unnamed):
            words = f"no labelled one has {FEWEST_TESTS} tests of this motion and load"
            worst = replace(worst, unnamed=f"no state is named: {words}")
        return replace(worst, probability=min(1.0, len(judged) * worst.probability))

    def as_mapping(self) -> dict[str, Any]:
        """Return plain values: names, and a row a window; a figure that it lacks is NaN."""
        rows = [[one.state, one.test, one.stamp_ns, *row_of(one.part)] for one in self.windows]
        return {"figures": list(FEATURES), "windows": rows}

    @classmethod
    def of_mapping(cls, content: dict[str, Any]) -> Self:
        """Return what ``as_mapping`` gives."""
        windows = (
            KnownWindow(str(state), int(stamp_ns), part_of(row, content["figures"]), int(test))
            for state, test, stamp_ns, *row in content["windows"]
        )
        return cls(tuple(windows))


def _judged(
    stamp_ns: int,
    parts: Sequence[Part],
    healthy: Sequence[KnownWindow],
    labelled: Sequence[KnownWindow],
    running: float,
) -> Departure | str:
    """Return how unlikely stretches are for healthy windows like them, or why that is unknown."""
    if len(healthy) < FEWEST_TESTS:
        return f"the load has fewer than {FEWEST_TESTS} healthy windows"
    figures = mean_of(parts)
    load = _load(figures)
    size = min(len(parts), len(healthy) // FEWEST_TESTS)
    test = HealthyTest(stamp_ns, figures)
    tests = list(_tests(healthy, size))
    found = Normal([one.test for one in tests]).departure(test)
    is_of_levels = all(one.feature.kind == LEVEL for one in found.changes)
    enough = running * (_SAME_LOAD if is_of_levels else _LARGE_LOAD)
    found = replace(found, load_explains=_distance(healthy, load) > enough)
    known = known_states([*tests, *_tests(labelled, size)])
    if len(known) < 2:
        return found
    if (away := _distance([*healthy, *labelled], load)) > _SAME_LOAD * running:
        words = f"the load is new, {away:.2g} A from the known windows"
        return replace(found, unnamed=f"no state is named: {words}")
    features = {name: FEATURES[name] for name in figures}
    return replace(found, states=States(known, features).probabilities(test))


def _tests(windows: Sequence[KnownWindow], size: int) -> Iterator[LabelledTest]:
    """Yield tests: so many healthy windows in a row, and all of a test in another state."""
    healthy = [one for one in windows if not one.test]
    rows = [healthy[at : at + size] for at in range(0, len(healthy) - size + 1, size)]
    others = groupby((one for one in windows if one.test), key=lambda one: one.test)
    for row in (*rows, *(list(one) for _, one in others)):
        parts = [one.part for one in row]
        test = HealthyTest(row[0].stamp_ns, mean_of(parts))
        yield LabelledTest(row[0].state, test, [part.features for part in parts])


def _by_motion(parts: Iterable[Part]) -> list[list[Part]]:
    """Return parts in groups of like motion."""
    found: list[list[Part]] = []
    for part in parts:
        alike = next((one for one in found if one[0].motion.is_like(part.motion)), None)
        if alike is None:
            found.append(alike := [])
        alike.append(part)
    return found


def _running(windows: Sequence[KnownWindow]) -> float:
    """Return the larger mean current of both directions [A]."""
    figures = mean_of([one.part for one in windows])
    return max(abs(figures[name]) for name in _BOTH_WAYS)


def _load(figures: Mapping[str, float]) -> float:
    """Return the current that does not follow the direction [A]."""
    forward, backward = (figures[name] for name in _BOTH_WAYS)
    return 0.5 * (forward - backward)


def _by_load(windows: Sequence[KnownWindow], gap: float) -> list[list[KnownWindow]]:
    """Return windows in groups between which the load [A] has a gap, each in their order."""
    order = sorted(range(len(windows)), key=lambda at: _load(windows[at].part.features))
    steps = np.diff([_load(windows[at].part.features) for at in order])
    groups = np.split(order, np.flatnonzero(steps > gap) + 1)
    return [[windows[at] for at in sorted(group)] for group in groups]


def _nearest(groups: Sequence[Sequence[KnownWindow]], load: float) -> int:
    return int(np.argmin([_distance(one, load) for one in groups]))


def _distance(group: Sequence[KnownWindow], load: float) -> float:
    return min(abs(_load(one.part.features) - load) for one in group)
