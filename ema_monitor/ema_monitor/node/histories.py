"""The units whose histories a monitor has open."""

import threading
from pathlib import Path

from ema_monitor.prognosis.history import History, history_path
from ema_monitor.prognosis.prognostics import Prognostics, RequirementsOf
from ema_monitor.prognosis.requirements.requirements import FITTED
from ema_monitor.prognosis.service import CountLog, UnitKey
from ema_monitor.prognosis.settings import PrognosisSettings


class MonitorHistories:
    """Opens the history of each unit when it is first asked for; any thread may call.

    Parameters
    ----------
    requirements_of
        Gives the requirements of a unit, or why they cannot be watched.

    Attributes
    ----------
    counts
        Counts of service life, be the history of the unit open or not.
    """

    def __init__(self, requirements_of: RequirementsOf = FITTED.of) -> None:
        self._requirements_of = requirements_of
        self._lock = threading.Lock()
        # A lock a unit: that the history of one is long must not hold up the others.
        self._opening: dict[UnitKey, threading.Lock] = {}
        self._units: dict[UnitKey, Prognostics] = {}
        self.counts = CountLog()
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
            self.counts = CountLog()

    def items(self) -> list[tuple[UnitKey, Prognostics]]:
        """Return the units with open histories."""
        return list(self._units.items())

    def of(self, unit: UnitKey, settings: PrognosisSettings) -> Prognostics:
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

    def _open(self, unit: UnitKey, settings: PrognosisSettings) -> None:
        path = history_path(self._folder, *unit) if self._folder else None
        prognostics = Prognostics(History(*unit, path), settings, self._requirements_of)
        with self._lock:
            if not self._is_serving:
                prognostics.history.close()
            self._require_serving()
            self._units[unit] = prognostics

    def _require_serving(self) -> None:
        if not self._is_serving:
            raise ValueError("the monitor is not configured")
