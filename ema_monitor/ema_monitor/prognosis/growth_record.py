"""The tracker of a unit's growth, fed with the tests whose service hours are known."""

import hashlib
import math
from collections.abc import Sequence
from functools import cache
from io import BytesIO
from itertools import chain, compress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema_core import growth_laws
from ema_core.faults import COMPONENTS, ECCENTRICITY_PHASE
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis import growth
from ema_monitor.prognosis.duty.course import DutyRecord
from ema_monitor.prognosis.duty.damage import DamageSettings
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.outliers import OUTLIER
from ema_monitor.prognosis.growth.settings import TrackerSettings
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.history_entry import Entry
from ema_monitor.prognosis.service import ServiceHours
from ema_monitor.prognosis.unit_event import Finding


class GrowthRecord:
    """Feeds a tracker with tests in the order of their service hours.

    When hours that were used are left out, a new tracker is fed with the others, so that what it
    knows depends on the tests alone.

    Parameters
    ----------
    limits, settings
        Those of the tracker.
    entries
        Tests so far; each further one is in it by the time at which the next is added.
    damage
        How duty does damage.
    kept
        What ``state`` of an earlier record returned; used if it is by the same settings and code,
        and by the first of these tests.

    Attributes
    ----------
    tracker
        What is known of growth.
    service
        Service hours at the tests.
    duty
        Duty between them; None when it is not known, and growth is by hours.
    doubtful
        Components that the latest test shows to be where growth does not explain them.
    kept_tests
        Number of tests that were known from ``kept``.
    phase
        Direction of eccentricity in the latest test, and its variance; NaN when unknown.
    """

    def __init__(
        self,
        limits: HealthLimits,
        settings: TrackerSettings,
        entries: Sequence[Entry] = (),
        kept: bytes = b"",
        damage: DamageSettings | None = None,
    ) -> None:
        self._limits, self._settings, self._entries = limits, settings, entries
        self.service = ServiceHours()
        self._damage = DutyRecord(damage or DamageSettings())
        for entry in entries:
            self.service.add(entry)
            self._damage.add(entry)
        self.duty = self._damage.course(self.service.used)
        self._restart()
        self.kept_tests = 0
        if kept:
            self._restore(kept)
        self._update()

    @property
    def latest_is_used(self) -> bool:
        """Whether the tracker was updated by the latest test."""
        latest = self.service.latest
        return latest is not None and latest.stamp_ns in self._fed_ns[-1:]

    def add(self, entry: Entry) -> list[Finding]:
        """Add the next test; return what it reveals."""
        self._damage.add(entry)
        findings = self.service.add(entry)
        self.duty = self._damage.course(self.service.used)
        return [*findings, *self._update([entry])]

    @property
    def tests(self) -> int:
        """Number of tests that the tracker was updated by."""
        return self._fed_ns.size

    def state(self) -> bytes:
        """Return what is known, for a later record of the same and later tests."""
        arrays = {
            **self.tracker.state(),
            "phase": np.array(self.phase),
            "doubtful": np.array([name in self.doubtful for name in COMPONENTS]),
            "made_by": self._made_by(),
            **self._identity(self.tests, self._own_hours()),
        }
        stream = BytesIO()
        np.savez(stream, **arrays)
        return stream.getvalue()

    def _restore(self, kept: bytes) -> None:
        """Go on from a kept state; without it, or from one of something else, begin anew."""
        try:
            with np.load(BytesIO(kept), allow_pickle=False) as file:
                state = dict(file)
            tests, own = len(state["used_hours"]), self._own_hours()
            expected = {"made_by": self._made_by(), **self._identity(tests, own)}
            if not all(np.array_equal(state[name], value) for name, value in expected.items()):
                return
            self.tracker.restore(state)
            phase, variance = state["phase"]
            self.phase = float(phase), float(variance)
            self.doubtful = frozenset(compress(COMPONENTS, state["doubtful"]))
            self._note_fed(tests, own)
            self.kept_tests = tests
        except Exception:  # of archives, numpy and zipfile raise whatever they come across
            self._restart()

    def _made_by(self) -> NDArray[np.uint8]:
        """Return a digest of settings and code, for other ones know other things."""
        text = repr((self._limits, self._settings)).encode()
        return np.frombuffer(hashlib.sha256(text + _code()).digest(), np.uint8)

    def _restart(self) -> None:
        self.tracker = Tracker(self._limits, self._settings)
        self.phase = (math.nan, math.nan)
        self.doubtful = frozenset[str]()
        # Stamps of the tests that the tracker was updated by, and a digest of all of them.
        self._note_fed(0, self._own_hours())

    def _own_hours(self) -> NDArray[np.float64]:
        """Return the hours of growth of each component at the tests [h], ``(n, 7)``."""
        if self.duty is not None:
            return self.duty.own_hours
        hours = np.array([test.hours for test in self.service.used])
        return np.broadcast_to(hours[:, None], (hours.size, len(COMPONENTS)))

    def _identity(
        self, tests: int, own_hours: NDArray[np.float64]
    ) -> dict[str, NDArray[np.generic]]:
        """Return what identifies the first of the tests that are used."""
        return {
            "used_ns": self._used_ns(tests),
            "used_hours": np.array([test.hours for test in self.service.used[:tests]], np.float64),
            "used_own_hours": own_hours[:tests],
        }

    def _used_ns(self, tests: int) -> NDArray[np.int64]:
        return np.array([test.stamp_ns for test in self.service.used[:tests]], np.int64)

    def _digest(self, tests: int, own_hours: NDArray[np.float64]) -> bytes:
        digest = hashlib.sha256()
        for array in self._identity(tests, own_hours).values():
            digest.update(array.tobytes())
        return digest.digest()

    def _note_fed(self, tests: int, own_hours: NDArray[np.float64]) -> None:
        self._fed_ns = self._used_ns(tests)
        self._fed_digest = self._digest(tests, own_hours)

    def _update(self, latest: Sequence[Entry] = ()) -> list[Finding]:
        """Feed the tracker with what is new; return the events of tests that are new to it."""
        known, own = set[int](), self._own_hours()
        # Once the reference duty is known, the growth before counts by damage, too.
        if self._digest(self.tests, own) != self._fed_digest:
            known.update(self._fed_ns.tolist())
            self._restart()
        new = [self.service.used[place] for place in range(self.tests, len(self.service.used))]
        entries = self._entries_at({test.stamp_ns for test in new}, latest)
        events = [
            event
            for test, hours in zip(new, own[self.tests :], strict=True)
            for event in self._feed(entries[test.stamp_ns], test.hours, hours.copy())
            if test.stamp_ns not in known
        ]
        self._note_fed(len(self.service.used), own)
        if not self.latest_is_used:
            self.doubtful = frozenset()
        return events

    def _entries_at(self, stamps_ns: set[int], latest: Sequence[Entry]) -> dict[int, Entry]:
        """Return the tests of some stamps [ns], which are nearly always the latest.

        Raises
        ------
        ValueError
            When one is not there.
        """
        found: dict[int, Entry] = {}
        for entry in chain(latest, reversed(self._entries)):
            if len(found) == len(stamps_ns):
                break
            if entry.stamp_ns in stamps_ns:
                found.setdefault(entry.stamp_ns, entry)
        if missing := stamps_ns - found.keys():
            raise ValueError(f"the test that ends at {min(missing)} ns is not in the history")
        return found

    def _feed(self, entry: Entry, hours: float, own_hours: NDArray[np.float64]) -> list[Finding]:
        estimate = entry.estimate
        if not estimate.unobservable[ECCENTRICITY_PHASE]:
            self.phase = (
                float(estimate.faults[ECCENTRICITY_PHASE]),
                float(estimate.covariance[ECCENTRICITY_PHASE, ECCENTRICITY_PHASE]),
            )
        events = self.tracker.update(Measurement.of(estimate, hours, own_hours))
        self.doubtful = frozenset(item.component for item in events if item.kind == OUTLIER)
        return [Finding(item.kind, item.text) for item in events]


@cache
def _code() -> bytes:
    """Return a digest of the code that a tracker's state follows from."""
    files = [growth_laws.__file__, *sorted(Path(growth.__path__[0]).glob("*.py"))]
    return hashlib.sha256(b"".join(Path(file).read_bytes() for file in files)).digest()
