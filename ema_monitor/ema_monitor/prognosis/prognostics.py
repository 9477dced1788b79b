"""The prognosis of one unit: its history, its tracker, and what follows from them."""

import math
import threading
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import ECCENTRICITY_PHASE, FAULT_NAMES, N_FAULTS
from ema_core.parameters import ActuatorParameters
from ema_monitor.estimate import Estimate
from ema_monitor.health import HealthLimits, Tracked, assess, with_requirements
from ema_monitor.prognosis.events import OUTLIER
from ema_monitor.prognosis.history import Entry, History
from ema_monitor.prognosis.observation import Observation
from ema_monitor.prognosis.outlook import Outlook, earlier
from ema_monitor.prognosis.prediction import Life, Prognosis, assumption_of
from ema_monitor.prognosis.prognosis_settings import PrognosisSettings
from ema_monitor.prognosis.required_life import RequiredLife, required_life, requirements_of
from ema_monitor.prognosis.tracker import TrackedFault, Tracker
from ema_monitor.prognosis.usage import UNKNOWN_HOURS, Age, Count, Usage


class Prognostics:
    """Follows one unit from test to test; any thread may call.

    What it says depends on the tests in the history and on the settings alone: a replay of the
    same tests, or of the history after a restart, says the same.

    Parameters
    ----------
    history
        Tests so far.
    settings
        What to go by at first.
    """

    def __init__(self, history: History, settings: PrognosisSettings | None = None) -> None:
        self.history = history
        self._lock = threading.RLock()
        self._settings = settings or PrognosisSettings()
        self._replay()
        self._events: tuple[str, ...] = (history.problem,) if history.problem else ()
        last = history.entries[-1] if history.entries else None
        hours = self._tracker.hours
        self._usage = Usage(Age(hours, last.cycles if last else 0))

    def tell(self, count: Count) -> None:
        """Take note of service hours that were counted.

        Parameters
        ----------
        count
            The count.
        """
        # Without the lock: who hears of a count must not wait for a prognosis.
        self._usage.tell(count)

    def take(
        self,
        estimate: Estimate,
        parameters: ActuatorParameters | None,
        settings: PrognosisSettings,
    ) -> Outlook | None:
        """Take the estimate of a test, keep it, and return what there is to say; None if invalid.

        Parameters
        ----------
        estimate
            What was found in the window.
        parameters
            Those of the unit; None when they are not known.
        settings
            What to go by from now on.

        Notes
        -----
        A test whose stamp is in the history already changes nothing. One whose service hours are
        unknown, or before those of the latest, is kept but does not enter the prognosis.
        """
        with self._lock:
            self._settle(settings)
            if not estimate.valid:
                self._usage.pass_test()
                return None
            if self.history.holds(estimate.end_ns):
                again = "a test that is in the history already came again and changes nothing"
                self._events = (*self._events, again)
            else:
                self._usage.pass_test()
                service = settings.service
                age = self._usage.at(estimate.end_ns, service.hours_per_cycle)
                entry = Entry(estimate, age.hours, age.cycles, service.duty)
                told = [*self._oddities(entry), *self._apply(entry)]
                self.history.append(entry)
                self._events = (*self._events, *told)
            outlook = self._outlook(parameters, settings.service.duty)
            # Each event is told once.
            self._events = ()
            return outlook

    def outlook(
        self,
        parameters: ActuatorParameters | None,
        settings: PrognosisSettings,
    ) -> Outlook:
        """Return what there is to say under other settings, a duty above all, and change nothing.

        Parameters
        ----------
        parameters, settings
            As of ``take``.

        Raises
        ------
        ValueError
            When there is no history.
        """
        with self._lock:
            if not self.history.entries:
                raise ValueError("there is no history yet: no valid test so far")
            self._settle(settings)
            return self._outlook(parameters, settings.service.duty)

    def _settle(self, settings: PrognosisSettings) -> None:
        """Go by settings from now on; a tracker that assumes other things begins anew."""
        old, self._settings = self._settings, settings
        if (old.limits, old.tracker) != (settings.limits, settings.tracker):
            self._replay()

    def _replay(self) -> None:
        self._tracker = Tracker(self._settings.limits, self._settings.tracker)
        self._first: Entry | None = None
        self._latest: Entry | None = None
        self._used: Entry | None = None
        self._left_out = ""
        self._doubtful: set[str] = set()
        self._phase = (math.nan, math.nan)
        for entry in self.history.entries:
            self._apply(entry)

    def _apply(self, entry: Entry) -> list[str]:
        """Let a test tell of the faults; return its events in words."""
        self._latest = entry
        self._doubtful = set()
        if math.isnan(entry.hours):
            self._left_out = UNKNOWN_HOURS
            return []
        if entry.hours < self._tracker.hours:
            self._left_out = (
                f"service hours went back from {self._tracker.hours:g} h to {entry.hours:g} h: "
                "the test is left out of the prognosis"
            )
            return [self._left_out]
        self._left_out = ""
        self._first = self._first or entry
        self._used = entry
        estimate = entry.estimate
        if not estimate.unobservable[ECCENTRICITY_PHASE]:
            self._phase = (
                float(estimate.faults[ECCENTRICITY_PHASE]),
                float(estimate.covariance[ECCENTRICITY_PHASE, ECCENTRICITY_PHASE]),
            )
        events = self._tracker.update(Observation.of(estimate, entry.hours))
        self._doubtful = {item.component for item in events if item.kind == OUTLIER}
        return [f"{item.kind}: {item.text}" for item in events]

    def _oddities(self, entry: Entry) -> list[str]:
        """Return what is odd about a test beside the latest one."""
        if self._latest is None:
            return []
        told = []
        missed = entry.cycles - self._latest.cycles - 1
        if missed > 0:
            told.append(f"missed tests: {missed} without a valid estimate before this one")
        back_ns = self._latest.stamp_ns - entry.stamp_ns
        if back_ns > 0:
            told.append(
                f"the stamp of the test is {back_ns * 1e-9:g} s before that of the latest one"
            )
        return told

    def _outlook(self, parameters: ActuatorParameters | None, duty: float) -> Outlook:
        entry = self._latest
        if entry is None:
            raise RuntimeError("an outlook needs a test")
        limits = self._settings.limits
        unknown_hours = self._left_out
        if unknown_hours:
            tracked: tuple[TrackedFault, ...] = ()
            prognosis = _nothing(unknown_hours, limits, duty)
        else:
            tracked = tuple(item for item in self._tracker.components() if item.tests)
            prognosis = self._tracker.predict(duty)
        health = assess(
            entry.estimate,
            limits,
            {
                item.name: Tracked(item.value, item.sigma, item.name in self._doubtful)
                for item in tracked
            },
        )
        required = self._required(entry, tracked, prognosis, parameters)
        health = with_requirements(health, required.healths)
        rul = earlier(prognosis.overall, required.overall)
        dominant = health.dominant_fault
        if rul.known:
            by_fault = rul.criterion == prognosis.overall.criterion
            dominant = prognosis.dominant_fault if by_fault else required.dominant
        return Outlook(
            entry.stamp_ns,
            entry.hours,
            entry.cycles,
            self._hours_per_cycle(),
            health,
            {item.name: item.trend for item in tracked} | dict(required.trends),
            {**prognosis.components, **required.lives},
            prognosis.overall,
            required.overall,
            rul,
            dominant,
            duty,
            prognosis.assumption,
            self._events,
        )

    def _required(
        self,
        entry: Entry,
        tracked: tuple[TrackedFault, ...],
        prognosis: Prognosis,
        parameters: ActuatorParameters | None,
    ) -> RequiredLife:
        if parameters is None:
            return RequiredLife.unknown("requirements cannot be watched without a calibration")
        requirements = requirements_of(parameters, self._settings.requirements)
        if isinstance(requirements, str):
            return RequiredLife.unknown(requirements)
        faults, covariance = self._now(entry.estimate, tracked)
        healths = requirements.assess(
            faults, covariance, warn_share=self._settings.limits.warn_share
        )
        if self._left_out or self._first is None or np.isnan(faults).any():
            reason = self._left_out or "not all faults are observable"
            return RequiredLife.unknown(reason, healths)
        observed = entry.hours - self._first.hours
        return required_life(
            requirements,
            healths,
            faults,
            self._tracker,
            prognosis,
            self._settings.tracker,
            observed,
        )

    def _now(
        self, estimate: Estimate, tracked: tuple[TrackedFault, ...]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return faults, ``(8,)``, and covariance as all tests tell them, NaN where unknown."""
        faults = estimate.faults.copy()
        if not tracked:
            return faults, estimate.covariance
        covariance = np.full((N_FAULTS, N_FAULTS), 0.0)
        variance = np.where(estimate.unobservable, np.nan, np.diag(estimate.covariance))
        for item in tracked:
            number = FAULT_NAMES.index(item.name)
            faults[number], variance[number] = item.value, item.sigma**2
        if not math.isnan(self._phase[0]):
            faults[ECCENTRICITY_PHASE], variance[ECCENTRICITY_PHASE] = self._phase
        np.fill_diagonal(covariance, variance)
        return faults, covariance

    def _hours_per_cycle(self) -> float:
        """Return the flight hours from a test cycle to the next [h]; NaN when not known."""
        first, last = self._first, self._used
        if first is not None and last is not None and last.cycles > first.cycles:
            mean = (last.hours - first.hours) / (last.cycles - first.cycles)
            if mean > 0.0:
                return mean
        return self._settings.service.hours_per_cycle or math.nan


def _nothing(reason: str, limits: HealthLimits, duty: float) -> Prognosis:
    """Return the prognosis of which no figure can be given."""
    blank = Tracker(limits).predict(duty)
    components = {
        name: Life.unknown(life.criterion, reason) for name, life in blank.components.items()
    }
    overall = Life.unknown(blank.overall.criterion, reason)
    return replace(blank, components=components, overall=overall, assumption=assumption_of(duty))
