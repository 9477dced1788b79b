# SPDX-License-Identifier: Apache-2.0
"""History entries of new tests, with their service hours and test cycles."""

import math
from bisect import bisect

from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.duty.damage import FlownDuty
from ema_monitor.prognosis.events import EstimatesMissing, Occurrence
from ema_monitor.prognosis.history_entry import Count, Entry
from ema_monitor.prognosis.service import ServiceHours


def next_entry(
    estimate: Estimate,
    service: ServiceHours,
    hours_per_cycle: float,
    new_cycles: int,
    count: Count | None,
    flown: FlownDuty,
    shift_ns: int,
) -> tuple[Entry, list[Occurrence]]:
    """Return the entry of the next valid test, with an event if tests are missing before it.

    Parameters
    ----------
    estimate
        Estimate of its window.
    service
        Service hours of the tests so far.
    hours_per_cycle
        Service hours per test cycle [h]; 0 if service hours are counted.
    new_cycles
        Test cycles after the latest valid test, including this test.
    count
        Latest count of service hours read before the test, or None.
    flown
        Duty since the latest valid test.
    shift_ns
        Correction added to the stamps of the estimate [ns].
    """
    latest = service.latest
    cycles = new_cycles + (latest.cycles if latest else 0)
    hours, newest = math.nan, None
    if hours_per_cycle > 0.0:
        hours = service.after(cycles, hours_per_cycle)
    else:
        before = latest.count if latest else None
        # After a restart, the latest count may be in the history only.
        newest = _later(count, before, estimate.end_ns)
        if newest is not None and newest != before:
            cycles = newest.cycles or cycles
    missed = cycles - latest.cycles - 1 if latest else 0
    gaps: list[Occurrence] = [EstimatesMissing(missed)] if missed > 0 else []
    return Entry(estimate, hours, cycles, newest, flown, shift_ns), gaps


def late_entry(
    estimate: Estimate,
    entries: list[Entry],
    hours_per_cycle: float,
    count: Count | None,
    flown: FlownDuty,
) -> Entry:
    """Return the entry of a valid test that is older than the latest test.

    Parameters
    ----------
    estimate
        Estimate of its window.
    entries
        Valid tests in order of their stamps; the last test is later than this test.
    hours_per_cycle
        Service hours per test cycle [h]; 0 if service hours are counted.
    count
        Latest count of service hours read before the test, or None.
    flown
        Duty since the preceding test.
    """
    place = bisect(entries, estimate.end_ns, key=lambda entry: entry.stamp_ns)
    before, after = entries[place - 1] if place else None, entries[place]
    cycles = min(before.cycles + 1, after.cycles) if before else max(after.cycles - 1, 1)
    if hours_per_cycle > 0.0:
        begin = before.hours + hours_per_cycle if before else after.hours - hours_per_cycle
        return Entry(estimate, min(max(begin, 0.0), after.hours), cycles, None, flown)
    count = _later(count, before.count if before else None, estimate.end_ns)
    return Entry(estimate, math.nan, cycles, count, flown)


def _later(first: Count | None, second: Count | None, end_ns: int) -> Count | None:
    """Return the later of the counts that were read until the end of a test [ns], or None."""
    read = [count for count in (first, second) if count and count.stamp_ns <= end_ns]
    return max(read, key=lambda count: count.stamp_ns, default=None)
