# SPDX-License-Identifier: Apache-2.0
"""Departures of test windows from the healthy windows of their unit, by cause and by day (M47).

    python benchmarks/departures.py [--json FILE] [--healthy N] [--each N]

Windows under the thesis's chirp of the simulator's own actuator and of held-out foreign actuators.
They are healthy, in addition to the twelve healthy windows of each baseline, or have the hidden
causes of trust.py. Each window is judged on the day of the healthy windows, and as if recorded 30
days later.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np
from plants import HIDDEN, Kind, Task, Unit, dealt, hidden
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, at_least, at_most, grid

from ema_core.telemetry import Telemetry
from ema_monitor.joint.record import NS_A_DAY
from ema_monitor.joint.single import SIGNIFICANCE
from ema_monitor.joint.window_baseline import WindowBaseline
from ema_monitor.joint.window_figures import WindowFigures, figures_of

KINDS: Final[tuple[Kind, ...]] = ("own", "held out")
DAYS: Final = {"same day": 0, "30 days later": 30}
PLANTS: Final = 6
MOST_ALARMS: Final = 1e-3
FOUND: Final = 0.95
FAILURES: Final = ("open phase A", "dead switch", "jam")
"""Failures that are not in the fault model. They must depart on any day."""
SAME_DAY: Final = (*FAILURES, "load by position 50 N.m/rad")
"""Causes that must depart on the day of the healthy windows; the other causes are smaller."""

_STREAM: Final = 9_100


def telemetry_of(task: Task) -> Telemetry | None:
    """Return the telemetry of a task's window, or None if the task has no window."""
    try:
        return task.window().telemetry
    except (RuntimeError, ValueError):
        return None


def test_of(task: Task) -> list[WindowFigures]:
    """Return the figures of a task's window.

    The list is empty without a window, or if the window lacks a stroke in each direction.
    """
    telemetry = telemetry_of(task)
    return [] if telemetry is None else figures_of(telemetry)


def baseline_of(unit: Unit) -> WindowBaseline:
    """Return the baseline of a unit's healthy windows."""
    telemetry = map(telemetry_of, Task(unit, ()).healthy())
    return WindowBaseline.of(block for block in telemetry if block is not None)


def probabilities_of(baseline: WindowBaseline, figures: list[WindowFigures]) -> list[float]:
    """Return the probability that a healthy unit departs as far, on each of ``DAYS``.

    It is 0 without figures, and 1 if the baseline cannot judge them.
    """
    if not figures:
        return [0.0] * len(DAYS)  # A window without motion differs from all healthy windows.
    departures = (baseline.departure(day * NS_A_DAY, figures) for day in DAYS.values())
    return [1.0 if departure is None else departure.probability for departure in departures]


def measure(pool: Workers, healthy: int, each: int) -> Figures:
    """Measure the departures of healthy windows and of each hidden cause, by kind of unit."""
    figures: Figures = {}
    for kind in KINDS:
        tasks = {name: hidden(kind, PLANTS, name, each) for name in HIDDEN}
        later = [Task(unit, (_STREAM, unit.number, i)) for i, unit in dealt(kind, PLANTS, healthy)]
        units = list(dict.fromkeys(unit for _, unit in dealt(kind, PLANTS, PLANTS)))
        made = pool.map(f"{kind}: baselines", baseline_of, units)
        baselines = dict(zip(units, made, strict=True))
        figures[kind] = {
            name: [
                probabilities_of(baselines[task.unit], test)
                for task, test in zip(
                    chosen, pool.map(f"{kind}: {name}", test_of, chosen), strict=True
                )
            ]
            for name, chosen in {"healthy": later, **tasks}.items()
        }
    return figures


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    for kind, by_name in figures.items():
        for number, day in enumerate(DAYS):
            healthy = np.array(by_name["healthy"])[:, number]
            alarms = 1000.0 * float(np.mean(healthy < SIGNIFICANCE))
            what = f"{kind}, {day}: departures of {len(healthy)} healthy windows, in 1000"
            yield at_most(what, alarms, 1000.0 * MOST_ALARMS)
            wanted = FAILURES if number else SAME_DAY
            failed = np.concatenate([by_name[name] for name in wanted])[:, number] < SIGNIFICANCE
            what = f"{kind}, {day}: {', '.join(wanted)} depart [%]"
            yield at_least(what, 100.0 * float(np.mean(failed)), 100.0 * FOUND)


def tables(figures: Figures) -> Iterator[Table]:
    """Yield the tables to print below the targets."""
    for number, day in enumerate(DAYS):
        yield grid(
            f"windows that depart, {day}",
            ("on a healthy actuator", *figures),
            (
                (
                    name,
                    *(
                        f"{sum(entry[number] < SIGNIFICANCE for entry in by_name[name])} of "
                        f"{len(by_name[name])}"
                        for by_name in figures.values()
                    ),
                )
                for name in ("healthy", *HIDDEN)
            ),
        )


main = command(measure, "departures from healthy windows", rows, tables, healthy=1000, each=12)

if __name__ == "__main__":
    main()
