"""Which test showed each fault last, and whether that is recent enough for a level."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from ema_core.faults import COMPONENTS
from ema_monitor.health import HealthLimits, shows
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.history_entry import Entry

RECENT_TESTS: Final = 3
"""Tests for which a fault that one of them has shown is known, where levels do not expire."""


class LastShown:
    """The latest single test that has shown each fault.

    Parameters
    ----------
    limits
        Limits at which life ends: a test shows a fault if it decides whether the limit is reached.
    entries
        Tests so far, in any order.

    Attributes
    ----------
    estimates
        Estimate of the latest such test, by fault; without the faults that no test has shown.
    """

    def __init__(self, limits: HealthLimits, entries: Iterable[Entry] = ()) -> None:
        self._limits = limits
        self.estimates: dict[str, Estimate] = {}
        for entry in entries:
            self.add(entry.estimate)

    def add(self, estimate: Estimate) -> None:
        """Add a test, which may be older than others."""
        for name in COMPONENTS:
            known = self.estimates.get(name)
            is_later = known is None or estimate.end_ns >= known.end_ns
            if is_later and shows(estimate, name, self._limits):
                self.estimates[name] = estimate

    def oldest_ns(self) -> int:
        """Return the stamp since when every fault has been shown [ns]; 0 if one never was."""
        if len(self.estimates) < len(COMPONENTS):
            return 0
        return min(one.end_ns for one in self.estimates.values())


def recent_from_ns(entries: Sequence[Entry], good_for_s: float) -> int:
    """Return from which stamp on tests are recent [ns].

    Parameters
    ----------
    entries
        Valid tests in the order of their stamps, at least one.
    good_for_s
        How long a level holds after its test [s]; 0 where it does not expire: then the latest
        tests are recent.
    """
    if good_for_s:
        return entries[-1].stamp_ns - round(good_for_s * 1e9)
    return entries[-RECENT_TESTS:][0].stamp_ns


def recent_faults(shown: Mapping[str, Estimate], from_ns: int) -> frozenset[str]:
    """Return the faults that a test from a stamp [ns] on has shown."""
    return frozenset(name for name, one in shown.items() if one.end_ns >= from_ns)
