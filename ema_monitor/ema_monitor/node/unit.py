"""One monitored actuator: its windows, its defects and its health."""

from collections import deque
from collections.abc import Callable
from dataclasses import replace

from ema_core.description import ActuatorDescription
from ema_core.levels import ERROR, LEVEL_NAMES, OK, STALE, WARN
from ema_interfaces.msg import Health as HealthMessage
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.tally import Tally
from ema_monitor.node.messages import health_to_message
from ema_monitor.prognosis.outlook import Outlook, unknown_outlook
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_ros.status import Task

_STALE_PERIODS = 3.0
_MOST_NAMED = 5
_NOTHING_KNOWN = unknown_outlook("no valid estimate so far")


class Unit:
    """One actuator that is monitored.

    Parameters
    ----------
    actuator_id
        Name of the actuator.
    settings
        When a window begins and how long it is.
    publish
        Publishes its health.
    now_ns
        Time of the node's clock [ns].

    Attributes
    ----------
    finder
        Finds the windows in its telemetry.
    latest
        Its latest complete window; None when there was none.
    tally
        What became of the stretches of its motion.
    """

    def __init__(
        self,
        actuator_id: str,
        settings: TriggerSettings,
        publish: Callable[[HealthMessage], None],
        now_ns: int,
    ) -> None:
        self.actuator_id = actuator_id
        self.finder = WindowFinder(settings)
        self.latest: Segment | None = None
        self.tally = Tally()
        self._publish = publish
        # What was wrong, and the number of the first window after it.
        self._open_defects: deque[tuple[int, str]] = deque(maxlen=_MOST_NAMED)
        self._defect_count = 0
        self._valid = 0
        self._invalid = 0
        self._latency_s = float("nan")
        self.reset_health(now_ns)

    @property
    def description(self) -> ActuatorDescription | None:
        """The latest description of the actuator; None when there was none."""
        return self.finder.description

    @property
    def hardware_id(self) -> str:
        """Serial number, or the actuator's name as long as that is not known."""
        return self.description.serial_number if self.description else self.actuator_id

    @property
    def _defects(self) -> str:
        """What was wrong since the window of the latest valid estimate; empty when nothing was."""
        return "; ".join(reason for _, reason in self._open_defects)

    def add_defect(self, reason: str, before_window: int | None = None) -> bool:
        """Record a defect; return whether it is the only one at present.

        ``before_window`` is the number of the first window that it does not affect; that of the
        next one when None.
        """
        is_first = not self._open_defects
        number = self.finder.windows if before_window is None else before_window
        self._open_defects.append((number, reason))
        self._defect_count += 1
        return is_first

    def record(
        self, segment: Segment, estimate: Estimate, outlook: Outlook | None, now_ns: int
    ) -> None:
        """Record an estimate, and publish the outlook after it; None when it is not valid."""
        last = segment.number if segment.last_stretch is None else segment.last_stretch
        if outlook is None:
            self._invalid += 1
            self.add_defect(f"window {segment.number}: {estimate.reason}", last + 1)
            return
        self._valid += 1
        while self._open_defects and self._open_defects[0][0] <= last:
            self._open_defects.popleft()
        self._latency_s = (now_ns - estimate.end_ns) * 1e-9
        if not self._is_mounted(segment.description):
            # The unit was replaced while its last window waited.
            self._publish(health_to_message(outlook, segment.description))
            return
        self._fresh_ns = now_ns
        self._stale_published = False
        self._assessed, self._outlook = segment.description, outlook
        self._publish_health()

    def reset_health(self, now_ns: int) -> None:
        """Reset the health, as another unit is mounted."""
        self._fresh_ns = now_ns
        self._stale_published = False
        self._assessed: ActuatorDescription | None = None
        self._outlook = _NOTHING_KNOWN

    def resume(
        self,
        description: ActuatorDescription,
        outlook: Outlook,
        expected_period_s: float,
        now_ns: int,
    ) -> bool:
        """Publish the health after the latest test in the history, unless that was done already.

        It is published again when the requirements have become known. ``expected_period_s`` is the
        expected time between valid estimates [s]. Return whether it was published.
        """
        if not self._is_mounted(description):
            return False
        before = self._outlook
        if self._assessed is None:
            self._fresh_ns = outlook.stamp_ns
        elif (
            before.stamp_ns != outlook.stamp_ns
            or before.health.requirements
            or not outlook.health.requirements
        ):
            return False
        self._assessed, self._outlook = description, outlook
        self._stale_published = False
        if self.publish_if_stale(expected_period_s, now_ns) is None:
            self._publish_health()
        return True

    def publish_if_stale(self, expected_period_s: float, now_ns: int) -> HealthMessage | None:
        """Publish the health if it has just become stale; return it if it was published."""
        if not self._fresh_ns or now_ns < self._fresh_ns:
            self._fresh_ns = now_ns  # simulated time has begun, or gone back
        limit_s = _STALE_PERIODS * expected_period_s
        if self._stale_published or (now_ns - self._fresh_ns) * 1e-9 <= limit_s:
            return None
        reason = f"no valid estimate for more than {limit_s:g} s"
        if self._open_defects:
            reason += f"; {self._defects}"
        health = replace(self._outlook.health, level=STALE, confidence=0.0, reason=reason)
        self._outlook = replace(self._outlook, health=health)
        self._stale_published = True
        return self._publish_health()

    def tasks(self, waiting: int, dropped: int = 0) -> list[Task]:
        """Return the status of telemetry and health.

        ``waiting`` windows of all actuators wait, and ``dropped`` ones of this one had to give way.
        """
        finder, health, life = self.finder, self._outlook.health, self._outlook.rul
        if self.description is None:
            level, message = ERROR, "no description of the actuator: the telemetry has to wait"
            message += f"; {self._defects}" if self._open_defects else ""
        elif self._open_defects:
            level, message = WARN, self._defects
        elif not finder.blocks:
            level, message = WARN, "no telemetry so far"
        elif self.tally.reason:
            level, message = WARN, str(self.tally)
        else:
            level, message = OK, f"{self._valid} valid estimates"
        counts = {
            "blocks": finder.blocks,
            "samples lost": finder.lost_samples,
            "defects": self._defect_count,
            "windows": finder.windows,
            "windows waiting": waiting,
            "windows dropped": dropped,
            "estimates valid": self._valid,
            "estimates invalid": self._invalid,
            "latency [s]": self._latency_s,
        }
        if self.tally.stretches or finder.passed_over:
            counts |= {
                "stretches combined": self.tally.combined,
                "stretches without news": self.tally.skipped,
                "stretches refused": self.tally.refused,
                "stretches dropped": self.tally.dropped,
                "stretches with too little travel": finder.passed_over,
                "combinations without estimate": self.tally.fruitless,
            }
        summary = LEVEL_NAMES[health.level]
        if self._outlook.dominant:
            summary += f": {self._outlook.dominant}"
        if health.reason:
            summary += f" ({health.reason})"
        figures = {
            "health index": health.health_index,
            "confidence": health.confidence,
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

    def _is_mounted(self, description: ActuatorDescription) -> bool:
        """Return whether a unit is the one that was described last."""
        now = self.description
        return now is not None and now.serial_number == description.serial_number

    def _publish_health(self) -> HealthMessage | None:
        """Publish, and return, the health of the unit assessed last, or of the one described."""
        description = self._assessed or self.description
        if description is None:
            return None
        health = health_to_message(self._outlook, description)
        # Each event is published once.
        self._outlook = replace(self._outlook, events=())
        self._publish(health)
        return health
