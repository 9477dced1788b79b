# SPDX-License-Identifier: Apache-2.0
"""Status of one monitored actuator: defects, counts and published health."""

from collections import deque
from collections.abc import Callable, Collection
from typing import Final

from ema_core.description import ActuatorDescription
from ema_core.sample_runs import SampleRuns, several_publishers
from ema_interfaces.msg import Health as HealthMessage
from ema_monitor.diagnosis import Diagnosed
from ema_monitor.identification.tally import Tally
from ema_monitor.node.moment import Moment
from ema_monitor.node.publish.shown_health import ShownHealth, Stream
from ema_monitor.node.settings import Operation
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.windows.finder import WindowFinder
from ema_ros.status import hardware_name

_MOST_NAMED: Final = 5
_SILENT_S: Final = 10.0
_SETTLED: Final = 3


class ActuatorStatus:
    """Status, counts and published health of one actuator.

    Parameters
    ----------
    actuator_id
        Name of the actuator.
    finder
        Finds the windows in its telemetry.
    publish
        Publishes its health.
    steady_ns
        Current monotonic time [ns].
    stream
        Reception state of its telemetry.
    namespace
        Namespace of its telemetry.

    Attributes
    ----------
    finder
        Finds the windows in its telemetry.
    health
        Its published health.
    tally
        Counts of motion stretches by result.
    is_listed, is_silent
        Whether the parameter ``actuators`` lists it, and whether its telemetry has stopped.
    received_ns
        Steady time of its latest telemetry [ns]; before the first telemetry, the steady time at
        which it was added.
    latency_s
        Time from the end of a window to its estimate, for the latest valid estimate [s]; NaN
        before.
    alternation
        Warning that several units use the name in turn; empty for a single unit.
    runs
        Runs of consecutive samples in its telemetry, which count the losses of each publisher.
    collision
        Warning that several publishers send its telemetry; else empty.
    learning
        Progress of its baseline as a text; empty if the baseline is accepted, or not learned.
    """

    def __init__(
        self,
        actuator_id: str,
        finder: WindowFinder,
        publish: Callable[[HealthMessage], None],
        steady_ns: int,
        stream: Stream,
        namespace: str = "",
    ) -> None:
        self.actuator_id = actuator_id
        self.finder = finder
        self.health = ShownHealth(publish, steady_ns, lambda: finder.description, stream)
        self.tally = Tally()
        self.is_calibrating = False
        self.is_listed = False
        self.alternation = self.collision = self.learning = ""
        self.runs = SampleRuns()
        self._exchanged: list[str] = []
        self._since_exchange = 0
        self._namespace = namespace
        self.received_ns = steady_ns
        self.is_silent = False
        # Defects, each after the number of the first window that it does not affect.
        self._open_defects: deque[tuple[int, str]] = deque(maxlen=_MOST_NAMED)
        self.defect_count = 0
        self.valid = 0
        self.invalid = 0
        self.latency_s = float("nan")

    @property
    def description(self) -> ActuatorDescription | None:
        """The latest description of the actuator; None until it is described."""
        return self.finder.description

    @property
    def hardware_id(self) -> str:
        """Namespace, actuator and, once a description was received, serial number."""
        serial_number = self.description.serial_number if self.description else ""
        return hardware_name(self._namespace, self.actuator_id, serial_number)

    @property
    def defects(self) -> str:
        """Defects since the window of the latest valid estimate; empty if there are none."""
        return "; ".join(reason for _, reason in self._open_defects)

    def good_for_s(self, operation: Operation) -> float:
        """Return how long a level stays valid after a test [s]; longer for long records."""
        return operation.good_for(self.finder.longest_s if self.finder.finds_records else 0.0)

    def begin_calibration(self) -> None:
        """Show a running calibration in the status; raise ValueError if another is running."""
        if self.is_calibrating:
            raise ValueError(f"actuator {self.actuator_id!r} is already being calibrated")
        self.is_calibrating = True

    def end_calibration(self) -> None:
        """Allow the next calibration."""
        self.is_calibrating = False

    def exchange(self, old: str, new: str) -> bool:
        """Record the replacement of a unit. Return whether the new unit was mounted before.

        Units are rarely replaced, and removed units rarely return. Alternating units therefore
        indicate two actuators with the same name.
        """
        earlier = [number for number in self._exchanged if number != old]
        self._exchanged = [*earlier, old][-_MOST_NAMED:]
        self._since_exchange = 0
        if new not in self._exchanged:
            return False
        units = ", ".join(sorted({old, new}))
        self.alternation = (
            f"units {units} alternate under this actuator_id: give each actuator its own "
            "actuator_id, or call ~/forget_actuator if the unit was mounted again"
        )
        return True

    def check_publishers(self, publishing: Callable[[], Collection[str]]) -> bool:
        """Update the warning about several publishers. Return whether it has just begun.

        ``publishing`` returns the full names of the nodes that publish telemetry. The warning
        replaces the defects, which come from the alternating sample indices.
        """
        before = self.collision
        self.collision = ""
        if self.runs.are_several:
            self.collision = several_publishers([self.actuator_id], publishing())
        if bool(self.collision) != bool(before):
            self._open_defects.clear()
        return bool(self.collision) and not before

    def add_defect(self, reason: str, before_window: int | None = None) -> bool:
        """Record a defect. Return whether it is the only open defect.

        ``before_window`` is the number of the first window that the defect does not affect; None
        for the next window.
        """
        is_first = not self._open_defects
        number = self.finder.windows if before_window is None else before_window
        self._open_defects.append((number, reason))
        self.defect_count += 1
        return is_first

    def record(self, diagnosed: Diagnosed, outlook: Outlook | None, now: Moment) -> str:
        """Record an estimate and publish its outlook, unless the outlook is None.

        Returns a description of the level change, or "" if the level is unchanged or not published.
        """
        estimate = diagnosed.estimate
        if estimate.valid:
            self.valid += 1
            while self._open_defects and self._open_defects[0][0] <= diagnosed.last:
                self._open_defects.popleft()
            self.latency_s = (now.clock_ns - estimate.end_ns) * 1e-9
        else:
            self.invalid += 1
        if not (estimate.valid or estimate.is_learning):
            self.add_defect(f"window {diagnosed.number}: {estimate.reason}", diagnosed.last + 1)
        change = self.health.record(diagnosed, outlook, now) if outlook is not None else None
        if change is None:
            return ""
        self._since_exchange += 1
        if self._since_exchange >= _SETTLED:
            self.alternation = ""
        return change

    def expire(self, good_for_s: float, now: Moment) -> HealthMessage | None:
        """Publish the health if it has just become stale. Return the message, if published.

        Also updates ``is_silent``.
        """
        silent_s = (now.steady_ns - self.received_ns) * 1e-9
        self.is_silent = silent_s > min(_SILENT_S, good_for_s)
        return self.health.expire(good_for_s, now, self.defects, self.learning)
