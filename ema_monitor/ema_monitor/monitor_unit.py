"""What the monitor knows of one actuator, and what it says of it."""

from collections import deque
from dataclasses import replace

from ema_core.description import ActuatorDescription
from ema_core.levels import ERROR, LEVEL_NAMES, OK, STALE, WARN
from ema_interfaces.msg import Health as HealthMessage
from ema_monitor.estimate import Estimate
from ema_monitor.monitor_messages import health_to_message
from ema_monitor.prognosis.outlook import Outlook, unknown_outlook
from ema_monitor.trigger import TriggerSettings
from ema_monitor.watch import Found, Watch
from ema_nodes.status import Task

_STALE_PERIODS = 3.0
_MOST_TOLD = 5
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
        self.watch = Watch(settings)
        self.latest: Found | None = None
        # What was wrong, and the number of the first window after it.
        self._open_defects: deque[tuple[int, str]] = deque(maxlen=_MOST_TOLD)
        self._defects = 0
        self._valid = 0
        self._invalid = 0
        self._latency_s = float("nan")
        self._fresh_ns = now_ns
        self._judged: ActuatorDescription | None = None
        self._outlook = _NOTHING_KNOWN
        self._stale_told = False

    @property
    def hardware_id(self) -> str:
        """Serial number, or the actuator's name as long as that is not known."""
        return self.watch.description.serial_number if self.watch.description else self.actuator_id

    @property
    def defects(self) -> str:
        """What was wrong since the window of the latest valid estimate; empty when nothing was."""
        return "; ".join(reason for _, reason in self._open_defects)

    def complain(self, reason: str, before_window: int | None = None) -> bool:
        """Take note of something wrong; return whether nothing was before.

        Parameters
        ----------
        reason
            What is wrong.
        before_window
            Number of the first window that it does not touch; that of the next one when None.
        """
        is_news = not self._open_defects
        number = self.watch.windows if before_window is None else before_window
        self._open_defects.append((number, reason))
        self._defects += 1
        return is_news

    def conclude(
        self, found: Found, estimate: Estimate, outlook: Outlook | None, now_ns: int
    ) -> HealthMessage | None:
        """Take note of an estimate and return the health to publish, if it tells of any.

        Parameters
        ----------
        found
            The window.
        estimate
            What was found in it.
        outlook
            What there is to say after it; None when it is not valid.
        now_ns
            Time of the node's clock [ns].
        """
        if outlook is None:
            self._invalid += 1
            self.complain(f"window {found.number}: {estimate.reason}", found.number + 1)
            return None
        self._valid += 1
        while self._open_defects and self._open_defects[0][0] <= found.number:
            self._open_defects.popleft()
        self._latency_s = (now_ns - estimate.end_ns) * 1e-9
        if not self._is_fitted(found.description):
            # The unit was exchanged while its last window waited.
            return health_to_message(outlook, found.description)
        self._fresh_ns = now_ns
        self._stale_told = False
        self._judged = found.description
        self._outlook = outlook
        return self._health_message()

    def exchange(self, now_ns: int) -> None:
        """Forget the health: another unit is in the place of the one before.

        Parameters
        ----------
        now_ns
            Time of the node's clock [ns].
        """
        self._fresh_ns = now_ns
        self._stale_told = False
        self._judged = None
        self._outlook = _NOTHING_KNOWN

    def resume(
        self,
        description: ActuatorDescription,
        outlook: Outlook,
        expected_period_s: float,
        now_ns: int,
    ) -> HealthMessage | None:
        """Return the health after the latest test in the history, unless it is published already.

        It is published again when it has come to tell of requirements.

        Parameters
        ----------
        description
            The unit that the history is of.
        outlook
            What there is to say after that test.
        expected_period_s
            How often a valid estimate is expected [s].
        now_ns
            Time of the node's clock [ns].
        """
        if not self._is_fitted(description):
            return None
        if self._judged is None:
            self._fresh_ns = outlook.stamp_ns
        elif not _adds_requirements(self._outlook, outlook):
            return None
        self._judged, self._outlook = description, outlook
        self._stale_told = self._is_stale(expected_period_s, now_ns)
        if self._stale_told:
            self._say_stale(expected_period_s)
        return self._health_message()

    def grow_stale(self, expected_period_s: float, now_ns: int) -> HealthMessage | None:
        """Return the health to publish when it has just become stale.

        Parameters
        ----------
        expected_period_s
            How often a valid estimate is expected [s].
        now_ns
            Time of the node's clock [ns].
        """
        if self._stale_told or not self._is_stale(expected_period_s, now_ns):
            return None
        self._stale_told = True
        self._say_stale(expected_period_s)
        self._outlook = replace(self._outlook, events=())
        return self._health_message()

    def tasks(self, waiting: int) -> list[Task]:
        """Return how telemetry and health of the actuator fare.

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
            "defects": self._defects,
            "windows": watch.windows,
            "windows waiting": waiting,
            "estimates valid": self._valid,
            "estimates invalid": self._invalid,
            "latency [s]": self._latency_s,
        }
        verdict = LEVEL_NAMES[health.level]
        if self._outlook.dominant:
            verdict += f": {self._outlook.dominant}"
        if health.reason:
            verdict += f" ({health.reason})"
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
            Task(f"{self.actuator_id} health", health.level, verdict, self.hardware_id, figures),
        ]

    def _is_fitted(self, description: ActuatorDescription) -> bool:
        """Return whether a unit is the one that is described now."""
        now = self.watch.description
        return now is not None and now.serial_number == description.serial_number

    def _is_stale(self, expected_period_s: float, now_ns: int) -> bool:
        if not self._fresh_ns or now_ns < self._fresh_ns:
            self._fresh_ns = now_ns  # simulated time has begun, or gone back
        return (now_ns - self._fresh_ns) * 1e-9 > _STALE_PERIODS * expected_period_s

    def _say_stale(self, expected_period_s: float) -> None:
        reason = f"no valid estimate for more than {_STALE_PERIODS * expected_period_s:g} s"
        if self._open_defects:
            reason += f"; {self.defects}"
        health = replace(self._outlook.health, level=STALE, confidence=0.0, reason=reason)
        self._outlook = replace(self._outlook, health=health)

    def _health_message(self) -> HealthMessage | None:
        """Return the health of the unit that was judged last, or else of the one described."""
        description = self._judged or self.watch.description
        return None if description is None else health_to_message(self._outlook, description)


def _adds_requirements(before: Outlook, after: Outlook) -> bool:
    """Return whether an outlook after the same test tells of requirements for the first time."""
    is_same = before.stamp_ns == after.stamp_ns
    return is_same and bool(after.health.requirements) and not before.health.requirements
