"""The units whose histories a monitor has open."""

import threading
from pathlib import Path

from ema_monitor.prognosis.count_book import CountBook, Unit
from ema_monitor.prognosis.counts import Count
from ema_monitor.prognosis.history import History, history_path
from ema_monitor.prognosis.prognosis_settings import PrognosisSettings
from ema_monitor.prognosis.prognostics import Prognostics, RequirementsOf
from ema_monitor.prognosis.required_life import FITTED


class MonitorHistories:
    """Opens the history of each unit when it is first asked for; any thread may call.

    What was counted of a unit is kept until then.

    Parameters
    ----------
    requirements_of
        Gives the requirements of a unit, or why they cannot be watched.
    """

    def __init__(self, requirements_of: RequirementsOf = FITTED.of) -> None:
        self._requirements_of = requirements_of
        self._lock = threading.Lock()
        # A lock a unit: that the history of one is long must not hold up the others.
        self._opening: dict[Unit, threading.Lock] = {}
        self._units: dict[Unit, Prognostics] = {}
        self._counts = CountBook()
        self._folder: Path | None = None
        self._is_serving = False

    def begin(self, folder: Path | None) -> None:
        """Open histories from now on.

        Parameters
        ----------
        folder
            Where they are; None for memory alone.
        """
        self._folder = folder
        self._is_serving = True

    def end(self) -> None:
        """Let go of the histories, and open none any more."""
        with self._lock:
            self._is_serving = False
            opening = list(self._opening.values())
        for lock in opening:
            # Whoever is about to open a history finishes first.
            with lock:
                pass
        with self._lock:
            for prognostics in self._units.values():
                prognostics.history.close()
            self._opening.clear()
            self._units.clear()
            self._counts = CountBook()

    def items(self) -> list[tuple[Unit, Prognostics]]:
        """Return the units with open histories."""
        return list(self._units.items())

    def of(self, unit: Unit, settings: PrognosisSettings) -> Prognostics:
        """Return what is known of a unit.

        Parameters
        ----------
        unit
            The unit.
        settings
            What to go by at first.

        Raises
        ------
        ValueError
            When no histories are opened.
        """
        with self._lock:
            self._require_serving()
            opening = self._opening.setdefault(unit, threading.Lock())
        with opening:
            if unit not in self._units:
                self._open(unit, settings)
            return self._units[unit]

    def name(self, unit: Unit) -> None:
        """Give a unit what was counted of its actuator before that was described.

        Parameters
        ----------
        unit
            The unit.
        """
        self._counts.name(*unit)
        self._pass_on(unit)

    def count(self, unit: Unit, count: Count) -> None:
        """Take note of a count.

        Parameters
        ----------
        unit
            The unit; its serial number is empty as long as that is not known.
        count
            The count.
        """
        self._counts.add(*unit, count)
        self._pass_on(unit)

    def _open(self, unit: Unit, settings: PrognosisSettings) -> None:
        path = history_path(self._folder, *unit) if self._folder else None
        prognostics = Prognostics(History(*unit, path), settings, self._requirements_of)
        with self._lock:
            if not self._is_serving:
                prognostics.history.close()
            self._require_serving()
            self._units[unit] = prognostics
        self._pass_on(unit)

    def _pass_on(self, unit: Unit) -> None:
        """Tell a unit what was counted of it; as long as it is not open, that is kept."""
        if prognostics := self._units.get(unit):
            for count in self._counts.take(*unit):
                prognostics.tell(count)

    def _require_serving(self) -> None:
        if not self._is_serving:
            raise ValueError("the monitor is not configured")
