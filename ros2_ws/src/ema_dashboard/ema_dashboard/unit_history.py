# SPDX-License-Identifier: Apache-2.0
"""Unit histories: fetched from monitors and continued from published messages."""

import math
import threading
import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, Final

from builtin_interfaces.msg import Time
from rclpy.client import Client
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message

from ema_core.event_kinds import MOST_COUNT, EventKind
from ema_core.faults import FAULT_NAMES
from ema_core.levels import STALE
from ema_core.wording import counted
from ema_dashboard.hub import Hub
from ema_dashboard.known_topics import UNIT_HISTORY
from ema_interfaces.msg import FaultEstimate, Health, UnitEvent, UnitHistory, UnitTest
from ema_interfaces.srv import GetHistory
from ema_ros.stamps import stamp_from_message

MOST_TESTS: Final = 2000
"""Maximum number of tests shown per actuator."""

MOST_EVENTS: Final = 500

_MOST_TEXT: Final = 1000
_PATIENCE_S: Final = 5.0
_SERVICE_TYPE: Final = "ema_interfaces/srv/GetHistory"


class ActuatorHistory:
    """Test history of an actuator's unit. ``serialised`` is thread-safe.

    Attributes
    ----------
    serial_number
        Serial number of the installed unit.
    """

    def __init__(self, actuator_id: str, serial_number: str) -> None:
        self.serial_number = serial_number
        self._actuator_id = actuator_id
        self._lock = threading.Lock()
        # Serialised tests by stamp: messages would take four times the memory.
        self._tests: dict[int, bytes] = {}
        self._events: dict[tuple[int, str, str], UnitEvent] = {}
        self._omitted = 0
        self._latest: FaultEstimate | None = None  # with any verdict
        self._estimate: FaultEstimate | None = None  # the health is still missing
        self._health: Health | None = None
        self._news = self._empty(is_addition=True)

    def set_base(self, history: UnitHistory) -> None:
        """Set the history fetched from the monitor; later tests remain."""
        base = {stamp_from_message(test.stamp): serialize_message(test) for test in history.tests}
        latest = max(base, default=-1)
        events = {_identity(event): event for event in history.events}
        with self._lock:
            later = {stamp: test for stamp, test in self._tests.items() if stamp > latest}
            lost = 0 if history.omitted else len(self._tests.keys() - later.keys() - base.keys())
            self._tests = base | later
            merged = self._events | events
            self._events = dict(sorted(merged.items(), key=lambda item: item[0][0]))
            self._omitted = history.omitted
            self._trim()
        if lost:
            text = f"the monitor started a new history, without {counted(lost, 'earlier test')}"
            self._happened(next(iter(history.tests)).stamp, EventKind.HISTORY, text, lost)

    def note_estimate(self, estimate: FaultEstimate) -> bool:
        """Add an estimate. Return whether the monitor has restarted since the previous estimate.

        A restart and an unusable calibration are recorded as events.
        """
        before, self._latest = self._latest, estimate
        has_restarted = before is not None and estimate.window < before.window
        if before is not None and has_restarted:
            since_ns = stamp_from_message(before.header.stamp)
            if not any(
                at >= since_ns and kind == EventKind.RESTART for at, kind, _ in self._events
            ):
                self._happened(
                    estimate.header.stamp, EventKind.RESTART, "the monitor was restarted"
                )
        is_repeated = (
            before is not None
            and before.lacks_calibration
            and before.reason_codes == estimate.reason_codes
        )
        # The progress of learning is not an event.
        is_learning = "learning" in estimate.reason_codes
        if estimate.lacks_calibration and not is_repeated and not is_learning:
            self._happened(estimate.header.stamp, EventKind.CALIBRATION, estimate.reason)
        if estimate.valid:
            self._estimate = estimate
            self._join()
        return has_restarted

    def note_health(self, health: Health) -> None:
        """Add the health that follows an estimate; together they form a test."""
        self._health = health
        self._join()
        test = self._tests.get(stamp_from_message(health.header.stamp))
        # A STALE health of an overdue test has less information than the health after the test.
        if test is not None and health.level != STALE:
            self._add_test(deserialize_message(test, UnitTest), health)
        self._add_events(health.events)

    def note_gap(self, stamp: Time, samples: int) -> None:
        """Add an event about missing samples of telemetry."""
        text = f"{counted(samples, 'sample')} of telemetry missing"
        self._happened(stamp, EventKind.GAP, text, samples)

    def rewind(self, time_ns: int) -> None:
        """Discard entries later than a time [ns]."""
        with self._lock:
            self._tests = {key: test for key, test in self._tests.items() if key <= time_ns}
            self._events = {key: item for key, item in self._events.items() if key[0] <= time_ns}
        self._estimate = self._health = self._latest = None

    def news(self) -> UnitHistory | None:
        """Return the additions since the last call; None if there are none."""
        additions, self._news = self._news, self._empty(is_addition=True)
        return additions if additions.tests or additions.events else None

    def message(self) -> UnitHistory:
        """Return the history as a message."""
        with self._lock:
            tests, events = list(self._tests.values()), list(self._events.values())
        message = self._empty(is_addition=False)
        message.tests = [deserialize_message(test, UnitTest) for test in tests]
        message.events, message.omitted = events, self._omitted
        if tests:
            message.header.stamp = message.tests[-1].stamp
        return message

    def serialised(self) -> bytes:
        """Return the history as a serialised message."""
        return serialize_message(self.message())

    def _empty(self, *, is_addition: bool) -> UnitHistory:
        return UnitHistory(
            actuator_id=self._actuator_id, serial_number=self.serial_number, is_addition=is_addition
        )

    def _happened(self, stamp: Time, kind: EventKind, text: str, count: int = 0) -> None:
        """Add an event that is not reported by any message."""
        event = UnitEvent(stamp=stamp, kind=kind.value, text=text[:_MOST_TEXT])
        event.count = min(count, MOST_COUNT)
        event.flight_hours = self._health.flight_hours if self._health else math.nan
        self._add_events([event])

    def _add_events(self, events: Iterable[UnitEvent]) -> None:
        new = {key: event for event in events if (key := _identity(event)) not in self._events}
        with self._lock:
            self._events |= new
            self._trim()
        self._news.events = [*self._news.events, *new.values()]

    def _join(self) -> None:
        """Combine the latest estimate and its health into a test, in either order of arrival."""
        estimate, health = self._estimate, self._health
        if estimate and health and estimate.header.stamp == health.header.stamp:
            self._add_test(_test_of(estimate), health)
            self._estimate = None

    def _add_test(self, test: UnitTest, health: Health) -> None:
        test.flight_hours, test.cycles = health.flight_hours, health.cycles
        test.level, test.health_index = health.level, health.health_index
        test.dominant_fault = health.dominant_fault
        test.rul_known, test.rul_05 = health.rul.known, health.rul.hours_05
        test.rul_50, test.rul_95 = health.rul.hours_50, health.rul.hours_95
        with self._lock:
            self._tests[stamp_from_message(test.stamp)] = serialize_message(test)
            self._trim()
        self._news.tests = [*self._news.tests, test]

    def _trim(self) -> None:
        self._omitted += _drop_oldest(self._tests, MOST_TESTS)
        _drop_oldest(self._events, MOST_EVENTS)


class NamespaceHistories:
    """Histories of the units of one namespace, on the topic ``unit_history`` of the hub.

    The history of a unit is requested from each monitor when the unit or the monitor appears, the
    monitor restarts or the unit is replaced; clients then receive the whole history. In between,
    published messages continue the history.

    Parameters
    ----------
    node
        Node for the service clients.
    namespace
        Namespace of the monitors.
    hub
        Hub that receives the histories.
    time_ns
        Function that returns the ROS time [ns].
    """

    def __init__(self, node: Node, namespace: str, hub: Hub, time_ns: Callable[[], int]) -> None:
        self._node = node
        self._prefix = namespace.rstrip("/") + "/"
        self._topic = self._prefix + UNIT_HISTORY
        self._hub = hub
        self._time_ns = time_ns
        self._lock = threading.RLock()  # answers arrive in separate threads
        self._monitors: dict[str, Client] = {}
        # Time of the request to a monitor for a unit [s]; infinite after the answer.
        self._asked: dict[tuple[str, str], float] = {}
        self._histories: dict[str, ActuatorHistory] = {}
        self._lost: dict[str, int] = {}  # samples, by actuator

    def note(self, message: Any) -> None:
        """Update the history of a unit with a description, an estimate or a health."""
        actuator_id = message.actuator_id
        with self._lock:
            history = self._histories.get(actuator_id)
            if history is None or history.serial_number != message.serial_number:
                history = ActuatorHistory(actuator_id, message.serial_number)
                self._histories[actuator_id] = history
                self._forget_asked(actuator_id)
            if isinstance(message, FaultEstimate) and history.note_estimate(message):
                self._forget_asked(actuator_id)
            elif isinstance(message, Health):
                history.note_health(message)
            self._offer(actuator_id, history)

    def note_lost_samples(self, actuator_id: str, stamp: Time, samples: int) -> None:
        """Update an actuator's count of lost samples since its monitor started.

        If the count has grown since the previous one, an event is added to the history.
        """
        with self._lock:
            before, self._lost[actuator_id] = self._lost.get(actuator_id), samples
            history = self._histories.get(actuator_id)
            # The time of the first losses is unknown.
            if before is not None and samples > before and history is not None:
                history.note_gap(stamp, samples - before)
                self._offer(actuator_id, history)

    def rewind(self, time_ns: int) -> None:
        """Discard entries later than ``time_ns``, to which the ROS time has jumped back."""
        with self._lock:
            for actuator_id, history in self._histories.items():
                history.rewind(time_ns)
                self._offer(actuator_id, history, as_a_whole=True)

    def update(self) -> None:
        """Discover monitors and request histories. Call periodically."""
        for name, types in self._node.get_service_names_and_types():
            is_new = _SERVICE_TYPE in types and name not in self._monitors
            if is_new and name.startswith(self._prefix):
                self._monitors[name] = self._node.create_client(GetHistory, name)
        now_s = time.monotonic()
        with self._lock:
            for name, client in self._monitors.items():
                is_ready = client.service_is_ready()
                for actuator_id in self._histories:
                    key = name, actuator_id
                    if not is_ready:
                        self._asked.pop(key, None)
                    elif key not in self._asked or now_s - self._asked[key] > _PATIENCE_S:
                        self._ask(key, client, now_s)

    def _forget_asked(self, actuator_id: str) -> None:
        self._asked = {key: at_s for key, at_s in self._asked.items() if key[1] != actuator_id}

    def _ask(self, key: tuple[str, str], client: Client, now_s: float) -> None:
        self._asked[key] = now_s
        request = GetHistory.Request(actuator_id=key[1], most=MOST_TESTS)
        client.call_async(request).add_done_callback(partial(self._take, key, now_s))

    def _take(self, key: tuple[str, str], asked_s: float, future: Any) -> None:
        """Process a monitor's response; it has no history if the unit is unknown to the monitor."""
        response: Any = future.result()
        with self._lock:
            # An answer to an outdated request is ignored.
            if response is None or self._asked.get(key) != asked_s:
                return
            self._asked[key] = math.inf
            present, stored = self._histories.get(key[1]), response.history
            if present and response.success and stored.serial_number == present.serial_number:
                present.set_base(stored)
                self._offer(key[1], present, as_a_whole=True)

    def _offer(
        self, actuator_id: str, history: ActuatorHistory, *, as_a_whole: bool = False
    ) -> None:
        """Keep a history for later clients, and send additions to connected clients."""
        log_time_ns, news = self._time_ns(), history.news()
        self._hub.keep(self._topic, actuator_id, history.serialised, log_time_ns)
        if not self._hub.has_clients(self._topic):
            return
        if as_a_whole:
            self._hub.publish(self._topic, history.serialised(), log_time_ns)
        elif news is not None:
            self._hub.publish(self._topic, serialize_message(news), log_time_ns)


def _drop_oldest(items: dict[Any, Any], most: int) -> int:
    surplus = max(0, len(items) - most)
    for key in list(items)[:surplus]:
        del items[key]
    return surplus


def _test_of(estimate: FaultEstimate) -> UnitTest:
    """Return a test with the values of an estimate; the health is not set."""
    size = len(FAULT_NAMES)
    covariance: Any = estimate.covariance
    variances = [covariance[index * (size + 1)] for index in range(size)]
    sigmas = [math.sqrt(value) if value >= 0.0 else math.nan for value in variances]
    values = [getattr(estimate.faults, name) for name in FAULT_NAMES]
    for index in range(size):
        if estimate.unobservable >> index & 1:
            values[index] = sigmas[index] = math.nan
    return UnitTest(
        stamp=estimate.header.stamp,
        verdict=estimate.verdict,
        faults=values,
        sigmas=sigmas,
        insignificant=estimate.insignificant,
    )


def _identity(event: UnitEvent) -> tuple[int, str, str]:
    return stamp_from_message(event.stamp), event.kind, event.text
