"""How often a unit's own normal departs without cause, and with one that nobody named (M47).

    python benchmarks/normal.py [--json FILE] [--healthy N] [--each N]

Under the thesis's chirp, of the simulator's own actuator and of foreign ones held out: healthy
tests beyond the twelve that each normal is learned from, and the hidden causes of trust.py.
"""

from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from tables import target_table
from targets import Row, at_least, at_most
from trials import command, workers
from trust_cases import HIDDEN, Kind, Task, Unit, hidden, units

from ema_monitor.normal.features import mean_of, parts_of
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
        return HealthyTest(0, mean_of(parts_of([task.window().telemetry]))[1])
    except (RuntimeError, ValueError) as error:
        return str(error)


def measure(progress: Progress, healthy: int, each: int) -> dict[str, Any]:
    """Print departures of healthy tests of each kind of unit, and of tests of each hidden cause."""
    figures: dict[str, Any] = {"kinds": {}}
    with workers(progress) as pool:
        for kind in KINDS:
            chosen = units(kind, PLANTS)
            learned = [task for unit in chosen for task in Task(unit, ()).healthy()]
            tests = pool.map(f"{kind}: normals", test_of, learned)
            count = len(learned) // len(chosen)
            normals = {
                unit: Normal(
                    [one for one in tests[n * count :][:count] if not isinstance(one, str)]
                )
                for n, unit in enumerate(chosen)
            }
            later = [
                Task(chosen[i % len(chosen)], (_STREAM, chosen[i % len(chosen)].number, i))
                for i in range(healthy)
            ]
            found = pool.map(f"{kind}: healthy", test_of, later)
            rows = {"healthy": _probabilities(normals, later, found)}
            for name in HIDDEN:
                tasks = hidden(kind, PLANTS, name, each)
                found = pool.map(f"{kind}: {name}", test_of, tasks)
                rows[name] = _probabilities(normals, tasks, found)
            figures["kinds"][kind] = rows
    return figures


def _probabilities(
    normals: dict[Unit, Normal], tasks: list[Task], tests: list[HealthyTest | str]
) -> list[float]:
    """Return the probability of each test; 0 where it shows no motion, as no healthy one."""
    return [
        0.0 if isinstance(test, str) else normals[task.unit].departure(test).probability
        for task, test in zip(tasks, tests, strict=True)
    ]


def rows(figures: dict[str, Any]) -> list[Row]:
    """Return the rows of the targets."""
    result = []
    for kind, by_name in figures["kinds"].items():
        healthy = np.array(by_name["healthy"])
        alarms = int(np.sum(healthy < DEPARTED))
        failed = np.concatenate([by_name[name] for name in FAILURES]) < DEPARTED
        share = 100.0 * float(np.mean(failed))
        result += [
            at_most(
                f"{kind}: departures of {len(healthy)} healthy tests, in 1000",
                1000.0 * alarms / len(healthy),
                1000.0 * MOST_ALARMS,
            ),
            at_least(f"{kind}: {', '.join(FAILURES)} depart [%]", share, 100.0 * FOUND),
        ]
    return result


def show(console: Console, figures: dict[str, Any]) -> None:
    """Print the tables."""
    console.print(target_table("a unit's own normal", rows(figures), beside=""))
    kinds = figures["kinds"]
    table = Table("on a healthy actuator", *kinds, title="tests that depart")
    for name in next(iter(kinds.values())):
        cells = [np.array(by_name[name]) < DEPARTED for by_name in kinds.values()]
        table.add_row(name, *(f"{int(cell.sum())} of {len(cell)}" for cell in cells))
    console.print(table)


main = command(measure, show, 110, healthy=1000, each=12)

if __name__ == "__main__":
    main()
