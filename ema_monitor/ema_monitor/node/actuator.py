"""One monitored actuator: its windows, its defects and its health."""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from queue import SimpleQueue

from ema_core.description import ActuatorDescription
from ema_core.levels import LEVEL_NAMES, OK, STALE
from ema_interfaces.msg import Health as HealthMessage
from ema_monitor.diagnosis import Diagnosed, Diagnosis
from ema_monitor.identification.tally import Tally
from ema_monitor.intake import Intake
from ema_monitor.joint.comparison import Comparison
from ema_monitor.node.arrivals import Arrivals
from ema_monitor.node.messages import health_to_message
from ema_monitor.node.receiver_clock import Moment
from ema_monitor.node.settings import Operation
from ema_monitor.prognosis.history_entry import UnitEvent
from ema_monitor.prognosis.outlook import Claim, Outlook, unknown_outlook
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_ros.status import hardware_name

_MOST_NAMED = 5
_SILENT_S = 10.0
_SETTLED = 3
_NOTHING_KNOWN = unknown_outlook("no valid estimate so far")


class Actuator:
    """One actuator that is monitored: its windows, defects and health.

    Parameters
    ----------
    intake
        Takes in what is received of it.
    publish
        Publishes its health.
    steady_ns
        Time by a clock that never goes back [ns].
    namespace
        Namespace of its telemetry.

    Attributes
    ----------
    intake
        Finds the windows in its telemetry, and keeps the use of its units.
    arrivals
        When its telemetry was received.
    latest
        Its latest complete window; None when there was none.
    diagnosis
        Identifies its windows; None before the first one.
    awaiting
        Queues of those who wait for its next windows.
    tally
        What became of the stretches of its motion.
    is_listed, is_silent
        Whether it is followed as it is listed, and whether no telemetry is received any more.
    heard_ns
        When telemetry was received last, or it was added, by the steady clock [ns].
    outlook
        Health and life after the latest valid estimate.
    comparison
        Comparison of the latest record of the mounted unit; None for a modelled drive.
    latency_s
        Age of the latest window's end when its estimate came [s].
    alternation
        Which units are described in turns under its name; empty when there is one.
    """

    def __init__(
        self,
        intake: Intake,
        publish: Callable[[HealthMessage], None],
        steady_ns: int,
        namespace: str = "",
    ) -> None:
        self.actuator_id = intake.actuator_id
        self.intake = intake
        self.arrivals = Arrivals()
        self.latest: Segment | None = None
        self.diagnosis: Diagnosis | None = None
        self.awaiting: list[SimpleQueue[Segment]] = []
        self.tally = Tally()
        self.is_calibrating = False
        self.is_listed = False
        self.alternation = ""
        self._exchanged: list[str] = []
        self._since_exchange = 0
        self._namespace = namespace
        self._publish = publish
        self.heard_ns = self._added_ns = steady_ns
        self.is_silent = False
        # What was wrong, and the number of the first window after it.
        self._open_defects: deque[tuple[int, str]] = deque(maxlen=_MOST_NAMED)
        self.defect_count = 0
        self.valid = 0
        self.invalid = 0
        self.latency_s = float("nan")
        self.reset_health(steady_ns)

    @property
    def finder(self) -> WindowFinder:
        """Finds the windows in its telemetry."""
        return self.intake.finder

    @property
    def description(self) -> ActuatorDescription | None:
        """The latest description of the actuator; None when there was none."""
        return self.finder.description

    @property
    def hardware_id(self) -> str:
        """Namespace, actuator, and serial number once that is known."""
        serial_number = self.description.serial_number if self.description else ""
        return hardware_name(self._namespace, self.actuator_id, serial_number)

    @property
    def defects(self) -> str:
        """What was wrong since the window of the latest valid estimate; empty when nothing was."""
        return "; ".join(reason for _, reason in self._open_defects)

    def good_for_s(self, operation: Operation) -> float:
        """Return how long a level holds after a test [s]; a record may be long."""
        return operation.good_for(self.finder.longest_s if self.finder.finds_records else 0.0)

    @contextmanager
    def next_windows(self) -> Iterator[SimpleQueue[Segment]]:
        """Yield a queue of the windows from now on, and of those that cannot be used."""
        queue: SimpleQueue[Segment] = SimpleQueue()
        self.awaiting.append(queue)
        try:
            yield queue
        finally:
            self.awaiting.remove(queue)

    @contextmanager
    def calibrating(self) -> Iterator[None]:
        """Say in the status that the calibration is being measured; ValueError if it is already."""
        if self.is_calibrating:
            raise ValueError(f"actuator {self.actuator_id!r} is being calibrated already")
        self.is_calibrating = True
        try:
            yield
        finally:
            self.is_calibrating = False

    def exchange(self, old: str, new: str) -> bool:
        """Record that a serial number replaces another; return whether it was there before.

        Actuators are exchanged seldom, and those that are taken out seldom come back: where they
        alternate, two actuators have the same name.
        """
        earlier = [one for one in self._exchanged if one != old]
        self._exchanged = [*earlier, old][-_MOST_NAMED:]
        self._since_exchange = 0
        if new not in self._exchanged:
            return False
        both = ", ".join(sorted({old, new}))
        self.alternation = (
            f"units {both} alternate under this actuator_id: give each actuator its own, or call "
            "~/forget_actuator if the unit was mounted again"
        )
        return True

    def add_defect(self, reason: str, before_window: int | None = None) -> bool:
        """Record a defect; return whether it is the only one at present.

        ``before_window`` is the number of the first window that it does not affect; that of the
        next one when None.
        """
        is_first = not self._open_defects
        number = self.finder.windows if before_window is None else before_window
        self._open_defects.append((number, reason))
        self.defect_count += 1
        return is_first

    def record(self, found: Diagnosed, outlook: Outlook | None, now: Moment) -> str:
        """Record an estimate, and publish the outlook after it, if one follows from it.

        Return the change of the level in words, empty when there is none.
        """
        estimate = found.estimate
        if estimate.valid:
            self.valid += 1
            while self._open_defects and self._open_defects[0][0] <= found.last:
                self._open_defects.popleft()
            self.latency_s = (now.clock_ns - estimate.end_ns) * 1e-9
        else:
            self.invalid += 1
            self.add_defect(f"window {found.number}: {estimate.reason}", found.last + 1)
        if outlook is None:
            return ""
        if not self._is_mounted(found.description):
            # The unit was replaced while its last window waited.
            self._publish(health_to_message(outlook, found.description))
            return ""
        self.comparison = estimate.comparison
        self._since_exchange += 1
        if self._since_exchange >= _SETTLED:
            self.alternation = ""
        return self._show(found.description, outlook, now)

    def _show(self, description: ActuatorDescription, outlook: Outlook, now: Moment) -> str:
        """Publish an outlook; return the change of the level in words, empty when there is none."""
        self._is_withdrawn = False
        before = self.outlook.known_level
        self._assessed, self.outlook = description, self.worth(outlook, now)
        level, change = self.outlook.health.level, ""
        if level not in (STALE, before):
            what = f": {outlook.dominant}" if outlook.dominant else ""
            change = f"health {LEVEL_NAMES[before]} -> {LEVEL_NAMES[level]}{what}"
        self._publish_health()
        return change

    def worth(self, outlook: Outlook, now: Moment) -> Outlook:
        """Return what an outlook is worth: a claim ends by the steady clock, and for good."""
        claim = outlook.claim
        test = claim.measured_ns, claim.received_ns
        if test != self._claimed_test:
            self._claimed_test, self._claimed_at, self._end_of_claim = test, now, ""
            self._doubt = self._doubt_of(claim, now)
        reason = self._end_of_claim or (self._doubt if outlook.health.level == OK else "")
        if reason:
            return outlook.stale(reason) if outlook.health.level != STALE else outlook
        passed_ns = now.steady_ns - self._claimed_at.steady_ns
        worth = outlook.at(max(now.clock_ns, self._claimed_at.clock_ns + passed_ns))
        if worth.health.level == STALE:
            self._end_of_claim = worth.health.reason
        return worth

    def _doubt_of(self, claim: Claim, now: Moment) -> str:
        """Return why it is not known when the newest test was measured; empty if it is known."""
        if not claim.good_for_s or claim.is_live or not now.is_real:
            return ""
        if not (claim.received_ns or now.is_continued):
            return "the monitor was started after the newest test: the next test gives the level"
        if claim.measured_ns <= now.passed_ns:
            return (
                "the newest test may be from before the clock went back: the next test that is "
                "received while it is measured gives the level"
            )
        if claim.is_ahead or (self.arrivals.has_streamed and not claim.is_dated):
            return (
                "the stamp of the newest test does not show when it was measured: send telemetry "
                "while it is measured, or set the clock of the actuator"
            )
        return ""

    def end_claim(self, reason: str) -> HealthMessage | None:
        """End what the tests so far say of the level; return the health if it was published."""
        self._end_of_claim = reason
        is_known = self._assessed is not None and self.outlook.health.level != STALE
        return self.withdraw_health(reason) if is_known else None

    def reset_health(self, steady_ns: int) -> None:
        """Reset the health, as another unit is mounted."""
        self.comparison: Comparison | None = None
        # Newest test of the outlook, when it was first shown, and why it is worth nothing any more.
        self._claimed_test, self._claimed_at = (0, 0), Moment(0, 0)
        self._end_of_claim = self._doubt = ""
        self._added_ns = steady_ns
        self._is_withdrawn = False
        self._assessed: ActuatorDescription | None = None
        self.outlook = _NOTHING_KNOWN

    def resume(self, description: ActuatorDescription, outlook: Outlook, now: Moment) -> str | None:
        """Publish the health after the newest test in the history, unless that was done already.

        It is published again when the requirements have become known. Return the change of the
        level in words, empty when there is none; None when nothing was published.
        """
        if not self._is_mounted(description):
            return None
        before = self.outlook
        is_shown = self._assessed is not None and not self._is_withdrawn
        if is_shown and (
            before.claim.measured_ns != outlook.claim.measured_ns
            or before.health.requirements
            or not outlook.health.requirements
        ):
            return None
        return self._show(description, outlook, now)

    def tell(self, events: tuple[UnitEvent, ...]) -> None:
        """Publish the health as it is, with events, unless none is shown."""
        if self._assessed is not None and not self._is_withdrawn:
            self.outlook = replace(self.outlook, events=(*self.outlook.events, *events))
            self._publish_health()

    def publish_if_stale(self, good_for_s: float, now: Moment) -> HealthMessage | None:
        """Publish the health if it has just become stale; return it if it was published."""
        if not self._added_ns:
            self._added_ns = now.steady_ns  # simulated time has begun
        self.is_silent = self.silent_s(now.steady_ns) > min(_SILENT_S, good_for_s)
        if self._is_withdrawn:
            return None
        if self.outlook is _NOTHING_KNOWN:
            is_due = (now.steady_ns - self._added_ns) * 1e-9 > good_for_s
            reason = f"no valid estimate for more than {good_for_s:g} s"
        else:
            # The expected period may be another by now.
            claim = self.outlook.claim._replace(good_for_s=good_for_s)
            self.outlook = replace(self.outlook, claim=claim)
            worth = self.worth(self.outlook, now)
            is_due, reason = worth is not self.outlook, worth.health.reason
        if not is_due:
            return None
        return self.withdraw_health("; ".join(filter(None, [reason, self.defects])))

    def withdraw_health(self, reason: str) -> HealthMessage | None:
        """Publish that the health is not known any more, and why; return it if it was published."""
        self.outlook = self.outlook.stale(reason)
        self._is_withdrawn = True
        return self._publish_health()

    def silent_s(self, steady_ns: int) -> float:
        """Return how long no telemetry was received [s], at a time of the steady clock [ns]."""
        return (steady_ns - self.heard_ns) * 1e-9

    def _is_mounted(self, description: ActuatorDescription) -> bool:
        """Return whether a unit is the one that was described last."""
        now = self.description
        return now is not None and now.serial_number == description.serial_number

    def _publish_health(self) -> HealthMessage | None:
        """Publish, and return, the health of the unit assessed last, or of the one described."""
        description = self._assessed or self.description
        if description is None:
            return None
        health = health_to_message(self.outlook, description)
        # Each event is published once.
        self.outlook = replace(self.outlook, events=())
        self._publish(health)
        return health
