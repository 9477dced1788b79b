"""Identification by a model: from a window, or its refusal, to the estimate of the faults."""

import time
from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from ema_core.arrays import Array
from ema_core.causes import CAUSE_BY_NAME, CauseEstimate, Place
from ema_core.column_errors import ColumnError
from ema_core.description import ActuatorDescription
from ema_core.faults import SHORT_CIRCUITS, healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.column_scale import mistaken_amplitude, wrong_scale
from ema_monitor.identification.defects import drive_defect
from ema_monitor.identification.estimate import Estimate, refusal
from ema_monitor.identification.fitness import DEFAULT_FITNESS
from ema_monitor.identification.inference import Finding, Inference
from ema_monitor.identification.knowledge import NUISANCE, Knowledge
from ema_monitor.identification.memory import NOTHING, Memory
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.optimizers import ALGORITHMS
from ema_monitor.optimizers.driver import Termination, minimise
from ema_monitor.optimizers.interface import Hints
from ema_monitor.reasons import (
    DriveUnknown,
    FitnessNeedsCurrent,
    NoCalibration,
    NoFiniteCost,
    NotConverged,
    NotMeasured,
    OtherSamples,
    OtherUnit,
    Reason,
    UncertaintyUnknown,
    WindowUnusable,
    WrongScale,
)
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

_FAR_BETTER = 0.4


@dataclass(frozen=True, eq=False)
class Generation:
    """State of an identification after a generation."""

    generation: int
    evaluations: int
    fitness: float
    faults: Array


class _Defect(NamedTuple):
    """Why no estimate of a window can be made; flags as of ``refusal``."""

    reason: Reason
    is_failure: bool = False
    lacks_calibration: bool = False


@dataclass(frozen=True, eq=False)
class _Premises:
    """What a search rests on.

    Attributes
    ----------
    window
        The window, with the measured causes that nothing has contradicted.
    calibration
        Calibration of the model.
    memory
        What earlier tests tell of this one.
    started
        When the first search began, by ``time.perf_counter`` [s].
    contradicted
        Measured causes that were left out.
    """

    window: Window
    calibration: Calibration
    memory: Memory
    started: float
    contradicted: tuple[CauseEstimate, ...] = ()

    def without(self, *causes: CauseEstimate) -> Self:
        """Return premises without some measured causes."""
        return replace(
            self, window=_without(self.window, causes), contradicted=(*self.contradicted, *causes)
        )


Search = Generator[Generation, None, Finding]
"""Yields the state after each generation of a search, and returns what it has found."""


@dataclass(frozen=True, eq=False)
class ModelIdentification:
    """One identification by a model.

    Attributes
    ----------
    window
        The window, with what was measured beside it, or why there is none: then the estimate is a
        refusal.
    description
        The actuator of the window.
    calibration
        Calibration of the model, or why there is none. If there is none, or it does not belong to
        that actuator or to the window's command, the estimate is a refusal.
    settings
        How to identify.
    force
        Make an estimate all the same; it says so in its reason.
    previous
        Faults identified in an earlier window, ``(8,)``: the search begins there if the settings
        want a warm start.
    known
        What is known of the faults before a stretch of motion; None before a test window.
    load
        Where the search for the load of a stretch begins, in the unit box.
    memory
        What earlier tests tell of this one.
    """

    window: Window | Refusal
    description: ActuatorDescription
    calibration: Calibration | str
    settings: SearchSettings
    force: bool = False
    previous: Array | None = None
    known: Knowledge | None = None
    load: float | None = None
    memory: Memory = NOTHING

    def run(self) -> Search:
        """Yield the state after each generation; there is none where a window is refused."""
        window, calibration = self.window, self.calibration
        if isinstance(window, Refusal):
            return self._refused(WindowUnusable(window.reason))
        if isinstance(calibration, str):
            return self._refused(NoCalibration(calibration), lacks_calibration=True)
        found = yield from self._search(window, calibration)
        return (yield from self._question_scale(found, window, calibration))

    def estimate(self) -> Estimate:
        """Return the estimate, without progress."""
        search = self.run()
        while True:
            try:
                next(search)
            except StopIteration as end:
                return end.value.estimate

    def _search(self, window: Window, calibration: Calibration) -> Search:
        """Search, and again without what was measured or remembered and is contradicted."""
        spent = 0
        memory = self.memory if self.settings.fitness == DEFAULT_FITNESS else NOTHING
        premises = _Premises(window, calibration, memory, time.perf_counter())
        while True:
            found = yield from self._search_once(premises)
            spent += found.estimate.evaluations
            named = {cause.name for cause in found.estimate.causes}
            wrong = tuple(one for one in found.estimate.measured if one.name in named)
            before, memory = premises.memory, premises.memory.left_by(found.estimate)
            premises = replace(premises, memory=memory)
            if not wrong and memory is before:
                found = replace(found, estimate=replace(found.estimate, evaluations=spent))
                return (yield from self._search_unmeasured(found, premises))
            premises = premises.without(*wrong)

    def _search_unmeasured(self, found: Finding, premises: _Premises) -> Search:
        """Search a window that fits poorly without each measured cause of the motion as well.

        An error of a sensor may stand in for a wrong measurement, but fits worse.
        """
        poor = found.estimate
        if not poor.goodness_of_fit > poor.goodness_limit:
            return found
        spent = poor.evaluations
        for cause in poor.measured:
            if CAUSE_BY_NAME[cause.name].place == Place.SENSOR:
                continue
            trial = yield from self._search_once(premises.without(cause))
            spent += trial.estimate.evaluations
            goodness = trial.estimate.goodness_of_fit
            if goodness <= trial.estimate.goodness_limit and goodness < (
                _FAR_BETTER * poor.goodness_of_fit
            ):
                found = trial
                break
        return replace(found, estimate=replace(found.estimate, evaluations=spent))

    def _question_scale(self, found: Finding, window: Window, calibration: Calibration) -> Search:
        """Refuse a window that the faults do not explain, where a column is off by a factor."""
        estimate = found.estimate
        parameters = calibration.parameters
        if mistaken := mistaken_amplitude(estimate.causes):
            refused = self._refused(WrongScale.of(mistaken)).estimate
            return Finding(replace(refused, evaluations=estimate.evaluations))
        if not estimate.goodness_of_fit > estimate.goodness_limit:
            return found
        window = _without(window, found.contradicted)
        scale = wrong_scale(window, parameters)
        if scale is None:
            return found
        if scale.columns == ("current",):
            # Faults take more current, too. A scale looks like turns lost in all three phases, and
            # explains the window by far better.
            lost = float(np.min(np.array(estimate.faults)[SHORT_CIRCUITS]))
            if estimate.valid and scale.factor > 1.0 and lost < 0.5 * (1.0 - 1.0 / scale.factor):
                return found
            telemetry = window.telemetry
            telemetry = replace(telemetry, current=telemetry.current / scale.factor)
            rescaled = yield from self._search(replace(window, telemetry=telemetry), calibration)
            other = rescaled.estimate
            if not (
                other.goodness_of_fit <= other.goodness_limit
                and other.goodness_of_fit < _FAR_BETTER * estimate.goodness_of_fit
            ):
                return found
            gains = [one.value for one in other.causes if one.name == "current_gain"]
            factor = scale.factor * (1.0 + sum(gains))
            scale = ColumnError.of(scale.columns, factor, scale.reference, parameters.tau)
        refused = self._refused(WrongScale.of(scale)).estimate
        return Finding(replace(refused, evaluations=estimate.evaluations))

    def _search_once(self, premises: _Premises) -> Search:
        window, calibration = premises.window, premises.calibration
        settings, mismatch = self.settings, calibration.unit_mismatch(self.description)
        defect = self._defect(window, calibration, "" if self.force else mismatch)
        if defect is not None:
            return self._refused(**defect._asdict())
        caveats: list[Reason] = [NotMeasured(name) for name in window.telemetry.missing]
        if mismatch:
            caveats.append(OtherUnit(mismatch, forced=True))
        optimizer_class = ALGORITHMS[settings.algorithm]
        inference = Inference(window, calibration, settings, self.known, premises.memory)
        # What is known already is known in Cartesian coordinates.
        objective = inference.searched(
            cartesian=optimizer_class.uses_residuals or self.known is not None
        )
        previous = self.previous if settings.warm_start else None
        start = objective.encode(healthy_faults() if previous is None else previous)
        # That place is relative to what was measured of the load.
        if self.load is not None and not premises.contradicted:
            for number, one in enumerate(objective.hidden_causes, start=objective.first_cause):
                if one.name == NUISANCE:
                    start[number] = self.load
        termination = Termination(settings.budget)
        reserve = inference.most_evaluations + 1
        good_cost = objective.fitness.good_cost
        hints = Hints(good_cost, objective.fair_cost, termination.budget - reserve)
        optimizer = optimizer_class(start, np.random.default_rng(settings.seed), hints)
        progress = None
        for progress in minimise(objective.residuals, optimizer, termination, reserve=reserve):
            [faults], _ = objective.decode(progress.point[None])
            yield Generation(progress.generation, objective.evaluations, progress.cost, faults)
        if progress is None or not np.isfinite(progress.cost):
            return self._refused(NoFiniteCost())
        if optimizer_class.uses_residuals and not optimizer.converged:
            caveats.append(NotConverged())
        [faults], [play] = objective.decode(progress.point[None])
        try:
            return inference.finding(
                faults,
                float(play),
                progress.point[objective.first_cause :],
                started=premises.started,
                warm_start=previous is not None,
                contradicted=premises.contradicted,
                caveats=tuple(caveats),
            )
        except np.linalg.LinAlgError as error:
            return self._refused(UncertaintyUnknown(str(error)))

    def _defect(self, window: Window, calibration: Calibration, mismatch: str) -> _Defect | None:
        """Return why no estimate can be made; None if it can."""
        if self.description.drive == "unknown":
            return _Defect(DriveUnknown(), lacks_calibration=True)
        if failure := drive_defect(window, self.description.parameters):
            # A speed in another unit is none that stands still.
            scale = wrong_scale(window, calibration.parameters)
            if scale is not None:
                return _Defect(WrongScale.of(scale))
            return _Defect(failure, is_failure=True)
        fitness = self.settings.fitness
        if reason := calibration.shape_mismatch(window):
            return _Defect(OtherSamples(reason), lacks_calibration=True)
        if unexcited := window.excitation_defect():
            return _Defect(unexcited)
        if not len(window.current) and fitness != DEFAULT_FITNESS:
            return _Defect(FitnessNeedsCurrent(fitness, DEFAULT_FITNESS))
        if mismatch:
            return _Defect(OtherUnit(mismatch), lacks_calibration=True)
        return None

    def _refused(
        self, reason: Reason, *, is_failure: bool = False, lacks_calibration: bool = False
    ) -> Finding:
        estimate = refusal(
            self.window,
            self.calibration,
            self.settings,
            reason,
            is_failure=is_failure,
            lacks_calibration=lacks_calibration,
        )
        return Finding(estimate)


def _without(window: Window, causes: tuple[CauseEstimate, ...]) -> Window:
    """Return a window without some of what was measured beside it."""
    return replace(window, measured=tuple(one for one in window.measured if one not in causes))
