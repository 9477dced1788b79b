"""The actuators that a monitor watches: windows, defects, health of each."""

import threading
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from ema_core.description import ActuatorDescription
from ema_core.levels import ERROR, LEVEL_NAMES, OK, STALE, WARN
from ema_core.wording import counted
from ema_interfaces.msg import Health as HealthMessage
from ema_interfaces.msg import TelemetryBlock
from ema_monitor.identification.estimate import Estimate
from ema_monitor.node.messages import health_to_message
from ema_monitor.prognosis.outlook import Outlook, unknown_outlook
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import Defect, TriggerSettings
from ema_monitor.windows.window import Window
from ema_ros.stamps import stamp_from_message
from ema_ros.status import Task
from ema_ros.telemetry import telemetry_from_message

_STALE_PERIODS = 3.0
_MOST_NAMED = 5
_NOTHING_KNOWN = unknown_outlook("no valid estimate so far")


class Unit:
    """One actuator that the monitor watches.

    Parameters
    ----------
    actuator_id
        Which actuator.
    settings
        When a window begins and how long it is.
    now_ns
        Time of the node's clock [ns].

    Attributes
    ----------
    watch
        Cuts its telemetry into windows.
    latest
        Its latest complete window; None when there was none.
    """

    def __init__(self, actuator_id: str, settings: TriggerSettings, now_ns: int) -> None:
        self.actuator_id = actuator_id
        self.watch = WindowFinder(settings)
        self.latest: Segment | None = None
        # What was wrong, and the number of the first window after it.
        self._open_defects: deque[tuple[int, str]] = deque(maxlen=_MOST_NAMED)
        self._defect_count = 0
        self._valid = 0
        self._invalid = 0
        self._latency_s = float("nan")
        self._fresh_ns = now_ns
        self._assessed: ActuatorDescription | None = None
        self._outlook = _NOTHING_KNOWN
        self._stale_published = False

    @property
    def hardware_id(self) -> str:
        """Serial number, or the actuator's name as long as that is not known."""
        return self.watch.description.serial_number if self.watch.description else self.actuator_id

    @property
    def defects(self) -> str:
        """What was wrong since the window of the latest valid estimate; empty when nothing was."""
        return "; ".join(reason for _, reason in self._open_defects)

    def note_defect(self, reason: str, before_window: int | None = None) -> bool:
        """Record a defect; return whether it is the only one at present.

        Parameters
        ----------
        reason
            What is wrong.
        before_window
            Number of the first window that it does not affect; that of the next one when None.
        """
        is_news = not self._open_defects
        number = self.watch.windows if before_window is None else before_window
        self._open_defects.append((number, reason))
        self._defect_count += 1
        return is_news

    def record(
        self, found: Segment, estimate: Estimate, outlook: Outlook | None, now_ns: int
    ) -> HealthMessage | None:
        """Record an estimate and return the health to publish; None when it is not valid.

        Parameters
        ----------
        found
            The window.
        estimate
            What was found in it.
        outlook
            Health and remaining life after it; None when it is not valid.
        now_ns
            Time of the node's clock [ns].
        """
        if outlook is None:
            self._invalid += 1
            self.note_defect(f"window {found.number}: {estimate.reason}", found.number + 1)
            return None
        self._valid += 1
        while self._open_defects and self._open_defects[0][0] <= found.number:
            self._open_defects.popleft()
        self._latency_s = (now_ns - estimate.end_ns) * 1e-9
        if not self._is_fitted(found.description):
            # The unit was replaced while its last window waited.
            return health_to_message(outlook, found.description)
        self._fresh_ns = now_ns
        self._stale_published = False
        self._assessed = found.description
        self._outlook = outlook
        return self._health_message()

    def reset_health(self, now_ns: int) -> None:
        """Forget the health: another unit has been fitted.

        Parameters
        ----------
        now_ns
            Time of the node's clock [ns].
        """
        self._fresh_ns = now_ns
        self._stale_published = False
        self._assessed = None
        self._outlook = _NOTHING_KNOWN

    def resume(
        self,
        description: ActuatorDescription,
        outlook: Outlook,
        expected_period_s: float,
        now_ns: int,
    ) -> HealthMessage | None:
        """Return the health after the latest test in the history, unless it is published already.

        It is published again when the requirements have become known.

        Parameters
        ----------
        description
            The unit that the history is of.
        outlook
            Health and remaining life after that test.
        expected_period_s
            How often a valid estimate is expected [s].
        now_ns
            Time of the node's clock [ns].
        """
        if not self._is_fitted(description):
            return None
        if self._assessed is None:
            self._fresh_ns = outlook.stamp_ns
        elif not _adds_requirements(self._outlook, outlook):
            return None
        self._assessed, self._outlook = description, outlook
        self._stale_published = self._is_stale(expected_period_s, now_ns)
        if self._stale_published:
            self._set_stale(expected_period_s)
        return self._health_message()

    def become_stale(self, expected_period_s: float, now_ns: int) -> HealthMessage | None:
        """Return the health to publish when it has just become stale.

        Parameters
        ----------
        expected_period_s
            How often a valid estimate is expected [s].
        now_ns
            Time of the node's clock [ns].
        """
        if self._stale_published or not self._is_stale(expected_period_s, now_ns):
            return None
        self._stale_published = True
        self._set_stale(expected_period_s)
        self._outlook = replace(self._outlook, events=())
        return self._health_message()

    def tasks(self, waiting: int) -> list[Task]:
        """Return the status of telemetry and health of the actuator.

        Parameters
        ----------
        waiting
            Windows of all actuators that wait for identification.
        """
        watch, health, life = self.watch, self._outlook.health, self._outlook.rul
        if watch.description is None:
            level, message = ERROR, "no description of the actuator: the telemetry has to wait"
            message += f"; {self.defects}" if self._open_defects else ""
        elif self._open_defects:
            level, message = WARN, self.defects
        elif not watch.blocks:
            level, message = WARN, "no telemetry so far"
        else:
            level, message = OK, f"{self._valid} valid estimates"
        counts = {
            "blocks": watch.blocks,
            "samples lost": watch.lost_samples,
            "defects": self._defect_count,
            "windows": watch.windows,
            "windows waiting": waiting,
            "estimates valid": self._valid,
            "estimates invalid": self._invalid,
            "latency [s]": self._latency_s,
        }
        summary = LEVEL_NAMES[health.level]
        if self._outlook.dominant:
            summary += f": {self._outlook.dominant}"
        if health.reason:
            summary += f" ({health.reason})"
        figures = {"health index": health.health_index, "confidence": health.confidence}
        figures |= {
            "flight hours [h]": self._outlook.hours,
            "remaining life 5 % [h]": life.hours_05,
            "remaining life 50 % [h]": life.hours_50,
            "remaining life 95 % [h]": life.hours_95,
        }
        figures |= {item.name: item.value for item in (*health.faults, *health.requirements)}
        return [
            Task(f"{self.actuator_id} telemetry", level, message, self.hardware_id, counts),
            Task(f"{self.actuator_id} health", health.level, summary, self.hardware_id, figures),
        ]

    def _is_fitted(self, description: ActuatorDescription) -> bool:
        """Return whether a unit is the one that is described now."""
        now = self.watch.description
        return now is not None and now.serial_number == description.serial_number

    def _is_stale(self, expected_period_s: float, now_ns: int) -> bool:
        if not self._fresh_ns or now_ns < self._fresh_ns:
            self._fresh_ns = now_ns  # simulated time has begun, or gone back
        return (now_ns - self._fresh_ns) * 1e-9 > _STALE_PERIODS * expected_period_s

    def _set_stale(self, expected_period_s: float) -> None:
        reason = f"no valid estimate for more than {_STALE_PERIODS * expected_period_s:g} s"
        if self._open_defects:
            reason += f"; {self.defects}"
        health = replace(self._outlook.health, level=STALE, confidence=0.0, reason=reason)
        self._outlook = replace(self._outlook, health=health)

    def _health_message(self) -> HealthMessage | None:
        """Return the health of the unit assessed last, or else of the one described."""
        description = self._assessed or self.watch.description
        return None if description is None else health_to_message(self._outlook, description)


@dataclass(frozen=True)
class UnitsCallbacks:
    """What the units need of their node.

    Attributes
    ----------
    now_ns
        Gives the time of the node's clock [ns].
    trigger_settings
        Gives when a window begins and how long it is.
    expected_period_s
        Gives how often a valid estimate is expected [s].
    add_unit
        Called with the name of an actuator at its first message.
    queue_window
        Called with each window found, or its refusal.
    warn
        Called with what is wrong, in words, and whether the status has to be published at once.
    publish
        Publishes health.
    """

    now_ns: Callable[[], int]
    trigger_settings: Callable[[], TriggerSettings]
    expected_period_s: Callable[[], float]
    add_unit: Callable[[str], None]
    queue_window: Callable[[Segment], None]
    warn: Callable[[str, bool], None]
    publish: Callable[[HealthMessage], None]


class Units(dict[str, Unit]):
    """Units by ``actuator_id``, in the order of their first message.

    Parameters
    ----------
    callbacks
        What they need of their node.

    Attributes
    ----------
    lock
        Held while units are changed, and while health is published: nothing older may follow the
        health after a test.
    unmatched
        Messages that belong to none of them.
    """

    def __init__(self, callbacks: UnitsCallbacks) -> None:
        super().__init__()
        self.lock = threading.RLock()
        self.unmatched = UnmatchedMessages()
        self._node = callbacks

    def clear(self) -> None:
        """Forget all."""
        super().clear()
        self.unmatched = UnmatchedMessages()

    def describe(self, description: ActuatorDescription) -> bool:
        """Take over the description of an actuator; return whether it is another than before.

        Parameters
        ----------
        description
            The actuator.
        """
        with self.lock:
            unit = self._get_or_add(description.actuator_id)
            before = unit.watch.description
            self._handle(unit, unit.watch.describe(description))
            if before is not None and before.serial_number != description.serial_number:
                unit.reset_health(self._node.now_ns())
        return before != description

    def feed(self, message: TelemetryBlock) -> None:
        """Look for windows in the next block of an actuator.

        Parameters
        ----------
        message
            The block; it may be impossible.
        """
        if not message.actuator_id:
            self.note_defect("", "telemetry without actuator_id")
            return
        with self.lock:
            unit = self._get_or_add(message.actuator_id)
            try:
                block = telemetry_from_message(message)
            except ValueError as error:
                stamp_ns = stamp_from_message(message.header.stamp)
                self._handle(unit, unit.watch.reject(stamp_ns, str(error)))
            else:
                self._handle(unit, unit.watch.feed(block))

    def restart(self, settings: TriggerSettings) -> None:
        """Look for windows by other settings from now on.

        Parameters
        ----------
        settings
            When a window begins and how long it is.
        """
        with self.lock:
            for unit in self.values():
                reason = "the settings of the window changed"
                self._handle(unit, unit.watch.restart(settings, reason))

    def finish(self) -> list[Segment]:
        """End the telemetry of all; return the refusals of the windows that are cut off."""
        with self.lock:
            events = [event for unit in self.values() for event in unit.watch.finish()]
        return [event for event in events if isinstance(event, Segment)]

    def note_defect(self, actuator_id: str, reason: str, *, is_watched: bool = True) -> None:
        """Record and report a defect.

        Parameters
        ----------
        actuator_id
            Of which actuator; empty when the message does not name one.
        reason
            What is wrong.
        is_watched
            Whether the defect makes the actuator known.
        """
        with self.lock:
            if actuator_id and is_watched:
                is_news = self._get_or_add(actuator_id).note_defect(reason)
            else:
                is_news = self.unmatched.add(actuator_id, reason)
        self._node.warn(f"{actuator_id or 'input'}: {reason}", is_news)

    def find(self, actuator_id: str) -> Unit:
        """Return one that is described.

        Parameters
        ----------
        actuator_id
            Which; empty for the only one.

        Raises
        ------
        ValueError
            When it is not watched, not described, or there is a choice.
        """
        with self.lock:
            watched = ", ".join(self) or "none"
            if not actuator_id and len(self) != 1:
                raise ValueError(f"actuator_id is empty: expected one of those watched: {watched}")
            unit = self.get(actuator_id) if actuator_id else next(iter(self.values()))
        if unit is None:
            raise ValueError(f"actuator_id = {actuator_id!r} is not watched; watched: {watched}")
        if unit.watch.description is None:
            raise ValueError(f"actuator {unit.actuator_id!r} has not been described")
        return unit

    def record(
        self, found: Segment, estimate: Estimate, outlook: Outlook | None, now_ns: int
    ) -> None:
        """Publish the health after a test.

        Parameters
        ----------
        found, estimate, outlook, now_ns
            As of ``Unit.record``.
        """
        with self.lock:
            unit = self[found.description.actuator_id]
            self._publish_if_any(unit.record(found, estimate, outlook, now_ns))

    def resume(self, description: ActuatorDescription, outlook: Outlook) -> None:
        """Publish the health of a unit as its history has it, until its next test.

        Parameters
        ----------
        description, outlook
            As of ``Unit.resume``.
        """
        with self.lock:
            if unit := self.get(description.actuator_id):
                period_s, now_ns = self._node.expected_period_s(), self._node.now_ns()
                self._publish_if_any(unit.resume(description, outlook, period_s, now_ns))

    def publish_stale(self) -> list[HealthMessage]:
        """Publish, and return, the health of the units whose health has just become stale."""
        with self.lock:
            period_s, now_ns = self._node.expected_period_s(), self._node.now_ns()
            healths = [unit.become_stale(period_s, now_ns) for unit in self.values()]
            stale = [health for health in healths if health is not None]
            for health in stale:
                self._node.publish(health)
        return stale

    def tasks(self, waiting: int) -> list[Task]:
        """Return the status of each.

        Parameters
        ----------
        waiting
            Windows of all actuators that wait for identification.
        """
        with self.lock:
            return [task for unit in self.values() for task in unit.tasks(waiting)]

    def input_status(self) -> tuple[int, str]:
        """Return level and words on what is received of all."""
        with self.lock:
            remarks = [] if self else ["no message of an actuator so far"]
            remarks += self.unmatched.remarks()
        return (
            (WARN, "; ".join(remarks))
            if remarks
            else (OK, f"{counted(len(self), 'actuator')} monitored")
        )

    def _get_or_add(self, actuator_id: str) -> Unit:
        if actuator_id not in self:
            settings, now_ns = self._node.trigger_settings(), self._node.now_ns()
            self[actuator_id] = Unit(actuator_id, settings, now_ns)
            self._node.add_unit(actuator_id)
        return self[actuator_id]

    def _handle(self, unit: Unit, events: Iterable[Segment | Defect]) -> None:
        """Queue windows for identification, and report defects."""
        for event in events:
            if isinstance(event, Defect):
                self.note_defect(unit.actuator_id, event.reason)
                continue
            if isinstance(event.window, Window):
                unit.latest = event
            self._node.queue_window(event)

    def _publish_if_any(self, health: HealthMessage | None) -> None:
        if health is not None:
            self._node.publish(health)


class UnmatchedMessages:
    """Counts wrong messages that belong to no actuator watched: without name, or of another."""

    def __init__(self) -> None:
        self._unnamed = 0
        self._unknown = 0
        self._latest = ""

    def add(self, actuator_id: str, reason: str) -> bool:
        """Count a message; return whether it is the first of its kind.

        Parameters
        ----------
        actuator_id
            Which actuator it names; empty for none.
        reason
            What is wrong with it.
        """
        if not actuator_id:
            self._unnamed += 1
            return self._unnamed == 1
        self._unknown += 1
        self._latest = f"{actuator_id!r}: {reason}"
        return self._unknown == 1

    def remarks(self) -> list[str]:
        """Return in words which messages were ignored."""
        remarks = []
        if self._unnamed:
            remarks.append(f"ignored {counted(self._unnamed, 'message')} without actuator_id")
        if self._unknown:
            remarks.append(
                f"{self._unknown} wrong messages of actuators that are not watched were ignored, "
                f"the latest of {self._latest}"
            )
        return remarks


def _adds_requirements(before: Outlook, after: Outlook) -> bool:
    """Return whether an outlook after the same test is the first that knows the requirements."""
    is_same = before.stamp_ns == after.stamp_ns
    return is_same and bool(after.health.requirements) and not before.health.requirements
