# SPDX-License-Identifier: Apache-2.0
"""Monitored units and their histories."""

import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from ema_core.description import ActuatorDescription, UnitKey
from ema_core.event_kinds import EventKind
from ema_core.levels import OK, WARN
from ema_core.wording import counted
from ema_monitor.identification.estimate import Estimate
from ema_monitor.node.publish.log import Log
from ema_monitor.prognosis.event_texts import event_text
from ema_monitor.prognosis.events import UnitEvent
from ema_monitor.prognosis.history import History, history_path
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit
from ema_ros.status import Task, hardware_name

PROGNOSIS: Final = "the prognosis"
"""Name of the step in log lines when a unit or its history fails."""

_LOGGED_ELSEWHERE: Final = (
    EventKind.FAULT,
    EventKind.DEPARTURE,
    EventKind.RESTART,
    EventKind.HISTORY,
)


class Histories:
    """Units and their histories, opened on first use. Thread-safe.

    Attributes
    ----------
    folder
        Folder of the histories; None to keep histories in memory only.
    settings
        Returns the current settings of prognoses.
    author
        Node name, recorded in the entries that it writes.
    lock
        Held while a history is opened, resumed or closed.
    is_serving
        Whether histories may be opened.
    refusals
        Reason why the latest test was not recorded, by unit; empty if it was.
    """

    def __init__(
        self,
        folder: Path | None,
        settings: Callable[[], PrognosisSettings],
        author: str,
        namespace: str,
        log: Log,
        passed_ns: Callable[[], int],
    ) -> None:
        self.folder = folder
        self.lock = threading.RLock()
        self.is_serving = True
        self.refusals: dict[UnitKey, str] = {}
        self.settings = settings
        self.author = author
        self._namespace = namespace
        self._log = log
        self._passed_ns = passed_ns
        self._units: dict[UnitKey, Unit] = {}
        self._logged: dict[UnitKey, str] = {}

    def of(self, description: ActuatorDescription) -> Unit:
        """Return a unit, opening its history on the first call."""
        key = description.unit_key
        unit = self._units.get(key)
        if unit is None:
            with self.lock:
                if not self.is_serving:
                    raise ValueError("the monitor is not configured")
                if (unit := self._units.get(key)) is None:
                    path = history_path(self.folder, *key) if self.folder else None
                    unit = self._units[key] = Unit(
                        History(*key, path), self.settings(), time.time_ns(), self.author
                    )
                    if passed_ns := self._passed_ns():
                        unit.mark_clock_step(passed_ns)
        self.log(description, unit)
        return unit

    def estimates(self, description: ActuatorDescription) -> list[Estimate]:
        """Return the valid estimates in a unit's history, in order; none if it cannot be opened."""
        try:
            entries = self.of(description).history.entries
        except Exception as error:
            # The search does not depend on the history.
            self._log.failed(description.actuator_id, PROGNOSIS, error)
            return []
        return [entry.estimate for entry in entries]

    def write_assessment(self, description: ActuatorDescription) -> None:
        """Write the assessment after the latest test of a unit, unless the unit was forgotten."""
        unit = self._units.get(description.unit_key)
        if unit is not None:
            unit.write()
            self.log(description, unit)

    def log(
        self, description: ActuatorDescription, unit: Unit, events: Iterable[UnitEvent] = ()
    ) -> None:
        """Log a history problem (once) and the events of a unit."""
        problem, key = unit.history.problem, description.unit_key
        if problem and self._logged.get(key) != problem:
            self._log.error(f"{description.actuator_id}: {problem}")
        self._logged[key] = problem
        for event in events:
            if event.kind not in _LOGGED_ELSEWHERE:
                self._log.warning(f"{description.actuator_id}: {event_text(event)}")

    def forget(self, actuator_id: str) -> None:
        """Forget an actuator for this run; its files are kept."""
        with self.lock:
            for key in [key for key in self._units if key[0] == actuator_id]:
                self._units.pop(key).history.close()

    def mark_clock_step(self) -> None:
        """Mark all tests so far as measured before a step of the clock."""
        for unit in list(self._units.values()):
            unit.mark_clock_step()

    def rewind(self, time_ns: int) -> None:
        """Discard tests later than ``time_ns``, to which simulated time has stepped back."""
        for unit in list(self._units.values()):
            unit.rewind(time_ns)

    def close(self) -> None:
        """Close all histories and refuse to open more."""
        # Wait for a history that is being opened, and for a health that is being published.
        with self.lock:
            self.is_serving = False
            for unit in self._units.values():
                unit.history.close()
            self._units.clear()

    def tasks(self, actuator_id: str = "") -> list[Task]:
        """Return the history status of an actuator; an empty name selects all actuators."""
        tasks = []
        for key, unit in list(self._units.items()):
            if actuator_id not in ("", key[0]):
                continue
            wrong = "; ".join(filter(None, [self.refusals.get(key), unit.history.problem]))
            tasks.append(
                Task(
                    f"{key[0]} history",
                    WARN if wrong else OK,
                    wrong or counted(len(unit.history.entries), "test"),
                    hardware_name(self._namespace, *key),
                    {"file": unit.history.path or "none, in memory only"},
                )
            )
        return tasks
