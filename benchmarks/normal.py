"""How often a unit's own normal departs without cause, and with one that nobody named (M47).

    python benchmarks/normal.py [--json FILE] [--healthy N] [--each N]

Under the thesis's chirp, of the simulator's own actuator and of foreign ones held out: healthy
tests beyond the twelve that each normal is learned from, and the hidden causes of trust.py.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np
from plants import HIDDEN, Kind, Task, Unit, dealt, hidden
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, at_least, at_most, grid

from ema_monitor.normal.features import figures_of, mean_of
from ema_monitor.normal.normal import DEPARTED, HealthyTest, Normal

KINDS: Final[tuple[Kind, ...]] = ("own", "held out")
PLANTS: Final = 6
MOST_ALARMS: Final = 1e-3
FOUND: Final = 0.95
FAILURES: Final = ("open phase A", "dead switch", "jam", "load by position 50 N.m/rad")
"""What no fault describes; the other rows are small changes, down to what nobody would act on."""

_STREAM: Final = 9_100


def test_of(task: Task) -> HealthyTest | str:
    """Return the figures of a window, or why it has none."""
    try:
        parts = figures_of(task.window().telemetry)
    except (RuntimeError, ValueError) as error:
        return str(error)
    return HealthyTest(0, mean_of(parts)) if parts else "no stroke in each direction"


def normal_of(unit: Unit) -> Normal:
    """Return what is normal for a unit, by its healthy windows."""
    tests = [test_of(task) for task in Task(unit, ()).healthy()]
    return Normal([one for one in tests if not isinstance(one, str)])


def measure(pool: Workers, healthy: int, each: int) -> Figures:
    """Print departures of healthy tests of each kind of unit, and of tests of each hidden cause."""
    figures: Figures = {}
    for kind in KINDS:
        tasks = {name: hidden(kind, PLANTS, name, each) for name in HIDDEN}
        later = [Task(unit, (_STREAM, unit.number, i)) for i, unit in dealt(kind, PLANTS, healthy)]
        units = list(dict.fromkeys(unit for _, unit in dealt(kind, PLANTS, PLANTS)))
        normals = dict(zip(units, pool.map(f"{kind}: normals", normal_of, units), strict=True))
        figures[kind] = {
            name: [
                # One that shows no motion is as no healthy one.
                0.0 if isinstance(test, str) else normals[task.unit].departure(test).probability
                for task, test in zip(some, pool.map(f"{kind}: {name}", test_of, some), strict=True)
            ]
            for name, some in {"healthy": later, **tasks}.items()
        }
    return figures


def rows(figures: Figures) -> Iterator[Row]:
    """Return the rows of the targets."""
    for kind, by_name in figures.items():
        healthy = np.array(by_name["healthy"])
        alarms = 1000.0 * float(np.mean(healthy < DEPARTED))
        what = f"{kind}: departures of {len(healthy)} healthy tests, in 1000"
        yield at_most(what, alarms, 1000.0 * MOST_ALARMS)
        failed = np.concatenate([by_name[name] for name in FAILURES]) < DEPARTED
        what = f"{kind}: {', '.join(FAILURES)} depart [%]"
        yield at_least(what, 100.0 * float(np.mean(failed)), 100.0 * FOUND)


def tables(figures: Figures) -> Iterator[Table]:
    """Return what is printed below the targets."""
    yield grid(
        "tests that depart",
        ("on a healthy actuator", *figures),
        (
            (
                name,
                *(
                    f"{sum(one < DEPARTED for one in by_name[name])} of {len(by_name[name])}"
                    for by_name in figures.values()
                ),
            )
            for name in ("healthy", *HIDDEN)
        ),
    )


main = command(measure, "a unit's own normal", rows, tables, width=110, healthy=1000, each=12)

if __name__ == "__main__":
    main()
