# SPDX-License-Identifier: Apache-2.0
"""Identification of a window with several algorithms from the same starting point."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import click
import numpy as np
from numpy.typing import NDArray

from ema_cli.bags.identifying import Identifying
from ema_cli.processes.stop_request import deferred_signals
from ema_cli.progress import progress_bar
from ema_core.faults import estimation_error
from ema_core.wording import counted
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.diagnosis import Identification
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.objective import Objective
from ema_monitor.model.monitor_model import compile_kernels
from ema_monitor.recordings.windows import BagWindows, RecordedWindow
from ema_monitor.windows.window import Window


@dataclass(frozen=True, eq=False)
class ComparedRun:
    """Result of an algorithm for a window."""

    estimate: Estimate
    evaluations: list[int]
    """Cumulative number of simulated windows at the end of each generation."""
    costs: list[float]
    """Lowest cost so far at the end of each generation [A^2.s]."""

    @property
    def search_fitness(self) -> float:
        """Cost at the end of the search, before refinement [A^2.s]; NaN without a search."""
        return self.costs[-1] if self.costs else float("nan")


@dataclass(frozen=True, eq=False)
class AlgorithmComparison:
    """Results of several algorithms for one window."""

    recorded: RecordedWindow
    runs: list[ComparedRun]
    """Results of the algorithms, in the requested order."""
    truth: NDArray[np.float64] | None = None
    """True faults of the window, ``(8,)``; None if the bag does not record them."""
    fitness_at_truth: float | None = None
    """Cost at the true faults [A^2.s]; None without true faults or a model."""

    @property
    def best(self) -> ComparedRun | None:
        """Run with the lowest cost among valid runs, else all runs; None if no run has a cost."""
        fitted = [run for run in self.runs if np.isfinite(run.estimate.fitness)]
        return min(
            fitted, key=lambda run: (not run.estimate.valid, run.estimate.fitness), default=None
        )

    def error_percent(self, run: ComparedRun) -> float:
        """Return the error of a run's estimate in percent of the fault ranges; NaN if unknown."""
        if self.truth is None:
            return float("nan")
        return estimation_error(run.estimate.faults, self.truth)


def choose_window(bag_windows: BagWindows, number: int | None) -> RecordedWindow:
    """Return the window with a number; None selects the first usable window, else the first.

    Raises
    ------
    ValueError
        If the bag has no window with this number.
    """
    if number is not None:
        if number >= len(bag_windows.windows):
            windows = counted(len(bag_windows.windows), "window")
            raise ValueError(f"--window {number}: the bag has {windows}, numbered from 0")
        return bag_windows.windows[number]
    for window in bag_windows.windows:
        content = window.window
        if isinstance(content, Window) and not content.excitation_defect():
            return window
    return bag_windows.windows[0]


def compare_algorithms(
    recorded: RecordedWindow,
    algorithms: Sequence[str],
    calibration: Calibration,
    options: Identifying,
    truth: NDArray[np.float64] | None,
) -> AlgorithmComparison:
    """Identify a window with each algorithm from the healthy fault vector, with a progress bar."""
    window = recorded.window
    with deferred_signals() as stop, progress_bar() as progress:
        # Compile first, so that the computing time of the first algorithm excludes compilation.
        compile_kernels([calibration.form])
        runs = []
        for algorithm in algorithms:
            search = replace(options.search, algorithm=algorithm, warm_start=False)
            run = Identification(
                window, recorded.description, calibration, search, force=options.accept_defects
            )
            task = progress.add_task(algorithm, total=search.budget)
            evaluations, costs = [], []
            try:
                for state in run:
                    if stop:
                        raise click.Abort
                    evaluations.append(state.evaluations)
                    costs.append(state.fitness)
                    progress.update(
                        task,
                        completed=state.evaluations,
                        state=f"generation {state.generation}: {state.fitness:.5f}",
                    )
            except ValueError as error:
                raise ValueError(f"{algorithm}: {error}") from error
            if run.estimate is not None:
                runs.append(ComparedRun(run.estimate, evaluations, costs))
            progress.update(task, completed=search.budget)
        comparison = AlgorithmComparison(recorded, runs, truth)
        best = comparison.best
        if truth is not None and best is not None and isinstance(window, Window):
            objective = Objective(window, calibration, options.search.fitness)
            point = objective.encode(truth, best.estimate.play_offset)
            at_truth = float(np.sum(objective.residuals(point[None]) ** 2))
            comparison = replace(comparison, fitness_at_truth=at_truth)
        if stop:
            raise click.Abort
    return comparison
