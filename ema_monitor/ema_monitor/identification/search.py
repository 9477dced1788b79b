# SPDX-License-Identifier: Apache-2.0
"""Identification of the faults in a window by fitting a model."""

import time
from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from ema_core.arrays import Array
from ema_core.causes import CAUSE_BY_NAME, CauseEstimate, SystemPart
from ema_core.columns.errors import ColumnError
from ema_core.description import ActuatorDescription
from ema_core.faults import SHORT_CIRCUITS, healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.column_scale import mistaken_amplitude, wrong_scale
from ema_monitor.identification.defects import drive_defect
from ema_monitor.identification.estimate import Estimate, refusal
from ema_monitor.identification.fitness import DEFAULT_FITNESS
from ema_monitor.identification.inference import Inference, WindowResult
from ema_monitor.identification.knowledge import NUISANCE, Knowledge
from ema_monitor.identification.memory import NOTHING, Memory
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.optimizers import ALGORITHMS
from ema_monitor.optimizers.driver import Termination, minimise
from ema_monitor.optimizers.interface import Hints
from ema_monitor.reasons import (
    CalibrationMissing,
    Difference,
    DriveUnknown,
    FitnessNeedsCurrent,
    NoFiniteCost,
    NotConverged,
    NotMeasured,
    OtherUnit,
    Reason,
    UncertaintyUnknown,
    WrongScale,
)
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

_FAR_BETTER = 0.4


@dataclass(frozen=True, eq=False)
class Generation:
    """State of an identification after a generation of the optimizer."""

    generation: int
    """Number of generations so far."""
    evaluations: int
    """Number of model evaluations so far."""
    fitness: float
    """Lowest cost so far [A^2.s]."""
    faults: Array
    """Faults at the lowest cost, ``(8,)``."""


class _Defect(NamedTuple):
    """Defect of a window that prevents an estimate."""

    reason: Reason
    """The defect, as the reason for a refusal."""
    is_failure: bool = False
    """Whether drive or shaft has failed."""
    lacks_calibration: bool = False
    """Whether no calibration matches the actuator and window."""


@dataclass(frozen=True, eq=False)
class _Premises:
    """Inputs of a search."""

    window: Window
    """The window; measured causes that it contradicts are removed."""
    calibration: Calibration
    """Calibration of the model."""
    memory: Memory
    """Memory of the unit's earlier tests."""
    started: float
    """Start time of the first search by ``time.perf_counter`` [s]."""
    contradicted: tuple[CauseEstimate, ...] = ()
    """Measured causes that were removed because the window contradicts them."""

    def without(self, *causes: CauseEstimate) -> Self:
        """Return the inputs without some measured causes, which are recorded as contradicted."""
        return replace(
            self, window=_without(self.window, causes), contradicted=(*self.contradicted, *causes)
        )


Search = Generator[Generation, None, WindowResult]
"""Generator that yields the state after each generation and returns the result."""


@dataclass(frozen=True, eq=False)
class ModelIdentification:
    """Identification of the faults in a window by fitting a model."""

    window: Window | Refusal
    """The window with its measured causes, or its refusal, for which the estimate is a refusal with
    the same cause."""
    description: ActuatorDescription
    """Description of the actuator."""
    calibration: Calibration | CalibrationMissing
    """Calibration of the model, or the reason why there is none. Without a calibration that matches
    the actuator and window, the estimate is a refusal."""
    settings: SearchSettings
    """Settings of the search."""
    force: bool = False
    """Whether to accept the calibration of a different unit, which is then stated in the reasons.
    """
    previous: Array | None = None
    """Faults of an earlier window, ``(8,)``, at which the search begins if ``settings.warm_start``.
    """
    knowledge: Knowledge | None = None
    """Prior knowledge of the faults in a stretch of motion; None for a test window."""
    load: float | None = None
    """Initial value of the load in a stretch, in the unit box."""
    memory: Memory = NOTHING
    """Memory of the unit's earlier tests."""

    def run(self) -> Search:
        """Yield the state after each generation, and return the result.

        For a refused window, nothing is yielded.
        """
        window, calibration = self.window, self.calibration
        if isinstance(window, Refusal):
            return self._refused(window.cause)
        if isinstance(calibration, Reason):
            return self._refused(calibration, lacks_calibration=True)
        result = yield from self._search(window, calibration)
        return (yield from self._check_scale(result, window, calibration))

    def estimate(self) -> Estimate:
        """Run the identification and return its estimate, without reporting progress."""
        search = self.run()
        while True:
            try:
                next(search)
            except StopIteration as end:
                return end.value.estimate

    def _search(self, window: Window, calibration: Calibration) -> Search:
        """Yield the generations of a search, and return its result.

        The search is repeated without the measured or remembered causes that the window
        contradicts.
        """
        spent = 0
        memory = self.memory if self.settings.fitness == DEFAULT_FITNESS else NOTHING
        premises = _Premises(window, calibration, memory, time.perf_counter())
        while True:
            result = yield from self._search_once(premises)
            spent += result.estimate.evaluations
            named = {cause.name for cause in result.estimate.causes}
            wrong = tuple(cause for cause in result.estimate.measured if cause.name in named)
            before, memory = premises.memory, premises.memory.left_by(result.estimate)
            premises = replace(premises, memory=memory)
            if not wrong and memory is before:
                result = replace(result, estimate=replace(result.estimate, evaluations=spent))
                return (yield from self._search_without_measured(result, premises))
            premises = premises.without(*wrong)

    def _search_without_measured(self, result: WindowResult, premises: _Premises) -> Search:
        """Yield the generations of searches without one measured cause each, if the fit is poor.

        The result is the first of these searches with a good and much better fit, or else the
        unchanged result. A sensor error may compensate for a wrong measurement, but it fits worse
        than a search without the measurement. Measured sensor errors are never omitted.
        """
        poor = result.estimate
        if not poor.goodness_of_fit > poor.goodness_limit:
            return result
        spent = poor.evaluations
        for cause in poor.measured:
            if CAUSE_BY_NAME[cause.name].place == SystemPart.SENSOR:
                continue
            trial = yield from self._search_once(premises.without(cause))
            spent += trial.estimate.evaluations
            goodness = trial.estimate.goodness_of_fit
            if goodness <= trial.estimate.goodness_limit and goodness < (
                _FAR_BETTER * poor.goodness_of_fit
            ):
                result = trial
                break
        return replace(result, estimate=replace(result.estimate, evaluations=spent))

    def _check_scale(
        self, result: WindowResult, window: Window, calibration: Calibration
    ) -> Search:
        """Return a refusal if a column is wrong by a factor, or else the unchanged result.

        Only a poorly explained window, or a gain of the current sensor that equals a common
        mistake, leads to a refusal. The generations of a search with a corrected current are
        yielded.
        """
        estimate = result.estimate
        parameters = calibration.parameters
        if mistaken := mistaken_amplitude(estimate.causes):
            refused = self._refused(WrongScale.of(mistaken)).estimate
            return WindowResult(replace(refused, evaluations=estimate.evaluations))
        if not estimate.goodness_of_fit > estimate.goodness_limit:
            return result
        window = _without(window, result.contradicted)
        scale = wrong_scale(window, parameters)
        if scale is None:
            return result
        if scale.columns == ("current",):
            # Faults also increase the current. A wrong scale looks like turns lost in all three
            # phases, and correcting it explains the window far better.
            lost = float(np.min(np.array(estimate.faults)[SHORT_CIRCUITS]))
            if estimate.valid and scale.factor > 1.0 and lost < 0.5 * (1.0 - 1.0 / scale.factor):
                return result
            telemetry = window.telemetry
            telemetry = replace(telemetry, current=telemetry.current / scale.factor)
            rescaled = yield from self._search(replace(window, telemetry=telemetry), calibration)
            corrected = rescaled.estimate
            if not (
                corrected.goodness_of_fit <= corrected.goodness_limit
                and corrected.goodness_of_fit < _FAR_BETTER * estimate.goodness_of_fit
            ):
                return result
            gains = [cause.value for cause in corrected.causes if cause.name == "current_gain"]
            factor = scale.factor * (1.0 + sum(gains))
            scale = ColumnError.of(scale.columns, factor, scale.reference, parameters.tau)
        refused = self._refused(WrongScale.of(scale)).estimate
        return WindowResult(replace(refused, evaluations=estimate.evaluations))

    def _search_once(self, premises: _Premises) -> Search:
        window, calibration = premises.window, premises.calibration
        settings, mismatch = self.settings, calibration.unit_mismatch(self.description)
        defect = self._defect(window, calibration, () if self.force else mismatch)
        if defect is not None:
            return self._refused(**defect._asdict())
        caveats: list[Reason] = [NotMeasured(name) for name in window.telemetry.missing]
        if mismatch:
            caveats.append(OtherUnit(mismatch, forced=True))
        optimizer_class = ALGORITHMS[settings.algorithm]
        inference = Inference(window, calibration, settings, self.knowledge, premises.memory)
        # Prior knowledge is in Cartesian coordinates.
        objective = inference.searched(
            cartesian=optimizer_class.uses_residuals or self.knowledge is not None
        )
        previous = self.previous if settings.warm_start else None
        start = objective.encode(healthy_faults() if previous is None else previous)
        # The initial load is relative to the measured load.
        if self.load is not None and not premises.contradicted:
            for number, prior in enumerate(objective.hidden_causes, start=objective.first_cause):
                if prior.name == NUISANCE:
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
            return inference.result(
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

    def _defect(
        self, window: Window, calibration: Calibration, mismatch: tuple[Difference, ...]
    ) -> _Defect | None:
        """Return the defect that prevents an estimate, or None."""
        if not self.description.is_modelled:
            return _Defect(DriveUnknown(), lacks_calibration=True)
        if failure := drive_defect(window, self.description.parameters):
            # A speed in a wrong unit may look like a standstill.
            scale = wrong_scale(window, calibration.parameters)
            if scale is not None:
                return _Defect(WrongScale.of(scale))
            return _Defect(failure, is_failure=True)
        fitness = self.settings.fitness
        if reason := calibration.shape_mismatch(window):
            return _Defect(reason, lacks_calibration=True)
        if unexcited := window.excitation_defect():
            return _Defect(unexcited)
        if not len(window.current) and fitness != DEFAULT_FITNESS:
            return _Defect(FitnessNeedsCurrent(fitness, DEFAULT_FITNESS))
        if mismatch:
            return _Defect(OtherUnit(mismatch), lacks_calibration=True)
        return None

    def _refused(
        self, reason: Reason, *, is_failure: bool = False, lacks_calibration: bool = False
    ) -> WindowResult:
        estimate = refusal(
            self.window,
            self.calibration,
            self.settings,
            reason,
            is_failure=is_failure,
            lacks_calibration=lacks_calibration,
        )
        return WindowResult(estimate)


def _without(window: Window, causes: tuple[CauseEstimate, ...]) -> Window:
    """Return a window without some of its measured causes."""
    measured = tuple(cause for cause in window.measured if cause not in causes)
    return replace(window, measured=measured)
