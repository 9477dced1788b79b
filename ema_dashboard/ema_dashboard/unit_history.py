"""Histories of units for the page: from the monitor, then carried on with what is published."""

import math
import threading
from collections.abc import Iterable
from typing import Any, Final

from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message

from ema_core.faults import FAULT_NAMES
from ema_core.levels import STALE
from ema_core.wording import counted
from ema_interfaces.msg import FaultEstimate, Health, UnitEvent, UnitHistory, UnitTest
from ema_ros.stamps import stamp_from_message

MOST_TESTS: Final = 2000
"""Number of the latest tests of an actuator that are shown."""

MOST_EVENTS: Final = 500

_MOST_TEXT: Final = 1000


class ActuatorHistory:
    """What is known of the tests of one actuator's unit.

    Attributes
    ----------
    serial_number
        Serial number of the installed unit.
    """

    def __init__(self, actuator_id: str, serial_number: str) -> None:
        self.serial_number = serial_number
        self._actuator_id = actuator_id
        self._lock = threading.Lock()
        # Serialised, by stamp: as messages they take four times the memory.
        self._tests: dict[int, bytes] = {}
        self._events: dict[tuple[int, str, str], UnitEvent] = {}
        self._omitted = 0
        self._latest: FaultEstimate | None = None  # whatever its verdict
        self._estimate: FaultEstimate | None = None
        self._health: Health | None = None
        self._serialised: bytes | None = None

    def set_base(self, history: UnitHistory) -> None:
        """Take the history of the monitor; tests that came after it was asked stay."""
        with self._lock:
            base = {
                stamp_from_message(test.stamp): serialize_message(test) for test in history.tests
            }
            latest = max(base, default=-1)
            later = {stamp: test for stamp, test in self._tests.items() if stamp > latest}
            self._tests = {**base, **later}
            known = {_identity(item): item for item in history.events}
            every = {**self._events, **known}
            self._events = dict(sorted(every.items(), key=lambda item: item[0][0]))
            self._omitted = history.omitted
            self._trim()

    def note_estimate(self, estimate: FaultEstimate) -> tuple[bool, list[UnitEvent]]:
        """Take an estimate.

        Returns
        -------
        bool
            Whether the monitor has begun anew since the one before.
        list of UnitEvent
            What it shows beside a test: such a restart, and a calibration that cannot be used.
        """
        before, self._latest = self._latest, estimate
        began_anew = False
        found = []
        with self._lock:
            if before is not None and estimate.window < before.window:
                began_anew = True
                if not self._tells_of_restart(stamp_from_message(before.header.stamp)):
                    found.append(("restart", "the monitor was started again"))
            is_told = before is not None and before.reason == estimate.reason
            is_refused = estimate.verdict == FaultEstimate.REFUSED
            if is_refused and "calibration" in estimate.reason and not is_told:
                found.append(("calibration", estimate.reason))
            if estimate.valid:
                self._estimate = estimate
                self._join()
        return began_anew, self._add(estimate.header.stamp, found)

    def note_gap(self, stamp: Time, samples: int) -> list[UnitEvent]:
        """Take that so many samples of telemetry are missing; return the event."""
        return self._add(stamp, [("gap", f"{counted(samples, 'sample')} of telemetry missing")])

    def addition(self, events: list[UnitEvent]) -> UnitHistory:
        """Return new events as a message, for who has the history before them."""
        return UnitHistory(
            actuator_id=self._actuator_id,
            serial_number=self.serial_number,
            is_addition=True,
            events=events,
        )

    def note_health(self, health: Health) -> None:
        """Take the health after an estimate: both together are a test."""
        with self._lock:
            self._health = health
            self._join()
            stamp = stamp_from_message(health.header.stamp)
            known = self._tests.get(stamp)
            # Overdue or computed anew: the health after the test is the one that says more.
            if known is not None and health.level != STALE:
                self._tests[stamp] = _with_health(deserialize_message(known, UnitTest), health)
            for event in health.events:
                self._events[_identity(event)] = event
            self._trim()

    def rewind(self, time_ns: int) -> None:
        """Forget what is later than a time [ns]."""
        with self._lock:
            self._tests = {key: test for key, test in self._tests.items() if key <= time_ns}
            self._events = {key: item for key, item in self._events.items() if key[0] <= time_ns}
            self._estimate = self._health = self._latest = None
            self._serialised = None

    def serialised(self) -> bytes:
        """Return the history as a message, serialised; any thread may ask."""
        with self._lock:
            if self._serialised is None:
                self._serialised = serialize_message(self._message())
            return self._serialised

    def message(self) -> UnitHistory:
        """Return the history as a message."""
        with self._lock:
            return self._message()

    def _tells_of_restart(self, since_ns: int) -> bool:
        return any(stamp >= since_ns and kind == "restart" for stamp, kind, _ in self._events)

    def _add(self, stamp: Time, found: Iterable[tuple[str, str]]) -> list[UnitEvent]:
        """Keep events that nobody else tells of, by kind and text; return those that are new."""
        with self._lock:
            hours = self._health.flight_hours if self._health else math.nan
            events = [
                UnitEvent(stamp=stamp, flight_hours=hours, kind=kind, text=text[:_MOST_TEXT])
                for kind, text in found
            ]
            new = [event for event in events if _identity(event) not in self._events]
            self._events |= {_identity(event): event for event in new}
            self._trim()
        return new

    def _join(self) -> None:
        """Make a test of the latest estimate and its health, whichever came first."""
        estimate, health = self._estimate, self._health
        if estimate and health and estimate.header.stamp == health.header.stamp:
            stamp = stamp_from_message(health.header.stamp)
            self._tests[stamp] = _with_health(_test_of(estimate), health)
            self._estimate = None
            self._trim()

    def _message(self) -> UnitHistory:
        tests = [deserialize_message(test, UnitTest) for test in self._tests.values()]
        message = UnitHistory(
            actuator_id=self._actuator_id,
            serial_number=self.serial_number,
            tests=tests,
            events=list(self._events.values()),
            omitted=self._omitted,
        )
        if tests:
            message.header.stamp = tests[-1].stamp
        return message

    def _trim(self) -> None:
        self._omitted += _drop_oldest(self._tests, MOST_TESTS)
        _drop_oldest(self._events, MOST_EVENTS)
        self._serialised = None


def _drop_oldest(items: dict[Any, Any], most: int) -> int:
    surplus = max(0, len(items) - most)
    for key in list(items)[:surplus]:
        del items[key]
    return surplus


def _test_of(estimate: FaultEstimate) -> UnitTest:
    """Return an estimate as a test, its health unknown."""
    size = len(FAULT_NAMES)
    covariance: Any = estimate.covariance
    variances = [covariance[index * (size + 1)] for index in range(size)]
    seen = [not estimate.unobservable >> index & 1 for index in range(size)]
    values = (getattr(estimate.faults, name) for name in FAULT_NAMES)
    return UnitTest(
        stamp=estimate.header.stamp,
        verdict=estimate.verdict,
        faults=_where(seen, values),
        sigmas=_where(
            seen, (math.sqrt(value) if value >= 0.0 else math.nan for value in variances)
        ),
        insignificant=estimate.insignificant,
        level=STALE,
        health_index=math.nan,
        flight_hours=math.nan,
        rul_05=math.nan,
        rul_50=math.nan,
        rul_95=math.nan,
    )


def _where(seen: Iterable[bool], values: Iterable[float]) -> list[float]:
    return [value if is_seen else math.nan for is_seen, value in zip(seen, values, strict=True)]


def _with_health(test: UnitTest, health: Health) -> bytes:
    """Return a test with its health, serialised."""
    test.flight_hours = health.flight_hours
    test.cycles = health.cycles
    test.level = health.level
    test.health_index = health.health_index
    test.dominant_fault = health.dominant_fault
    test.rul_known = health.rul.known
    test.rul_05 = health.rul.hours_05
    test.rul_50 = health.rul.hours_50
    test.rul_95 = health.rul.hours_95
    return serialize_message(test)


def _identity(event: UnitEvent) -> tuple[int, str, str]:
    return stamp_from_message(event.stamp), event.kind, event.text
