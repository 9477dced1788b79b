"""The prognosis of one unit: its history, its tracker, and what follows from them."""

import math
import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import ECCENTRICITY_PHASE, FAULT_NAMES, N_FAULTS
from ema_core.parameters import ActuatorParameters
from ema_monitor.health import HealthLimits, Tracked, assess, with_requirements
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.growth.prediction import Prognosis, RemainingLife, assumption_of
from ema_monitor.prognosis.growth.tracker import TrackedFault, Tracker
from ema_monitor.prognosis.growth_record import GrowthRecord
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Count, Entry, UnusedCycle
from ema_monitor.prognosis.outlook import Outlook, earlier, worst_with_warning
from ema_monitor.prognosis.requirements.required_life import RequiredLife, required_life
from ema_monitor.prognosis.requirements.requirements import FITTED, RequirementLimits, Requirements
from ema_monitor.prognosis.settings import PrognosisSettings

RequirementsOf = Callable[[ActuatorParameters, RequirementLimits], Requirements | str]


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
    requirements_of
        Gives the requirements of a unit, or why they cannot be watched.
    """

    def __init__(
        self,
        history: History,
        settings: PrognosisSettings | None = None,
        requirements_of: RequirementsOf = FITTED.of,
    ) -> None:
        self.history = history
        self._requirements_of = requirements_of
        self._lock = threading.RLock()
        self._settings = settings or PrognosisSettings()
        self._growth = self._growth_of_history()
        self._events = tuple(filter(None, (history.imported, history.problem)))
        self._ignores_usage = False

    @property
    def growth(self) -> GrowthRecord:
        """What is known of growth, and by which tests."""
        return self._growth

    def take(
        self,
        estimate: Estimate,
        parameters: ActuatorParameters | None,
        settings: PrognosisSettings,
        count: Count | None = None,
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
        count
            Latest count of service hours that was read before the test; None when there is none.

        Notes
        -----
        A test whose stamp is in the history already changes nothing, unless it had no valid
        estimate and now has: then it is no further cycle. One whose service hours are unknown or
        not confirmed yet is kept but does not enter the prognosis.
        """
        with self._lock:
            self._settle(settings)
            is_new = not self.history.holds(estimate.end_ns)
            if not estimate.valid:
                if is_new:
                    self.history.append(UnusedCycle(estimate.end_ns))
                return None
            if self.history.holds_valid(estimate.end_ns):
                again = "a test that is in the history already came again and changes nothing"
                self._events = (*self._events, again)
            else:
                cycles = self.history.unused_cycles + is_new
                entry, ignored = self._entry(estimate, cycles, count)
                events = [*ignored, *self._oddities(entry), *self._growth.add(entry)]
                self.history.append(entry)
                self._events = (*self._events, *events)
            return self._outlook_with_events(parameters)

    def resume(
        self, parameters: ActuatorParameters | None, settings: PrognosisSettings
    ) -> Outlook | None:
        """Return what there is to say after the latest test so far; None when there was none.

        Parameters
        ----------
        parameters, settings
            As of ``take``.
        """
        with self._lock:
            self._settle(settings)
            return self._outlook_with_events(parameters) if self.history.entries else None

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
            self._growth = self._growth_of_history()

    def _growth_of_history(self) -> GrowthRecord:
        return GrowthRecord(self._settings.limits, self._settings.tracker, self.history.entries)

    def _outlook_with_events(self, parameters: ActuatorParameters | None) -> Outlook:
        outlook = self._outlook(parameters, self._settings.service.duty)
        # Each event is published once.
        self._events = ()
        return outlook

    def _entry(
        self, estimate: Estimate, new_cycles: int, count: Count | None
    ) -> tuple[Entry, list[str]]:
        """Return a test as it is kept, and an event when the first count is ignored."""
        latest, hours_per_cycle = (
            self._growth.service.latest,
            self._settings.service.hours_per_cycle,
        )
        cycles = new_cycles + (latest.cycles if latest else 0)
        if hours_per_cycle > 0.0:
            hours = self._growth.service.after(cycles, hours_per_cycle)
            ignored = []
            if count is not None and not self._ignores_usage:
                self._ignores_usage = True
                ignored = [
                    f"usage is ignored, {count.hours:g} h: hours_per_cycle = {hours_per_cycle:g} h "
                    "is set"
                ]
            return Entry(estimate, hours, cycles), ignored
        before = latest.count if latest else None
        # After a restart, the latest count may be in the history alone.
        read = [item for item in (count, before) if item and item.stamp_ns <= estimate.end_ns]
        newest = max(read, key=lambda item: item.stamp_ns, default=None)
        if newest is not None and newest != before:
            cycles = newest.cycles or cycles
        return Entry(estimate, math.nan, cycles, newest), []

    def _oddities(self, entry: Entry) -> list[str]:
        """Return what is odd about a test beside the latest one."""
        latest = self._growth.service.latest
        if latest is None:
            return []
        told = []
        missed = entry.cycles - latest.cycles - 1
        if missed > 0:
            told.append(f"missed tests: {missed} without a valid estimate before this one")
        back_ns = latest.stamp_ns - entry.stamp_ns
        if back_ns > 0:
            told.append(
                f"the stamp of the test is {back_ns * 1e-9:g} s before that of the latest one"
            )
        return told

    def _outlook(self, parameters: ActuatorParameters | None, duty: float) -> Outlook:
        growth, service = self._growth, self._growth.service
        entry = service.latest
        if entry is None:
            raise RuntimeError("an outlook needs a test")
        limits = self._settings.limits
        if service.unknown:
            tracked: tuple[TrackedFault, ...] = ()
            prognosis = _nothing(service.unknown, limits, duty)
        else:
            tracked = tuple(item for item in growth.tracker.components() if item.tests)
            prognosis = growth.tracker.predict(duty)
        # Alarms do not wait for a count.
        judged = tracked if growth.latest_is_used else ()
        health = assess(
            entry.estimate,
            limits,
            {
                item.name: Tracked(item.value, item.sigma, item.name in growth.doubtful)
                for item in judged
            },
        )
        required = self._required(entry, tracked, prognosis, parameters)
        health = with_requirements(health, required.healths)
        rul = earlier(prognosis.overall, required.overall, required.with_limits)
        dominant = worst_with_warning(health)
        if rul.known:
            by_fault = rul.criterion == prognosis.overall.criterion
            dominant = prognosis.dominant_fault if by_fault else required.dominant
        return Outlook(
            entry.stamp_ns,
            service.hours,
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
        limits, growth = self._settings.requirements, self._growth
        if parameters is None:
            reason = "requirements cannot be watched without a calibration"
            return RequiredLife.unknown(reason, limits)
        requirements = self._requirements_of(parameters, limits)
        if isinstance(requirements, str):
            return RequiredLife.unknown(requirements, limits)
        warn_share = self._settings.limits.warn_share
        faults, covariance = self._now(entry.estimate, tracked)
        judgement = requirements.judge(faults, covariance, warn_share=warn_share)
        if growth.service.unknown or np.isnan(faults).any():
            reason = growth.service.unknown or "not all faults are observable"
            return RequiredLife.unknown(reason, requirements, judgement.healths)
        required = required_life(
            requirements,
            judgement,
            faults,
            growth.tracker,
            tracked,
            prognosis,
            self._settings.limits,
            self._settings.tracker,
            growth.service.hours - growth.service.used[0].hours,
        )
        if growth.latest_is_used:
            return required
        now = requirements.judge(*self._now(entry.estimate, ()), warn_share=warn_share)
        return replace(required, healths=now.healths)

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
        phase = self._growth.phase
        if not math.isnan(phase[0]):
            faults[ECCENTRICITY_PHASE], variance[ECCENTRICITY_PHASE] = phase
        np.fill_diagonal(covariance, variance)
        return faults, covariance

    def _hours_per_cycle(self) -> float:
        """Return the flight hours from a test cycle to the next [h]; NaN when not known."""
        used = self._growth.service.used
        if used and used[-1].entry.cycles > used[0].entry.cycles:
            cycles = used[-1].entry.cycles - used[0].entry.cycles
            if (mean := (used[-1].hours - used[0].hours) / cycles) > 0.0:
                return mean
        return self._settings.service.hours_per_cycle or math.nan


def _nothing(reason: str, limits: HealthLimits, duty: float) -> Prognosis:
    """Return the prognosis of which no figure can be given."""
    blank = Tracker(limits).predict(duty)
    components = {
        name: RemainingLife.unknown(life.criterion, reason)
        for name, life in blank.components.items()
    }
    overall = RemainingLife.unknown(blank.overall.criterion, reason)
    return replace(blank, components=components, overall=overall, assumption=assumption_of(duty))
