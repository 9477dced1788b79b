"""One monitored actuator: its windows, its defects and its health."""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from ema_core.description import ActuatorDescription
from ema_core.levels import ERROR, LEVEL_NAMES, OK, STALE, WARN
from ema_core.quantity import is_finite_number
from ema_interfaces.msg import Health as HealthMessage
from ema_monitor.health import FaultHealth
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.tally import Tally
from ema_monitor.node.level_filter import LevelFilter
from ema_monitor.node.messages import health_to_message
from ema_monitor.prognosis.outlook import Outlook, unknown_outlook
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_ros.status import (
    CHECK_FUNCTION,
    DIAGNOSTICS_ACTIVE,
    FAILURE,
    MAINTENANCE_REQUIRED,
    NORMAL,
    OFF_SPEC,
    Task,
    hardware_name,
)

_STALE_PERIODS = 3.0
_MOST_NAMED = 5
_BACK_WITHIN = 20
_BACK_TIMES = 3
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
    namespace
        Namespace of the node, for the status.

    Attributes
    ----------
    finder
        Finds the windows in its telemetry.
    latest
        Its latest complete window; None when there was none.
    tally
        What became of the stretches of its motion.
    settings
        Those in effect for the window that is open, or the next one.
    next_trigger
        Settings of its windows from the next one on; None when they do not change.
    is_calibrating
        Whether its calibration is being measured.
    publishers
        Nodes that publish its telemetry at the same time; empty when there is one.
    """

    def __init__(
        self,
        actuator_id: str,
        settings: TriggerSettings,
        publish: Callable[[HealthMessage], None],
        now_ns: int,
        namespace: str = "",
    ) -> None:
        self.actuator_id = actuator_id
        self.finder = WindowFinder(settings)
        self.latest: Segment | None = None
        self.tally = Tally()
        self.settings: Any = None
        self.next_trigger: TriggerSettings | None = None
        self.is_calibrating = False
        self.publishers = ""
        self._namespace = namespace
        self._publish = publish
        self._went_back: deque[int] = deque(maxlen=_BACK_TIMES)
        self._heard_ns = now_ns
        self._is_silent = False
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
        """Namespace, actuator, and serial number once that is known."""
        serial_number = self.description.serial_number if self.description else ""
        return hardware_name(self._namespace, self.actuator_id, serial_number)

    @property
    def level(self) -> int | None:
        """Level of its health as confirmed; None as long as nothing is known."""
        return self._level.level

    @property
    def _defects(self) -> str:
        """What was wrong since the window of the latest valid estimate; empty when nothing was."""
        return "; ".join(reason for _, reason in self._open_defects)

    def hear(self, now_ns: int) -> None:
        """Record that telemetry is received."""
        self._heard_ns, self._is_silent = now_ns, False

    @contextmanager
    def calibrating(self) -> Iterator[None]:
        """Say in the status that the calibration is being measured."""
        self.is_calibrating = True
        try:
            yield
        finally:
            self.is_calibrating = False

    def goes_back_and_forth(self) -> bool:
        """Record that the running index went back; return whether it does so again and again."""
        self._went_back.append(self.finder.blocks)
        span = self._went_back[-1] - self._went_back[0]
        return len(self._went_back) == _BACK_TIMES and span <= _BACK_WITHIN

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
        self,
        segment: Segment,
        estimate: Estimate,
        outlook: Outlook | None,
        now_ns: int,
        confirmations: int = 1,
    ) -> str:
        """Record an estimate, and publish the outlook after it; None when it is not valid.

        Parameters
        ----------
        segment, estimate, outlook
            Window, estimate and what follows from it.
        now_ns
            Time of the node's clock [ns].
        confirmations
            How many estimates in a row change a level in the status.

        Returns
        -------
        str
            The change of the level in words; empty when there is none.
        """
        last = segment.number if segment.last_stretch is None else segment.last_stretch
        if outlook is None:
            self._invalid += 1
            self.add_defect(f"window {segment.number}: {estimate.reason}", last + 1)
            return ""
        self._valid += 1
        while self._open_defects and self._open_defects[0][0] <= last:
            self._open_defects.popleft()
        self._latency_s = (now_ns - estimate.end_ns) * 1e-9
        if not self._is_mounted(segment.description):
            # The unit was replaced while its last window waited.
            self._publish(health_to_message(outlook, segment.description))
            return ""
        self._fresh_ns = now_ns
        self._stale_published = False
        self._assessed, self._outlook = segment.description, outlook
        self.publishers = ""
        change = self._filter_levels(confirmations)
        self._publish_health()
        return change

    def _filter_levels(self, confirmations: int) -> str:
        """Add the levels of an estimate; return the change of that of health, in words."""
        health, before = self._outlook.health, self._level.level
        for item in (*health.faults, *health.requirements):
            if item.level != STALE:
                self._levels.setdefault(item.name, LevelFilter()).add(item.level, confirmations)
        if health.level == STALE or not self._level.add(health.level, confirmations):
            return ""
        what = f": {self._outlook.dominant}" if self._outlook.dominant else ""
        known = STALE if before is None else before
        return f"health {LEVEL_NAMES[known]} -> {LEVEL_NAMES[health.level]}{what}"

    def _filter_new_levels(self) -> str:
        """Take the levels that were unknown so far; return the change of that of health."""
        if self._level.level is None:
            return self._filter_levels(1)
        health = self._outlook.health
        for item in (*health.faults, *health.requirements):
            if item.level != STALE and item.name not in self._levels:
                self._levels[item.name] = LevelFilter()
                self._levels[item.name].add(item.level, 1)
        return ""

    def reset_health(self, now_ns: int) -> None:
        """Reset the health, as another unit is mounted."""
        self._level = LevelFilter()
        self._levels: dict[str, LevelFilter] = {}
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
    ) -> str | None:
        """Publish the health after the latest test in the history, unless that was done already.

        It is published again when the requirements have become known. ``expected_period_s`` is the
        expected time between valid estimates [s]. Return the change of the level in words, empty
        when there is none; None when nothing was published.
        """
        if not self._is_mounted(description):
            return None
        before = self._outlook
        if self._assessed is None:
            self._fresh_ns = outlook.stamp_ns
        elif (
            before.stamp_ns != outlook.stamp_ns
            or before.health.requirements
            or not outlook.health.requirements
        ):
            return None
        self._assessed, self._outlook = description, outlook
        # The same test again confirms nothing; only what was unknown is known now.
        change = self._filter_new_levels()
        self._stale_published = False
        if self.publish_if_stale(expected_period_s, now_ns) is None:
            self._publish_health()
        return change

    def publish_if_stale(self, expected_period_s: float, now_ns: int) -> HealthMessage | None:
        """Publish the health if it has just become stale; return it if it was published."""
        if not self._fresh_ns or now_ns < self._fresh_ns:
            self._fresh_ns = now_ns  # simulated time has begun, or gone back
        limit_s = _STALE_PERIODS * expected_period_s
        self._is_silent = (now_ns - self._heard_ns) * 1e-9 > limit_s
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
        """Return the status of telemetry and health, and of each fault.

        ``waiting`` windows of all actuators wait, and ``dropped`` ones of this one had to give way.
        """
        health, life = self._outlook.health, self._outlook.rul
        figures = {
            "health index": health.health_index,
            "confidence": health.confidence,
            "flight hours [h]": self._outlook.hours,
            "remaining life 5 % [h]": life.hours_05,
            "remaining life 50 % [h]": life.hours_50,
            "remaining life 95 % [h]": life.hours_95,
        }
        figures |= {item.name: item.value for item in (*health.faults, *health.requirements)}
        level = OK if self._level.level is None else self._level.level
        summary = LEVEL_NAMES[level] if self._level.level is not None else "unknown"
        if self._outlook.dominant:
            summary += f": {self._outlook.dominant}"
        if health.reason:
            summary += f" ({health.reason})"
        items = [(item, OFF_SPEC) for item in health.requirements]
        items += [(item, FAILURE) for item in health.faults]
        worst = [end for item, end in items if self._level_of(item) == ERROR]
        return [
            self._telemetry_task(waiting, dropped),
            Task(
                f"{self.actuator_id} health",
                level,
                summary,
                self.hardware_id,
                figures,
                _category(level, worst[-1] if worst else FAILURE, self._level.level is None),
            ),
            *(self._item_task(item, end) for item, end in items),
        ]

    def _telemetry_task(self, waiting: int, dropped: int) -> Task:
        finder, category = self.finder, ""
        if self._is_silent and finder.blocks:
            level, message = STALE, "no telemetry any more"
        elif self.description is None:
            level, message = ERROR, "no description of the actuator: the telemetry has to wait"
            message += f"; {self._defects}" if self._open_defects else ""
            category = CHECK_FUNCTION
        elif self.publishers:
            level = WARN
            message = f"telemetry of this actuator has several publishers: {self.publishers}"
            message += f"; {self._defects}" if self._open_defects else ""
        elif self._open_defects:
            level, message = WARN, self._defects
        elif not finder.blocks:
            level, message = WARN, "no telemetry so far"
        elif self.tally.reason:
            level, message = WARN, str(self.tally)
        elif finder.obstacle:
            level, message = WARN, f"no window can be complete: {finder.obstacle}"
        else:
            level, message = OK, f"{self._valid} valid estimates"
        if self.is_calibrating:
            category = DIAGNOSTICS_ACTIVE
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
        name = f"{self.actuator_id} telemetry"
        return Task(name, level, message, self.hardware_id, counts, category)

    def _level_of(self, item: FaultHealth) -> int:
        """Return the confirmed level of a fault or requirement; OK as long as it is not known."""
        level = self._levels[item.name].level if item.name in self._levels else None
        return OK if level is None else level

    def _item_task(self, item: FaultHealth, end: str) -> Task:
        level, is_known = self._level_of(item), is_finite_number(item.value)
        message = f"{item.value:.4g}, limit {item.limit:.4g}" if is_known else "not known"
        name = f"{self.actuator_id} {item.name.replace('_', ' ')}"
        figures = {"value": item.value, "sigma": item.sigma, "limit": item.limit}
        category = _category(level, end, not is_known)
        return Task(name, level, message, self.hardware_id, figures, category)

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
        self._outlook = replace(self._outlook, events=(), happened=())
        self._publish(health)
        return health


def _category(level: int, end: str, is_unknown: bool) -> str:
    """Return the category of NAMUR NE 107 of a level, ``end`` that of ERROR."""
    if is_unknown:
        return CHECK_FUNCTION
    return {OK: NORMAL, WARN: MAINTENANCE_REQUIRED}.get(level, end)
