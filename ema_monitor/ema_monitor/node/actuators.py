"""The actuators that a monitor follows."""

import threading
from collections.abc import Callable, Mapping

from ema_core.description import ActuatorDescription
from ema_interfaces.msg import Health as HealthMessage
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.tally import Tally
from ema_monitor.node.actuator import Actuator
from ema_monitor.node.admission import Admission
from ema_monitor.node.unit_status import unit_tasks
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import TriggerSettings
from ema_ros.status import Task

_MOST_NAMED = 10
_MOST_DESCRIBED = 1000


class Actuators(dict[str, Actuator]):
    """Actuators by name: those that are listed, then in the order of their first message.

    Parameters
    ----------
    admission
        Decides which actuators are followed.
    trigger
        When a window begins and how long it is.
    now_ns
        Gives the time of the node's clock [ns].
    add_publisher
        Gives the publisher of the health of an actuator, by its name; called at its first message.
    describe
        Called with the description of an actuator that is followed again.
    warn
        Called with the name of an actuator, empty when there is none, what is wrong, and whether
        its status has to be published at once.
    inform
        Called with what is worth a line in the log.
    forget
        Called with the name of an actuator that is to be forgotten in favour of another one.
    namespace
        Namespace of the node, for the status.

    Attributes
    ----------
    admission
        Which actuators are followed.
    trigger
        When a window of a new one begins and how long it is.
    lock
        Held while units are changed, and while health is published: nothing older may follow the
        health after a test.
    """

    def __init__(
        self,
        admission: Admission,
        trigger: TriggerSettings,
        now_ns: Callable[[], int],
        add_publisher: Callable[[str], Callable[[HealthMessage], None]],
        describe: Callable[[ActuatorDescription], None],
        warn: Callable[[str, str, bool], None],
        inform: Callable[[str], object],
        forget: Callable[[str], None],
        namespace: str,
    ) -> None:
        super().__init__()
        self.lock = threading.RLock()
        self.admission = admission
        self.trigger = trigger
        self.now_ns = now_ns
        self.note_description = describe
        self.warn = warn
        self.inform = inform
        self._add_publisher = add_publisher
        self._forget = forget
        # Latched topics describe an actuator once: it is kept for its return.
        self._described: dict[str, ActuatorDescription] = {}
        self._namespace = namespace

    def clear(self) -> None:
        """Remove all."""
        super().clear()
        self.admission.clear()
        self._described.clear()

    def expect_listed(self) -> None:
        """Add the actuators that are listed, so that one that says nothing is seen.

        Raises
        ------
        ValueError
            When there are more than may be followed.
        """
        self.admission.check()
        for actuator_id in self.admission.listed:
            self.get_or_add(actuator_id)

    def forget_health(self) -> None:
        """Forget what is known of the health of all."""
        with self.lock:
            for unit in self.values():
                unit.reset_health(self.now_ns())

    def forget(self, actuator_id: str) -> None:
        """Forget an actuator.

        Parameters
        ----------
        actuator_id
            Which; its name as it was received, possible or not.

        Raises
        ------
        ValueError
            When it is not known.
        """
        with self.lock:
            unit = self.get(actuator_id)
            if unit is None:
                raise ValueError(self._not_monitored(actuator_id))
            unit.finder.finish()
            if unit.description is not None:
                self._remember(unit.description)
            del self[actuator_id]

    def add_defect(self, actuator_id: str, reason: str, *, is_known: bool = True) -> None:
        """Record and report a defect.

        Parameters
        ----------
        actuator_id
            Of which actuator; empty when the message does not name one.
        reason
            What is wrong.
        is_known
            Whether the actuator is known, or is from now on.
        """
        with self.lock:
            unit = self.get_or_add(actuator_id) if actuator_id and is_known else None
            if unit is not None:
                is_first = unit.add_defect(reason)
            else:
                is_first = self.admission.note_wrong(actuator_id, reason)
        self.warn(actuator_id, reason, is_first)

    def find(self, actuator_id: str) -> tuple[Actuator, ActuatorDescription]:
        """Return a unit that is described, and its description.

        Parameters
        ----------
        actuator_id
            Which; empty for the only one.

        Raises
        ------
        ValueError
            When it is not known, not described, or there is a choice.
        """
        with self.lock:
            if not actuator_id and len(self) != 1:
                raise ValueError(
                    f"actuator_id is empty: expected one of those monitored: {self._in_words()}"
                )
            unit = self.get(actuator_id or next(iter(self)))
        if unit is None:
            raise ValueError(self._not_monitored(actuator_id))
        if unit.description is None:
            raise ValueError(f"actuator {unit.actuator_id!r} has not been described")
        return unit, unit.description

    def record(
        self,
        segment: Segment,
        estimate: Estimate,
        outlook: Outlook | None,
        now_ns: int,
        confirmations: int,
    ) -> None:
        """Record an estimate as ``Actuator.record`` does; nothing when that is forgotten."""
        actuator_id = segment.description.actuator_id
        with self.lock:
            unit = self.get(actuator_id)
            if unit is None:
                return
            change = unit.record(segment, estimate, outlook, now_ns, confirmations)
        if change:
            self.inform(f"{actuator_id}: {change}")

    def report_tally(self, actuator_id: str, tally: Tally) -> None:
        """Record what became of the stretches of an actuator's motion so far."""
        with self.lock:
            if actuator_id in self:
                self[actuator_id].tally = tally

    def publish_stale(self, good_for_s: float) -> list[HealthMessage]:
        """Publish, and return, the health of the units whose health has just become stale."""
        with self.lock:
            now_ns = self.now_ns()
            published = [unit.publish_if_stale(good_for_s, now_ns) for unit in self.values()]
        return [health for health in published if health is not None]

    def tasks(self, waiting: int, dropped: Mapping[str, int], only: str = "") -> list[Task]:
        """Return the status of each, or of one alone.

        Parameters
        ----------
        waiting
            How many windows of all actuators wait.
        dropped
            How many were dropped, by actuator.
        only
            Which one; empty for each.
        """
        with self.lock:
            units = self if not only else {only: self[only]} if only in self else {}
            return [
                task
                for name, unit in units.items()
                for task in unit_tasks(unit, waiting, dropped.get(name, 0))
            ]

    def input_task(self, hardware_id: str, counts: Mapping[str, int]) -> Task:
        """Return the status of what is received of all.

        Parameters
        ----------
        hardware_id
            What it is about.
        counts
            What became of the windows of all actuators.
        """
        with self.lock:
            level, message = self.admission.status(self)
            figures = {**counts, **self.admission.figures(self)}
        return Task("input", level, message, hardware_id, figures)

    def get_or_add(
        self, actuator_id: str, description: ActuatorDescription | None = None
    ) -> Actuator | None:
        """Return an actuator; None when there is no room for it.

        It takes the place of one that is silent for long. Where there is none it is refused, and
        its description kept for later.
        """
        if (unit := self.get(actuator_id)) is not None:
            return unit
        if not self.admission.has_room(self):
            now_ns = self.now_ns()
            silent_s = {name: one.silent_s(now_ns) for name, one in self.items()}
            longest = self.admission.silent_for_long(silent_s)
            if not longest:
                if description is not None:
                    self._remember(description)
                if reason := self.admission.refuse(actuator_id):
                    self.warn(actuator_id, reason, True)
                return None
            self._forget(longest)
        publish, now_ns = self._add_publisher(actuator_id), self.now_ns()
        unit = Actuator(actuator_id, self.trigger, publish, now_ns, self._namespace)
        unit.is_listed = actuator_id in self.admission.listed
        self[actuator_id] = unit
        if (known := self._described.pop(actuator_id, None)) is not None and description is None:
            unit.finder.describe(known)
            self.note_description(known)
        return unit

    def _remember(self, description: ActuatorDescription) -> None:
        """Keep the description of an actuator that is not monitored."""
        self._described.pop(description.actuator_id, None)
        self._described[description.actuator_id] = description
        if len(self._described) > _MOST_DESCRIBED:
            del self._described[next(iter(self._described))]

    def _in_words(self) -> str:
        names = list(self)
        more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
        return (", ".join(names[:_MOST_NAMED]) or "none") + more

    def _not_monitored(self, actuator_id: str) -> str:
        reason = self.admission.why_not(actuator_id) or f"monitored: {self._in_words()}"
        return f"actuator_id = {actuator_id!r} is not monitored; {reason}"
