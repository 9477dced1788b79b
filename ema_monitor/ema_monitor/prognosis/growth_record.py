"""The tracker of a unit's growth, fed with the tests whose service hours are known."""

import hashlib
import math
from collections.abc import Iterable, Sequence
from functools import cache
from io import BytesIO
from itertools import compress
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
from ema_monitor.prognosis.service import ServiceHours, TimedTest


class GrowthRecord:
    """Feeds a tracker with tests in the order of their service hours.

    When hours that were used are left out, a new tracker is fed with the others, so that what it
    knows depends on the tests alone.

    Parameters
    ----------
    limits, settings
        Those of the tracker.
    entries
        Tests so far.
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
        entries: Iterable[Entry] = (),
        kept: bytes = b"",
        damage: DamageSettings | None = None,
    ) -> None:
        self._limits, self._settings = limits, settings
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
        return bool(self._fed) and self._fed[-1].entry is self.service.latest

    def add(self, entry: Entry) -> list[str]:
        """Add the next test; return its events, in words."""
        self._damage.add(entry)
        events = self.service.add(entry)
        self.duty = self._damage.course(self.service.used)
        return [*events, *self._update()]

    @property
    def tests(self) -> int:
        """Number of tests that the tracker was updated by."""
        return len(self._fed)

    def state(self) -> bytes:
        """Return what is known, for a later record of the same and later tests."""
        arrays = {
            **self.tracker.state(),
            "phase": np.array(self.phase),
            "doubtful": np.array([name in self.doubtful for name in COMPONENTS]),
            "made_by": self._made_by(),
            **_identity(self._fed, self._fed_hours),
        }
        stream = BytesIO()
        np.savez(stream, **arrays)
        return stream.getvalue()

    def _restore(self, kept: bytes) -> None:
        """Go on from a kept state; without it, or from one of something else, begin anew."""
        try:
            with np.load(BytesIO(kept), allow_pickle=False) as file:
                state = dict(file)
            used = self.service.used[: len(state["used_hours"])]
            own = self._own_hours()[: len(used)]
            expected = {"made_by": self._made_by(), **_identity(used, own)}
            if not all(np.array_equal(state[name], value) for name, value in expected.items()):
                return
            self.tracker.restore(state)
            phase, variance = state["phase"]
            self.phase = float(phase), float(variance)
            self.doubtful = frozenset(compress(COMPONENTS, state["doubtful"]))
            self._fed, self._fed_hours, self.kept_tests = used, own, len(used)
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
        self._fed: list[TimedTest] = []
        self._fed_hours = self._own_hours()[:0]

    def _own_hours(self) -> NDArray[np.float64]:
        """Return the hours of growth of each component at the tests [h], ``(n, 7)``."""
        if self.duty is not None:
            return self.duty.own_hours
        hours = np.array([test.hours for test in self.service.used])
        return np.tile(hours[:, None], len(COMPONENTS))

    def _update(self) -> list[str]:
        """Feed the tracker with what is new; return the events of tests that are new to it."""
        used, own = self.service.used, self._own_hours()
        known = {test.entry.stamp_ns for test in self._fed}
        fed = len(self._fed)
        # Once the reference duty is known, the growth before counts by damage, too.
        if used[:fed] != self._fed or not np.array_equal(own[:fed], self._fed_hours):
            self._restart()
        fed = len(self._fed)
        events = [
            event
            for test, hours in zip(used[fed:], own[fed:], strict=True)
            for event in self._feed(test, hours)
            if test.entry.stamp_ns not in known
        ]
        self._fed, self._fed_hours = list(used), own
        if not self.latest_is_used:
            self.doubtful = frozenset()
        return events

    def _feed(self, test: TimedTest, own_hours: NDArray[np.float64]) -> list[str]:
        estimate = test.entry.estimate
        if not estimate.unobservable[ECCENTRICITY_PHASE]:
            self.phase = (
                float(estimate.faults[ECCENTRICITY_PHASE]),
                float(estimate.covariance[ECCENTRICITY_PHASE, ECCENTRICITY_PHASE]),
            )
        events = self.tracker.update(Measurement.of(estimate, test.hours, own_hours))
        self.doubtful = frozenset(item.component for item in events if item.kind == OUTLIER)
        return [f"{item.kind}: {item.text}" for item in events]


def _identity(
    tests: Sequence[TimedTest], own_hours: NDArray[np.float64]
) -> dict[str, NDArray[np.generic]]:
    return {
        "used_ns": np.array([test.entry.stamp_ns for test in tests], dtype=np.int64),
        "used_hours": np.array([test.hours for test in tests], dtype=np.float64),
        "used_own_hours": own_hours,
    }


@cache
def _code() -> bytes:
    """Return a digest of the code that a tracker's state follows from."""
    files = [growth_laws.__file__, *sorted(Path(growth.__path__[0]).glob("*.py"))]
    return hashlib.sha256(b"".join(Path(file).read_bytes() for file in files)).digest()
