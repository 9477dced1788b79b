"""Identification: from a window of telemetry to the faults that explain it."""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_monitor.calibration import Calibration
from ema_monitor.conclusion import Conclusion
from ema_monitor.estimate import Estimate, Settings, refusal
from ema_monitor.objective import Objective
from ema_monitor.optimizers import ALGORITHMS
from ema_monitor.optimizers.driver import minimise
from ema_monitor.optimizers.interface import Hints
from ema_monitor.window import Window


@dataclass(frozen=True, eq=False)
class Generation:
    """Where an identification stands after a generation."""

    generation: int
    evaluations: int
    fitness: float
    faults: NDArray[np.float64]


class Identification:
    """One identification: iterate over its generations, then read ``estimate``.

    Parameters
    ----------
    window
        The window to be diagnosed.
    description
        The actuator it was taken from.
    calibration
        Calibration of the model. If it does not belong to that actuator or to the window's
        command, the estimate is refused.
    settings
        How to identify.
    force
        Make an estimate all the same; it says so in its reason.
    previous
        Faults found in an earlier window, ``(8,)``: the search begins there.
    """

    def __init__(
        self,
        window: Window,
        description: ActuatorDescription,
        calibration: Calibration,
        settings: Settings,
        *,
        force: bool = False,
        previous: ArrayLike | None = None,
    ) -> None:
        self._window = window
        self._description = description
        self._force = force
        self._calibration = calibration
        self._settings = settings
        self._previous = None if previous is None else fault_vector(previous)
        self.estimate: Estimate | None = None

    def __iter__(self) -> Iterator[Generation]:
        """Yield the progress after each generation."""
        started = time.perf_counter()
        refused, caveats = self._objections()
        if refused:
            self.estimate = self._refuse(refused)
            return
        settings = self._settings
        optimizer_class = ALGORITHMS[settings.algorithm]
        objective = Objective(
            self._window,
            self._calibration,
            settings.fitness,
            cartesian=optimizer_class.uses_residuals,
        )
        warm = self._previous is not None
        start = objective.healthy if self._previous is None else objective.encode(self._previous)
        conclusion = Conclusion(self._window, self._calibration, settings)
        budget = settings.termination.budget - conclusion.most_evaluations
        optimizer = optimizer_class(
            start, np.random.default_rng(settings.seed), Hints(objective.good_cost, budget)
        )
        progress = None
        for progress in minimise(
            objective.residuals,
            optimizer,
            settings.termination,
            reserve=conclusion.most_evaluations,
        ):
            faults, _ = objective.decode(progress.point[None])
            yield Generation(progress.generation, progress.evaluations, progress.cost, faults[0])
        if progress is None or not np.isfinite(progress.cost):
            self.estimate = self._refuse("no fault vector gave a finite cost")
            return
        faults, play = objective.decode(progress.point[None])
        if optimizer_class.uses_residuals and not optimizer.converged:
            caveats.append("the search was stopped before it converged")
        try:
            self.estimate = conclusion.draw(
                faults[0], float(play[0]), progress.evaluations, caveats, started, warm_start=warm
            )
        except np.linalg.LinAlgError as error:
            self.estimate = self._refuse(f"the uncertainty cannot be computed: {error}")

    def _objections(self) -> tuple[str, list[str]]:
        """Return why no estimate can be made, and what an estimate must be read with."""
        calibration, window = self._calibration, self._window
        if reason := calibration.shape_mismatch(window) or window.excitation_defect():
            return reason, []
        doubts = [
            calibration.unit_mismatch(self._description),
            calibration.command_mismatch(window),
        ]
        doubts = [doubt for doubt in doubts if doubt]
        if doubts and not self._force:
            return "the calibration does not fit: " + "; ".join(doubts), []
        return "", [f"forced although {doubt}" for doubt in doubts]

    def _refuse(self, reason: str) -> Estimate:
        return refusal(
            self._window.start_ns,
            self._window.end_ns,
            self._settings,
            self._calibration.calibration_id,
            reason,
            self._window.excitation,
            self._calibration.windows,
        )


def identify(
    window: Window,
    description: ActuatorDescription,
    calibration: Calibration,
    settings: Settings | None = None,
    *,
    force: bool = False,
    previous: ArrayLike | None = None,
) -> Estimate:
    """Identify the faults in a window, without progress.

    Parameters
    ----------
    window, description, calibration, settings, force, previous
        As of ``Identification``.
    """
    identification = Identification(
        window,
        description,
        calibration,
        settings or Settings(),
        force=force,
        previous=previous,
    )
    for _ in identification:
        pass
    if identification.estimate is None:
        raise RuntimeError("the identification ended without an estimate")
    return identification.estimate
