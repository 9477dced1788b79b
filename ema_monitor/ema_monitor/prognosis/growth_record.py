# SPDX-License-Identifier: Apache-2.0
"""Growth of a unit's faults, tracked over the tests with known service hours."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from io import BytesIO
from itertools import compress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema_core import growth_laws
from ema_core.arrays import Array
from ema_core.event_kinds import EventKind
from ema_core.faults import COMPONENTS, ECCENTRICITY_PHASE
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis import growth
from ema_monitor.prognosis.duty.damage import DamageSettings
from ema_monitor.prognosis.duty_record import DutyRecord
from ema_monitor.prognosis.events import Occurrence, ValueChanged
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.outliers import PATIENCE
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings
from ema_monitor.prognosis.history_entry import Entry
from ema_monitor.prognosis.service import ServiceHours


class GrowthRecord:
    """Growth of a unit's faults, from its tests in order of service hours.

    If service hours are invalidated later, a new tracker processes all remaining tests, so that its
    state depends only on the tests.

    Parameters
    ----------
    limits, settings
        Limits and settings of the tracker.
    entries
        Tests so far.
    kept
        Result of ``state`` of an earlier record. It is used if settings and code are unchanged and
        it was computed from the first of these tests.
    damage
        Settings that relate damage to duty.

    Attributes
    ----------
    tracker
        Tracker of the growth.
    service
        Service hours at the tests.
    duty
        Duty between the tests; None if unknown, in which case growth is counted in service hours.
    tests
        Number of tests processed by the tracker.
    kept_tests
        Number of tests included in ``kept``.
    doubtful
        Components whose latest value is not explained by growth.
    phase
        Direction of eccentricity in the latest test, and its variance; NaN if unknown.
    """

    def __init__(
        self,
        limits: HealthLimits,
        settings: TrackerSettings,
        entries: Sequence[Entry] = (),
        kept: bytes = b"",
        damage: DamageSettings | None = None,
    ) -> None:
        self._limits, self._settings = limits, settings
        self.service = ServiceHours()
        self._damage = DutyRecord(damage or DamageSettings())
        self._entries: dict[int, Entry] = {}
        for entry in entries:
            self._note(entry)
        self.duty = self._damage.course(self.service.used)
        self._restart()
        if kept:
            self._restore(kept)
        self.kept_tests = self.tests
        self._update()

    @property
    def latest_is_used(self) -> bool:
        """Whether the tracker has processed the latest test."""
        latest, used = self.service.latest, self.service.used
        return latest is not None and bool(used) and used[-1].stamp_ns == latest.stamp_ns

    def add(self, entry: Entry) -> list[Occurrence]:
        """Add the next test. Return events about service hours and growth."""
        occurrences = self._note(entry)
        self.duty = self._damage.course(self.service.used)
        return occurrences + self._update()

    def state(self) -> bytes:
        """Return the serialized state, for the ``kept`` argument of a later record."""
        stamps_ns, hours = self._used()
        stream = BytesIO()
        np.savez(
            stream,
            allow_pickle=False,
            **self.tracker.state(),
            made_by=self._made_by(),
            used_ns=stamps_ns,
            used_hours=hours,
            phase=np.array(self.phase),
            doubtful=np.array([name in self.doubtful for name in COMPONENTS]),
        )
        return stream.getvalue()

    def _note(self, entry: Entry) -> list[Occurrence]:
        self._entries[entry.stamp_ns] = entry
        self._damage.add(entry)
        return self.service.add(entry)

    def _restore(self, kept: bytes) -> None:
        """Restore a stored state if its settings, code and tests match.

        States with a user-defined law are ignored, because its code may have changed.
        """
        if not all(isinstance(law.law, str) for law in self._settings.laws.values()):
            return
        try:
            with np.load(BytesIO(kept), allow_pickle=False) as file:
                state = dict(file)
            fed = state["used_ns"], state["used_hours"]
            if state["made_by"] != self._made_by() or not self._begins_with(fed):
                return
            self.tracker.restore(state)
            phase, variance = state["phase"]
            self.phase = float(phase), float(variance)
            self.doubtful = frozenset(compress(COMPONENTS, state["doubtful"]))
            self._fed, self.tests = fed, len(fed[0])
        except Exception:  # numpy and zipfile raise many types for damaged archives
            self._restart()

    def _made_by(self) -> str:
        """Return a digest of the settings and code on which a state depends."""
        text = repr((self._limits, self._settings)).encode()
        return hashlib.sha256(text + _code()).hexdigest()

    def _restart(self) -> None:
        self.tracker = Tracker(self._limits, self._settings)
        self.phase = (math.nan, math.nan)
        self.doubtful = frozenset[str]()
        self.tests = 0
        # Stamps and hours of the tests processed by the tracker.
        self._fed = np.empty(0, np.int64), np.empty((0, 1 + len(COMPONENTS)))

    def _used(self) -> tuple[NDArray[np.int64], Array]:
        """Return stamps [ns] and hours of service and growth [h] of the used tests."""
        used = self.service.used
        hours = np.array([test.hours for test in used], dtype=np.float64)[:, None]
        growth_hours = (
            hours.repeat(len(COMPONENTS), axis=1) if self.duty is None else self.duty.own_hours
        )
        return np.array([test.stamp_ns for test in used], np.int64), np.hstack(
            [hours, growth_hours]
        )

    def _begins_with(self, fed: tuple[NDArray[np.int64], Array]) -> bool:
        n = len(fed[0])
        pairs = zip(fed, self._used(), strict=True)
        return all(np.array_equal(before, present[:n]) for before, present in pairs)

    def _update(self) -> list[Occurrence]:
        """Process new tests. Return events for values that growth does not explain."""
        reported = set[int]()
        # Once the reference duty is known, earlier tests must be counted by damage as well.
        if not self._begins_with(self._fed):
            reported.update(self._fed[0].tolist())
            self._restart()
        stamps_ns, hours = self._used()
        every = stamps_ns.tolist()
        events = [
            event
            for number, (hour, *growth_hours) in enumerate(hours[self.tests :].tolist(), self.tests)
            for event in self._feed(
                self._entries[every[number]],
                hour,
                np.array(growth_hours),
                [self._entries[ns] for ns in every[max(0, number - PATIENCE) : number]],
            )
            if every[number] not in reported
        ]
        self._fed, self.tests = (stamps_ns, hours), len(stamps_ns)
        if not self.latest_is_used:
            self.doubtful = frozenset()
        return events

    def _feed(
        self, entry: Entry, hours: float, own_hours: Array, before: Sequence[Entry]
    ) -> list[Occurrence]:
        estimate = entry.estimate
        if not estimate.unobservable[ECCENTRICITY_PHASE]:
            self.phase = (
                float(estimate.faults[ECCENTRICITY_PHASE]),
                float(estimate.covariance[ECCENTRICITY_PHASE, ECCENTRICITY_PHASE]),
            )
        events = self.tracker.update(Measurement.of(estimate, hours, own_hours))
        self.doubtful = frozenset(
            item.component for item in events if item.kind is EventKind.OUTLIER
        )
        baselines = {test.estimate.calibration_id for test in (*before, entry)}
        is_new_baseline = len(baselines) > 1
        return [
            replace(item, is_new_baseline=is_new_baseline)
            if isinstance(item, ValueChanged)
            else item
            for item in events
        ]


@cache
def _code() -> bytes:
    """Return a digest of the code on which a tracker's state depends."""
    files = [growth_laws.__file__, *sorted(Path(growth.__path__[0]).rglob("*.py"))]
    return hashlib.sha256(b"".join(Path(file).read_bytes() for file in files)).digest()
