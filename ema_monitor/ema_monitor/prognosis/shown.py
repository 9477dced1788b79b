# SPDX-License-Identifier: Apache-2.0
"""Tracking of the latest test that showed each fault."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from ema_core.faults import COMPONENTS
from ema_monitor.health import HealthLimits, shows
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.history_entry import Entry

RECENT_TESTS: Final = 3
"""Number of latest tests that count as recent if levels do not expire."""


class LastShown:
    """Latest test that showed each fault.

    Parameters
    ----------
    limits
        Limits at which life ends. A test shows a fault if it determines whether the fault has
        reached its limit.
    entries
        Tests so far, in any order.

    Attributes
    ----------
    estimates
        Estimate of the latest test that has shown each fault, by fault name; faults that no test
        has shown are missing.
    """

    def __init__(self, limits: HealthLimits, entries: Iterable[Entry] = ()) -> None:
        self._limits = limits
        self.estimates: dict[str, Estimate] = {}
        for entry in entries:
            self.add(entry.estimate)

    def add(self, estimate: Estimate) -> None:
        """Add a test, which may be older than tests already added."""
        for name in COMPONENTS:
            latest = self.estimates.get(name)
            is_later = latest is None or estimate.end_ns >= latest.end_ns
            if is_later and shows(estimate, name, self._limits):
                self.estimates[name] = estimate

    def oldest_ns(self) -> int:
        """Return the stamp since which tests have shown every fault [ns]; 0 if they have not."""
        if len(self.estimates) < len(COMPONENTS):
            return 0
        return min(estimate.end_ns for estimate in self.estimates.values())


def recent_from_ns(entries: Sequence[Entry], good_for_s: float) -> int:
    """Return the stamp from which on tests are recent [ns].

    Parameters
    ----------
    entries
        Valid tests in the order of their stamps, at least one.
    good_for_s
        Validity of a level after its test [s]; 0 if it does not expire: then the latest
        ``RECENT_TESTS`` tests are recent.
    """
    if good_for_s:
        return entries[-1].stamp_ns - round(good_for_s * 1e9)
    return entries[-RECENT_TESTS:][0].stamp_ns


def recent_faults(shown: Mapping[str, Estimate], from_ns: int) -> frozenset[str]:
    """Return the faults that a test at or after a stamp [ns] has shown."""
    return frozenset(name for name, estimate in shown.items() if estimate.end_ns >= from_ns)
