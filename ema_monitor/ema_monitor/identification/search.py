"""Identification: from a window, or its refusal, to the estimate of the faults."""

import time
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.causes import CauseEstimate
from ema_core.description import ActuatorDescription
from ema_core.faults import SHORT_CIRCUITS, fault_vector, healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.defects import drive_defect
from ema_monitor.identification.estimate import Estimate, refusal
from ema_monitor.identification.fitness import DEFAULT_FITNESS
from ema_monitor.identification.inference import Inference
from ema_monitor.identification.knowledge import NOTHING_KNOWN, Before, Knowledge
from ema_monitor.identification.objective import Objective
from ema_monitor.identification.scales import wrong_scale
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identification.verdict import Misfit, contradicted_by
from ema_monitor.optimizers import ALGORITHMS
from ema_monitor.optimizers.driver import minimise
from ema_monitor.optimizers.interface import Hints
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

_FAR_BETTER = 0.4


@dataclass(frozen=True, eq=False)
class Generation:
    """State of an identification after a generation."""

    generation: int
    evaluations: int
    fitness: float
    faults: NDArray[np.float64]


class ModelIdentification:
    """One identification by a model: iterate over its generations, then read ``estimate``.

    Parameters
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
    before
        What is known before the window; nothing by default.

    Attributes
    ----------
    estimate
        The estimate; None before the iteration has ended.
    knowledge
        What is known of the faults after the window, if there are nuisances and it has an estimate.
    surprise
        Squared distance of the window from what was known before it.
    misfit
        What the estimate misses of the window; None without an estimate.
    contradicted
        What was measured and not used, as the window contradicts it.
    caveats
        Further reservations about the search.
    unlearned
        Which faults are uncertain for what the calibration could not learn, in words.
    """

    def __init__(
        self,
        window: Window | Refusal,
        description: ActuatorDescription,
        calibration: Calibration | str,
        settings: SearchSettings,
        *,
        force: bool = False,
        previous: ArrayLike | None = None,
        before: Before = NOTHING_KNOWN,
    ) -> None:
        self._window = window
        self._description = description
        self._force = force
        self._calibration = calibration
        self._settings = settings
        faults = None if previous is None else fault_vector(previous)
        self._previous = faults if settings.warm_start else None
        self._before = before
        self.estimate: Estimate | None = None
        self.knowledge: Knowledge | None = None
        self.misfit: Misfit | None = None
        self.surprise = 0.0
        self.contradicted: list[CauseEstimate] = []
        self.caveats: list[str] = []
        self.unlearned: list[str] = []
        self._is_rescaled = False

    def __iter__(self) -> Iterator[Generation]:
        """Yield the state after each generation; there is none where a window is refused."""
        if isinstance(self._window, Refusal):
            self.estimate = self._refuse(self._window.reason)
        elif isinstance(self._calibration, str):
            self.estimate = self._refuse(self._calibration)
        elif self._description.drive == "unknown":
            self.estimate = self._refuse(
                "drive = unknown, and the calibration is of a drive that is known; calibrate on "
                "healthy motion of this unit"
            )
        else:
            yield from self._search(self._window, self._calibration)

    def _search(self, window: Window, calibration: Calibration) -> Iterator[Generation]:
        """Search, and again without what was measured and the window contradicts."""
        started, spent = time.perf_counter(), 0
        while True:
            yield from self._search_once(window, calibration, started)
            if self.estimate is None:
                raise RuntimeError("the search ended without an estimate")
            self.estimate = replace(self.estimate, evaluations=spent + self.estimate.evaluations)
            spent = self.estimate.evaluations
            named = {cause.name for cause in self.estimate.causes}
            wrong = [one for one in self.estimate.measured if one.name in named]
            if not wrong:
                yield from self._question_scale(window, calibration)
                return
            self.contradicted += wrong
            left = tuple(one for one in window.measured if one not in wrong)
            window = replace(window, measured=left)

    def _question_scale(self, window: Window, calibration: Calibration) -> Iterator[Generation]:
        """Refuse a window that the faults do not explain, where a column is off by a factor."""
        found = self.estimate
        if found is None or self._is_rescaled or not found.goodness_of_fit > found.goodness_limit:
            return
        scale = wrong_scale(window, calibration.parameters)
        if scale is None:
            return
        if scale.column == "current":
            # Faults take more current, too. A scale looks like turns lost in all three phases, and
            # explains the window by far better.
            lost = float(np.min(np.array(found.faults)[SHORT_CIRCUITS]))
            if found.valid and scale.factor > 1.0 and lost < 0.5 * (1.0 - 1.0 / scale.factor):
                return
            telemetry = window.telemetry
            telemetry = replace(telemetry, current=telemetry.current / scale.factor)
            run = copy(self)
            run._window, run._is_rescaled = replace(window, telemetry=telemetry), True
            run.contradicted = []
            yield from run
            other = run.estimate
            if other is None or not (
                other.goodness_of_fit <= other.goodness_limit
                and other.goodness_of_fit < _FAR_BETTER * found.goodness_of_fit
            ):
                return
            gains = [one.value for one in other.causes if one.name == "current_gain"]
            scale = scale._replace(factor=scale.factor * (1.0 + sum(gains)))
        refused = self._refuse(scale.in_words(calibration.parameters))
        self.estimate = replace(refused, evaluations=found.evaluations)
        self.knowledge = self.misfit = None

    def _search_once(
        self, window: Window, calibration: Calibration, started: float
    ) -> Iterator[Generation]:
        if failure := drive_defect(window, self._description.parameters):
            # A speed in another unit is none that stands still.
            scale = wrong_scale(window, calibration.parameters)
            if scale is not None:
                failure = scale.in_words(calibration.parameters)
            self.estimate = self._refuse(failure, is_failure=scale is None)
            return
        refused, self.caveats = self._mismatches(window, calibration)
        if refused:
            self.estimate = self._refuse(refused)
            return
        settings = self._settings
        optimizer_class = ALGORITHMS[settings.algorithm]
        causes = ()
        if settings.fitness == DEFAULT_FITNESS:
            causes = self._before.causes(calibration.parameters, window)
        objective = Objective(
            window,
            calibration,
            settings.fitness,
            # What is known already is known in Cartesian coordinates.
            cartesian=optimizer_class.uses_residuals or self._before.known is not None,
            causes=causes,
            known=self._before.known,
        )
        warm = self._previous is not None
        start = objective.encode(healthy_faults() if self._previous is None else self._previous)
        # The place where they begin is relative to what was measured of them.
        begin = (
            {}
            if self.contradicted
            else dict(zip(self._before.nuisances, self._before.start, strict=False))
        )
        for number, one in enumerate(causes, start=-len(causes)):
            start[number] = begin.get(one.name, start[number])
        inference = Inference(window, calibration, settings, self._before)
        termination = settings.termination
        fair_cost, before = objective.fair_cost(), objective.evaluations
        reserve = inference.most_evaluations + before
        hints = Hints(objective.good_cost, fair_cost, termination.budget - reserve)
        optimizer = optimizer_class(start, np.random.default_rng(settings.seed), hints)
        progress = None
        for progress in minimise(
            objective.residuals,
            optimizer,
            termination,
            reserve=reserve,
        ):
            faults, _ = objective.decode(progress.point[None])
            yield Generation(
                progress.generation, before + progress.evaluations, progress.cost, faults[0]
            )
        if progress is None or not np.isfinite(progress.cost):
            self.estimate = self._refuse("no fault vector gave a finite cost")
            return
        faults, play = objective.decode(progress.point[None])
        if optimizer_class.uses_residuals and not optimizer.converged:
            self.caveats.append("the search was stopped before it converged")
        contradictions = contradicted_by(self._before.subject, self.contradicted)
        try:
            self.estimate = inference.estimate(
                faults[0],
                float(play[0]),
                before + progress.evaluations,
                [*contradictions, *self.caveats],
                started,
                warm_start=warm,
                fitted=progress.point[objective.dimension - len(causes) :],
            )
            self.knowledge, self.surprise = inference.knowledge, inference.surprise
            self.misfit, self.unlearned = inference.misfit, inference.unlearned
        except np.linalg.LinAlgError as error:
            self.estimate = self._refuse(f"the uncertainty cannot be computed: {error}")

    def _mismatches(self, window: Window, calibration: Calibration) -> tuple[str, list[str]]:
        """Return why no estimate can be made, and reservations about one that can."""
        if reason := calibration.shape_mismatch(window) or window.excitation_defect():
            return reason, []
        if not len(window.current) and self._settings.fitness != DEFAULT_FITNESS:
            return (
                f"the current is not measured: fitness {self._settings.fitness} compares currents "
                f"only, use {DEFAULT_FITNESS}",
                [],
            )
        mismatch = calibration.unit_mismatch(self._description)
        if mismatch and not self._force:
            return f"the calibration does not fit: {mismatch}", []
        caveats = [f"forced although {mismatch}"] if mismatch else []
        return "", [*_consequences(window), *caveats]

    def _refuse(self, reason: str, *, is_failure: bool = False) -> Estimate:
        window, calibration = self._window, self._calibration
        return refusal(window, calibration, self._settings, reason, is_failure=is_failure)


def _consequences(window: Window) -> list[str]:
    """Return in words what it means that columns are not measured."""
    meanings = {
        "current": "the current is not measured: what the speed does not show is not known",
        "speed": "the speed is not measured: that of the shaft behind the play, by the position, "
        "takes its place",
    }
    return [meanings[name] for name in window.telemetry.missing]
