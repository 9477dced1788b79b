# SPDX-License-Identifier: Apache-2.0
"""Entries of a unit's history: its tests, with the findings and events of each."""

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final, NamedTuple

import numpy as np

from ema_core.dates import has_date
from ema_core.quantity import is_finite_number
from ema_monitor.identification.estimate import (
    Estimate,
    Verdict,
    estimate_of,
    estimate_record,
    plain,
    reasons_of,
)
from ema_monitor.joint.comparison import Comparison
from ema_monitor.joint.window_figures import WindowFigures, figures_of_row, row_of
from ema_monitor.prognosis.duty.damage import NOTHING_FLOWN, FlownDuty
from ema_monitor.prognosis.events import Occurrence, UnitEvent
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.reason_texts import joined
from ema_monitor.reasons import Reason, StampsContradict

_MOST_HOURS: Final = 1e7
_MOST_CYCLES: Final = 10**12


@dataclass(frozen=True, slots=True)
class Count:
    """Count of the service life of a unit.

    Raises
    ------
    ValueError
        If a value is impossible; the message names it.
    """

    stamp_ns: int
    """Time at which the count was read [ns]."""
    hours: float
    """Hours in service since new [h], at most 1e7."""
    cycles: int
    """Test cycles since new, at most 1e12; 0 if they are not counted."""

    def __post_init__(self) -> None:
        if not is_finite_number(self.hours) or not 0.0 <= self.hours <= _MOST_HOURS:
            hours = f"{self.hours:g}" if isinstance(self.hours, int | float) else repr(self.hours)
            raise ValueError(f"flight_hours = {hours} h: expected a number in [0, {_MOST_HOURS:g}]")
        is_whole = is_finite_number(self.cycles) and self.cycles == int(self.cycles)
        if not is_whole or not 0 <= self.cycles <= _MOST_CYCLES:
            raise ValueError(
                f"cycles = {self.cycles!r}: expected a whole number in [0, {_MOST_CYCLES:g}]"
            )


@dataclass(frozen=True, slots=True)
class Entry:
    """A valid test.

    Raises
    ------
    ValueError
        If the estimate is not valid, or has an impossible value.
    """

    estimate: Estimate
    """Estimate of the test's window."""
    hours: float
    """Service hour of the test according to ``hours_per_cycle`` [h]; NaN if counted or unknown."""
    cycles: int
    """Test cycles up to and including the test."""
    count: Count | None = None
    """Latest count of service hours before the test; None without a count, or if
    ``hours_per_cycle`` is set."""
    flown: FlownDuty = NOTHING_FLOWN
    """Duty since the previous valid test, as far as telemetry covers it."""
    shift_ns: int = 0
    """Correction added to the stamps of the estimate to put the test in order [ns]."""

    def __post_init__(self) -> None:
        Measurement.of(self.estimate, 0.0 if math.isnan(self.hours) else self.hours)

    @property
    def stamp_ns(self) -> int:
        """Time of the window's end, by which tests are ordered [ns]."""
        return self.estimate.end_ns

    @property
    def end_ns(self) -> int:
        """Stamp of the window's end, as in the telemetry [ns]."""
        return self.estimate.end_ns - self.shift_ns

    @property
    def verdict(self) -> Verdict:
        """Verdict of the estimate."""
        return self.estimate.verdict

    @property
    def parts(self) -> tuple[WindowFigures, ...]:
        """Figures of the windows of the estimate."""
        return self.estimate.parts


@dataclass(frozen=True, slots=True)
class UnusedCycle:
    """A test cycle that counts as usage but has no valid estimate."""

    stamp_ns: int
    """Time of the window's end, by which tests are ordered [ns]."""
    verdict: Verdict
    reasons: tuple[Reason, ...] = ()
    """Verdict of the estimate, and the reasons why it is not valid."""
    flown: FlownDuty = NOTHING_FLOWN
    """Duty since the previous test cycle, as far as telemetry covers it."""
    parts: tuple[WindowFigures, ...] = ()
    comparison: Comparison | None = None
    """Figures of the windows of the estimate, and comparison with healthy records."""
    shift_ns: int = 0
    """Correction added to the stamps of the test to put it in order [ns]."""
    is_ordered: bool = True
    """Whether its position among the tests is known."""

    @classmethod
    def of(
        cls, estimate: Estimate, flown: FlownDuty = NOTHING_FLOWN, shift_ns: int = 0
    ) -> "UnusedCycle":
        """Return the unused test cycle of an estimate that is not valid."""
        return cls(
            estimate.end_ns,
            estimate.verdict,
            estimate.reasons,
            flown,
            estimate.parts,
            estimate.comparison,
            shift_ns,
        )

    @property
    def end_ns(self) -> int:
        """Stamp of the window's end, as in the telemetry [ns]."""
        return self.stamp_ns - self.shift_ns

    @property
    def reason(self) -> str:
        """Why there is no valid estimate, as a sentence."""
        return joined(self.reasons)


Test = Entry | UnusedCycle


@dataclass(frozen=True, slots=True)
class Assessment:
    """Health and remaining life after a test."""

    stamp_ns: int
    flight_hours: float
    """Stamp of the test [ns] and its service hours [h]; NaN when unknown."""
    level: int
    health_index: float
    dominant_fault: str
    """Level, index and dominant fault of the unit's health."""
    life: tuple[float, float, float] | None
    """5, 50 and 95 % quantiles of the remaining life [h]; None when it is unknown."""
    alarms: Mapping[str, int] = field(default_factory=dict)
    """Levels of the faults and requirements in WARN or ERROR, by name."""
    events: tuple[UnitEvent, ...] = ()
    """Events since the previous test."""
    unconfirmed: Mapping[str, int] = field(default_factory=dict)
    """Lower levels that the test shows and later tests must confirm, by name."""


def as_text(test: Test) -> str:
    """Return a test as JSON."""
    record: dict[str, Any] = {"end_ns": test.stamp_ns}
    if isinstance(test, Entry):
        record |= {
            "hours": plain(test.hours),
            "cycles": test.cycles,
            "count": asdict(test.count) if test.count else None,
            "estimate": estimate_record(test.estimate),
        }
    else:
        rows = plain([row_of(part) for part in test.parts])
        record |= {"verdict": test.verdict, "reason": test.reason, "parts": rows}
        record["reasons"] = plain([reason.as_record() for reason in test.reasons])
        if not test.is_ordered:
            record["is_ordered"] = False
        if test.comparison is not None:
            record["comparison"] = plain(test.comparison.as_mapping())
    if test.shift_ns:
        record["shift_ns"] = test.shift_ns
    if test.flown.hours:
        record["duty"] = {
            "hours": test.flown.hours,
            "travel": test.flown.travel.tolist(),
            "winding": test.flown.winding.tolist(),
        }
    return json.dumps(record, ensure_ascii=False, allow_nan=False)


def read_test(text: str) -> Test:
    """Return the test parsed from the output of ``as_text``."""
    record: dict[str, Any] = json.loads(text)
    flown = NOTHING_FLOWN
    if "duty" in record:
        hours, *classes = (record["duty"][name] for name in ("hours", "travel", "winding"))
        flown = FlownDuty(hours, *map(np.array, classes))
    if "estimate" not in record:
        parts = tuple(figures_of_row(row) for row in record.get("parts", ()))
        compared = record.get("comparison")
        return UnusedCycle(
            record["end_ns"],
            Verdict(record["verdict"]),
            reasons_of(record),
            flown,
            parts,
            None if compared is None else Comparison.of_mapping(compared),
            record.get("shift_ns", 0),
            record.get("is_ordered", True),
        )
    hours, count = record["hours"], record["count"]
    return Entry(
        estimate_of(record["estimate"]),
        math.nan if hours is None else hours,
        record["cycles"],
        Count(**count) if count else None,
        flown,
        record.get("shift_ns", 0),
    )


def assessment_text(assessment: Assessment) -> str:
    """Return an assessment as JSON; non-finite numbers are written as NaN and Infinity."""
    events = [
        {
            "stamp_ns": event.stamp_ns,
            "flight_hours": event.flight_hours,
            "occurrence": event.occurrence.as_record(),
        }
        for event in assessment.events
    ]
    record = asdict(replace(assessment, events=())) | {"events": events}
    return json.dumps(record, ensure_ascii=False)


def read_assessment(text: str) -> Assessment:
    """Return the assessment parsed from the output of ``assessment_text``."""
    record: dict[str, Any] = json.loads(text)
    life, events = record.pop("life"), record.pop("events")
    return Assessment(
        **record,
        life=tuple(life) if life else None,
        events=tuple(
            UnitEvent(
                event["stamp_ns"], event["flight_hours"], Occurrence.of_record(event["occurrence"])
            )
            for event in events
        ),
    )


class StampedTest(NamedTuple):
    """Time, origin and identity of a test in a recording."""

    start_ns: int
    end_ns: int
    """Stamps of the first and last sample [ns]."""
    bag: str
    """Name of the recording."""
    content: Any
    """Identity of the test, which its copies share."""
    is_refused: bool = False
    """Whether the test is refused. A refused test may overlap other tests, because a truncated
    recording contains parts of tests."""


def unordered(tests: Iterable[StampedTest]) -> dict[str, StampsContradict]:
    """Return the reason for each bag in which the order of tests is unknown, keyed by bag.

    Tests must not overlap in time unless they are copies, and stamps must not go back within a bag.

    Parameters
    ----------
    tests
        Tests of all bags; the tests of a bag in the order of recording.
    """
    tests = list(tests)
    reasons = _stepped_back(tests)
    earlier: list[StampedTest] = []
    whole = (test for test in tests if not test.is_refused)
    for test in sorted(whole, key=lambda test: (test.start_ns, test.end_ns, test.bag)):
        earlier = [overlapping for overlapping in earlier if overlapping.end_ns > test.start_ns]
        for overlapping in earlier:
            if test.content != overlapping.content:
                bags = dict.fromkeys((overlapping.bag, test.bag))
                end_s = min(overlapping.end_ns, test.end_ns) * 1e-9
                reason = StampsContradict(tuple(bags), 0.0, end_s, has_date(test.end_ns))
                reasons = dict.fromkeys(bags, reason) | reasons
        earlier.append(test)
    return reasons


def _stepped_back(tests: Iterable[StampedTest]) -> dict[str, StampsContradict]:
    """Return the reason for each bag in which a test is stamped before an earlier test.

    A repeated test, as in a recording of a playback, does not count.
    """
    reasons: dict[str, StampsContradict] = {}
    latest_ns: dict[str, int] = {}
    visited = set[tuple[str, int, int]]()
    for test in tests:
        times = test.bag, test.start_ns, test.end_ns
        before_ns = latest_ns.get(test.bag, test.end_ns)
        if test.end_ns < before_ns and times not in visited:
            back_s = (before_ns - test.end_ns) * 1e-9
            reason = StampsContradict((test.bag,), back_s, math.nan, has_date(test.end_ns))
            reasons.setdefault(test.bag, reason)
        visited.add(times)
        latest_ns[test.bag] = max(before_ns, test.end_ns)
    return reasons
