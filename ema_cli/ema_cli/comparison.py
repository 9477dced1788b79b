"""One window identified by several algorithms, each from the same start."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import click
import numpy as np
from numpy.typing import NDArray

from ema_cli.identification_options import IdentificationOptions
from ema_cli.processes.interrupt import deferred_interrupt
from ema_cli.show.progress import progress_bar
from ema_core.faults import estimation_error
from ema_core.wording import counted
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.objective import Objective
from ema_monitor.identification.search import Identification
from ema_monitor.model.monitor_model import compile_kernels
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.window import Window
from ema_recording.windows import BagWindows


@dataclass(frozen=True, eq=False)
class Run:
    """What one algorithm made of the window.

    Attributes
    ----------
    estimate
        What it found.
    evaluations
        Windows of the model computed until the end of each generation.
    costs
        Best cost until then [A^2.s].
    """

    estimate: Estimate
    evaluations: list[int]
    costs: list[float]

    @property
    def algorithm(self) -> str:
        """Its registered name."""
        return self.estimate.algorithm

    @property
    def generations(self) -> int:
        """How many there were."""
        return len(self.costs)

    @property
    def search_fitness(self) -> float:
        """Cost where the search itself ended [A^2.s]; NaN when there was none."""
        return self.costs[-1] if self.costs else float("nan")


@dataclass(frozen=True, eq=False)
class Comparison:
    """What several algorithms made of one window.

    Attributes
    ----------
    found
        The window.
    runs
        One for each algorithm, in the order asked for.
    truth
        True faults of the window, ``(8,)``; None where the bag does not record them.
    fitness_at_truth
        Cost at the true faults [A^2.s]; None where they, or a model to judge them by, are missing.
    """

    found: Segment
    runs: list[Run]
    truth: NDArray[np.float64] | None = None
    fitness_at_truth: float | None = None

    @property
    def best(self) -> Run | None:
        """Run of lowest cost, a valid one if there is any; None when none has an estimate."""
        return _fittest(self.runs)

    def error_percent(self, run: Run) -> float:
        """Return the error of a run's estimate [%]; NaN without truth or estimate."""
        if self.truth is None:
            return float("nan")
        return estimation_error(run.estimate.faults, self.truth)


def choose_window(found: BagWindows, number: int | None) -> Segment:
    """Return a window by number, or the first that can be used, or the first of all.

    Parameters
    ----------
    found
        What is in a bag; at least one window was begun.
    number
        Which one, from 0; None for the first that can be used.

    Raises
    ------
    ValueError
        When there is no window of that number.
    """
    if number is not None:
        if number >= len(found.windows):
            windows = counted(len(found.windows), "window")
            raise ValueError(f"--window {number}: the bag has {windows}, numbered from 0")
        return found.windows[number].load()
    for window in found.windows:
        one = window.load()
        if isinstance(one.window, Window) and not one.window.excitation_defect():
            return one
    return found.windows[0].load()


def compare_algorithms(
    found: Segment,
    algorithms: Sequence[str],
    calibration: Calibration,
    options: IdentificationOptions,
    truth: NDArray[np.float64] | None,
    *,
    force: bool = False,
) -> Comparison:
    """Identify a window by each algorithm from the healthy point, with a progress bar.

    Parameters
    ----------
    found
        The window.
    algorithms
        Registered names.
    calibration
        Calibration of the model.
    options
        How to identify; algorithm and warm start do not count.
    truth
        True faults, ``(8,)``, if they are known.
    force
        Whether to estimate even if the calibration does not fit.

    Raises
    ------
    ValueError
        When the budget is too small for an algorithm.
    click.Abort
        On Ctrl-C.
    """
    with deferred_interrupt() as interrupted, progress_bar() as progress:
        # So that the computing time of the first algorithm is that of an estimate.
        compile_kernels([calibration.form])
        runs = []
        for algorithm in algorithms:
            search = replace(options.search, algorithm=algorithm, warm_start=False)
            run = Identification(found.window, found.description, calibration, search, force=force)
            task = progress.add_task(algorithm, total=search.budget)
            evaluations, costs = [], []
            try:
                for one in run:
                    if interrupted.is_set():
                        raise click.Abort
                    evaluations.append(one.evaluations)
                    costs.append(one.fitness)
                    progress.update(
                        task,
                        completed=one.evaluations,
                        state=f"generation {one.generation}: {one.fitness:.5f}",
                    )
            except ValueError as error:
                raise ValueError(f"{algorithm}: {error}") from error
            if run.estimate is not None:
                runs.append(Run(run.estimate, evaluations, costs))
            progress.update(task, completed=search.budget)
        best = _fittest(runs)
        at_truth = None
        if truth is not None and best is not None and isinstance(found.window, Window):
            objective = Objective(found.window, calibration, options.search.fitness)
            point = objective.encode(truth, best.estimate.play)
            at_truth = float(np.sum(objective.residuals(point[None]) ** 2))
        if interrupted.is_set():
            raise click.Abort
    return Comparison(found, runs, truth, at_truth)


def _fittest(runs: Sequence[Run]) -> Run | None:
    fitted = [run for run in runs if np.isfinite(run.estimate.fitness)]
    return min(fitted, key=lambda run: (not run.estimate.valid, run.estimate.fitness), default=None)
