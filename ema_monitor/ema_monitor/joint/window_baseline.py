# SPDX-License-Identifier: Apache-2.0
"""Healthy and labelled windows of a unit, and the departure of later windows from them.

The method is described in ``docs/real-data.md``, M47.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import Any, Final, NamedTuple, Self

import numpy as np

from ema_core.telemetry import Telemetry
from ema_core.wording import unknown_name
from ema_monitor.joint.departure import FEWEST, HEALTHY, DatedFigures, Departure, departure_of
from ema_monitor.joint.record import NS_A_DAY
from ema_monitor.joint.states import Example, examples_by_state, probabilities
from ema_monitor.joint.window_figures import (
    WINDOW_FIGURES,
    CommandedMotion,
    WindowFigures,
    figures_of,
    figures_of_row,
    mean_of,
    row_of,
)
from ema_monitor.reasons import OtherLoad, OtherMotion, StateUnnamed, TooFewHealthy, TooFewLabelled

_REPEATED: Final = 0.5
_SAME_LOAD: Final = 0.05
_LARGE_LOAD: Final = 0.1
_BOTH_WAYS: Final = ("current_forward", "current_backward")


class ReferenceWindow(NamedTuple):
    """Figures, timestamp [ns] and test number of a healthy or labelled window.

    Windows of a labelled test share a number. Healthy windows have the number 0.
    """

    state: str
    stamp_ns: int
    figures: WindowFigures
    test: int = 0


@dataclass(frozen=True)
class WindowBaseline:
    """Healthy and labelled windows of a unit."""

    windows: tuple[ReferenceWindow, ...] = ()

    @classmethod
    def of(cls, windows: Iterable[Telemetry]) -> Self:
        """Return a baseline from healthy windows.

        Windows without a measured current, or without strokes in both directions, are ignored.
        """
        return cls(
            tuple(
                ReferenceWindow(HEALTHY, window.stamp_ns, figures)
                for window in windows
                for figures in figures_of(window)
            )
        )

    def with_test(self, state: str, stamp_ns: int, windows: Sequence[WindowFigures]) -> Self:
        """Return the baseline with a labelled test, replacing earlier labels of its windows.

        Raises
        ------
        ValueError
            If there is no window, a window belongs to the healthy windows, or no healthy window has
            the same motion and load as a window.
        """
        if not windows:
            raise ValueError("it has no strokes in both directions with a measured current")
        self._require_comparable(windows)
        if any(window.figures in windows for window in self.healthy):
            raise ValueError("it is one of the healthy tests of the calibration")
        kept = [
            window for window in self.windows if not window.test or window.figures not in windows
        ]
        number = 1 + max((window.test for window in self.windows), default=0)
        return type(self)(
            (*kept, *(ReferenceWindow(state, stamp_ns, window, number) for window in windows))
        )

    def _require_comparable(self, windows: Sequence[WindowFigures]) -> None:
        for window in windows:
            if not (healthy := self._like(window.motion)):
                raise ValueError(f"no healthy window has its motion, {window.motion}")
            distance = _distance(healthy, _load(window.values))
            if distance > _LARGE_LOAD * _running(healthy):
                raise ValueError(
                    f"its load differs by {distance:.2g} A from the healthy windows: "
                    "calibrate with healthy bags of this load, too (`ema calibrate`)"
                )

    def with_labels_of(self, source: Self) -> Self:
        """Return the baseline with its labelled tests replaced by the labelled tests of ``source``.

        Labelled windows are omitted if they belong to the healthy windows of this baseline, or if
        no healthy window has a similar motion.
        """
        healthy = [window.figures for window in self.healthy]
        labelled = [
            window for window in source.windows if window.test and window.figures not in healthy
        ]
        kept = (window for window in labelled if self._like(window.figures.motion))
        return type(self)((*self.healthy, *kept))

    def without(self, state: str) -> Self:
        """Return the baseline without the tests labelled ``state``.

        Raises
        ------
        ValueError
            If no test has this label.
        """
        kept = tuple(window for window in self.windows if not window.test or window.state != state)
        if len(kept) == len(self.windows):
            raise ValueError(unknown_name("state", state, self.states().keys() - {HEALTHY}))
        return type(self)(kept)

    def _like(self, motion: CommandedMotion, *, labelled: bool = False) -> list[ReferenceWindow]:
        windows = (window for window in self.windows if bool(window.test) == labelled)
        return [window for window in windows if window.figures.motion.is_like(motion)]

    @cached_property
    def _repeats_motions(self) -> bool:
        """Whether at least half of the healthy windows repeat a motion."""
        alike = [len(self._like(window.figures.motion)) >= FEWEST for window in self.healthy]
        return sum(alike) >= _REPEATED * len(alike)

    @property
    def healthy(self) -> tuple[ReferenceWindow, ...]:
        """The healthy windows."""
        return tuple(window for window in self.windows if not window.test)

    def states(self) -> dict[str, int]:
        """Return the number of tests of each state; each healthy window counts as a test."""
        return Counter(window.state for window in _tests(self.windows, 1))

    def departure(self, stamp_ns: int, windows: Sequence[WindowFigures]) -> Departure | None:
        """Return the departure of a test from the healthy windows.

        The windows of each motion and load are compared with healthy windows of the same motion and
        the nearest load. The mean of the tested windows is compared with means over the same number
        of consecutive healthy windows, so that their scatter is comparable. If there would be fewer
        than ``FEWEST`` means, they are taken over fewer windows.

        The result is None if the healthy windows do not repeat motions, or there is no window. If
        no motion and load has ``FEWEST`` healthy windows, the test cannot be compared. With
        labelled states, the result is then a departure with probability 1 and the reason in
        ``unnamed``; without them, it is None.

        Parameters
        ----------
        stamp_ns
            Timestamp of the test [ns].
        windows
            Figures of the windows of the test.
        """
        if not self._repeats_motions:
            return None
        judgements: list[Departure | StateUnnamed] = []
        for group in _by_motion(windows):
            motion = group[0].motion
            healthy = self._like(motion)
            if len(healthy) < FEWEST:
                judgements.append(OtherMotion(motion.travel, motion.speed, motion.sample_period))
                continue
            loads = _by_load(healthy, _SAME_LOAD * _running(healthy))
            by_load: dict[int, list[WindowFigures]] = {}
            for window in group:
                by_load.setdefault(_nearest(loads, _load(window.values)), []).append(window)
            # A labelled test is not compared with itself.
            labelled = [
                window
                for window in self._like(motion, labelled=True)
                if window.figures not in windows
            ]
            for nearest, tested in by_load.items():
                examples = [
                    window
                    for window in labelled
                    if _nearest(loads, _load(window.figures.values)) == nearest
                ]
                running = _running(healthy)
                judgements.append(_judged(stamp_ns, tested, loads[nearest], examples, running))
        has_labels = len(self.healthy) < len(self.windows)
        departures = [item for item in judgements if isinstance(item, Departure)]
        if not departures:
            reasons = [item for item in judgements if not isinstance(item, Departure)]
            return Departure(1.0, unnamed=reasons[0]) if has_labels and reasons else None
        worst = min(departures, key=lambda departure: departure.probability)
        if has_labels and not (worst.states or worst.unnamed):
            worst = replace(worst, unnamed=TooFewLabelled(FEWEST))
        return replace(worst, probability=min(1.0, len(departures) * worst.probability))

    def as_mapping(self) -> dict[str, Any]:
        """Return the baseline as plain values: figure names, and one row per window.

        Missing figures are NaN.
        """
        rows = [
            [window.state, window.test, window.stamp_ns, *row_of(window.figures)]
            for window in self.windows
        ]
        return {"figures": list(WINDOW_FIGURES), "windows": rows}

    @classmethod
    def of_mapping(cls, content: dict[str, Any]) -> Self:
        """Return the baseline from the output of ``as_mapping``."""
        windows = (
            ReferenceWindow(
                str(state), int(stamp_ns), figures_of_row(row, content["figures"]), int(test)
            )
            for state, test, stamp_ns, *row in content["windows"]
        )
        return cls(tuple(windows))


def _judged(
    stamp_ns: int,
    windows: Sequence[WindowFigures],
    healthy: Sequence[ReferenceWindow],
    labelled: Sequence[ReferenceWindow],
    running: float,
) -> Departure | TooFewHealthy:
    """Return the departure of windows from comparable healthy windows.

    If they cannot be compared, the reason is returned. ``running`` is the current in motion [A].
    """
    if len(healthy) < FEWEST:
        return TooFewHealthy(FEWEST)
    tested = DatedFigures(stamp_ns // NS_A_DAY, mean_of(windows))
    load = _load(tested.values)
    size = min(len(windows), len(healthy) // FEWEST)
    tests = list(_tests(healthy, size))
    departure = departure_of(tested, [example.test for example in tests], WINDOW_FIGURES)
    only_levels_depart = all(not change.figure.is_logarithm for change in departure.changes)
    least_load = running * (_SAME_LOAD if only_levels_depart else _LARGE_LOAD)
    departure = replace(departure, load_explains=_distance(healthy, load) > least_load)
    by_state = examples_by_state([*tests, *_tests(labelled, size)])
    if len(by_state) < 2:
        return departure
    if (distance := _distance([*healthy, *labelled], load)) > _SAME_LOAD * running:
        return replace(departure, unnamed=OtherLoad(distance))
    return replace(departure, states=probabilities(by_state, tested, WINDOW_FIGURES))


def _tests(windows: Sequence[ReferenceWindow], size: int) -> Iterator[Example]:
    """Yield an example per test.

    A test is ``size`` consecutive healthy windows, or all windows of a labelled test.
    """
    healthy = [window for window in windows if not window.test]
    rows = [healthy[at : at + size] for at in range(0, len(healthy) - size + 1, size)]
    labelled = groupby((window for window in windows if window.test), key=lambda row: row.test)
    for row in (*rows, *(list(test) for _, test in labelled)):
        figures = [window.figures for window in row]
        test = DatedFigures(row[0].stamp_ns // NS_A_DAY, mean_of(figures))
        yield Example(row[0].state, test, [window.values for window in figures])


def _by_motion(windows: Iterable[WindowFigures]) -> list[list[WindowFigures]]:
    """Return windows grouped by similar motion."""
    groups: list[list[WindowFigures]] = []
    for window in windows:
        similar = next((group for group in groups if group[0].motion.is_like(window.motion)), None)
        if similar is None:
            groups.append(similar := [])
        similar.append(window)
    return groups


def _running(windows: Sequence[ReferenceWindow]) -> float:
    """Return the mean current in motion, in the direction in which it is larger [A]."""
    figures = mean_of([window.figures for window in windows])
    return max(abs(figures[name]) for name in _BOTH_WAYS)


def _load(figures: Mapping[str, float]) -> float:
    """Return the load, which is the current that does not depend on the direction [A]."""
    forward, backward = (figures[name] for name in _BOTH_WAYS)
    return 0.5 * (forward - backward)


def _by_load(windows: Sequence[ReferenceWindow], gap: float) -> list[list[ReferenceWindow]]:
    """Return windows grouped by load, in their order within each group.

    The loads of two groups differ by more than ``gap`` [A].
    """
    order = sorted(range(len(windows)), key=lambda at: _load(windows[at].figures.values))
    steps = np.diff([_load(windows[at].figures.values) for at in order])
    groups = np.split(order, np.flatnonzero(steps > gap) + 1)
    return [[windows[at] for at in sorted(group)] for group in groups]


def _nearest(groups: Sequence[Sequence[ReferenceWindow]], load: float) -> int:
    return int(np.argmin([_distance(group, load) for group in groups]))


def _distance(group: Sequence[ReferenceWindow], load: float) -> float:
    return min(abs(_load(window.figures.values) - load) for window in group)
