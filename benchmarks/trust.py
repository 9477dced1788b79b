"""Whether the monitor can be trusted on an actuator that nothing of it was tuned on.

    python benchmarks/trust.py [--json FILE] [--quick | --full] [--held-out]

Estimates faults of foreign actuators (`foreign`), each calibrated on its own twelve healthy
windows, without and with hidden causes; then shows hidden causes alone. With ``--held-out`` the
plants have effects of other forms, which are for one run at the end: nothing may be tuned on it.
"""

from collections.abc import Mapping
from typing import Any, Final

import trust_cases
import trust_scores
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from tables import target_table
from targets import Row, all_of, at_most
from trials import Workers, command, workers
from trust_cases import HIDDEN, MAY_BE_SILENT, Condition, Kind, Task, faulty
from trust_scores import Judged

MEDIAN_PERCENT: Final = 0.5
P90_PERCENT: Final = 1.2
LOAD_PERCENT: Final = 0.8
RIGHT_REFUSED: Final = 0.02
WRONG_AND_CONFIDENT: Final = 1e-3
COVERAGE: Final = (0.85, 0.95)
CLAIMED: Final = 0.01
NAMED: Final = 0.95


def conditions(sizes: Mapping[str, int], foreign: Kind) -> list[Condition]:
    """Return the conditions in which faults are estimated."""
    p, n, m = (sizes[name] for name in ("plants", "faulty", "varied"))
    mixed, load = trust_cases.mixed_causes, trust_cases.load
    chosen: list[tuple[str, Kind, int, Mapping[str, Any]]] = [
        ("foreign, faults alone", foreign, n, {}),
        ("foreign, with causes", foreign, n, {"causes": mixed}),
        ("foreign, with load", foreign, m, {"causes": load}),
        ("foreign, drive as described", "exact drive", m, {}),
        ("own, faults alone", "own", m, {}),
        ("own, with causes", "own", n, {"causes": mixed}),
        ("own, with load", "own", m, {"causes": load}),
    ]
    ways: dict[str, Mapping[str, Any]] = {
        "small chirp": {"motion": "small chirp"},
        "sine": {"motion": "sine"},
        "moves": {"motion": "move"},
        "any moves, calibrated on the chirp": {"motion": "moves", "calibrated_on": "chirp"},
        "sine, calibrated on the chirp": {"motion": "sine", "calibrated_on": "chirp"},
        "5 kHz": {"sample_period": 2e-4},
        "20 kHz": {"sample_period": 5e-5},
    }
    for label, kind in _kinds(foreign):
        chosen.extend((f"{label}, {way}", kind, m, options) for way, options in ways.items())
    result = [
        Condition(name, faulty(kind, p, count, stream=1 + number, **options))
        for number, (name, kind, count, options) in enumerate(chosen)
    ]
    for label, kind in _kinds(foreign):
        result += [
            Condition(
                f"{label}, sine, friction .15, short .1", trust_cases.sine_faults(kind, p, m)
            ),
            Condition(f"{label}, two phases shorted", trust_cases.two_shorts(kind, p, m)),
        ]
    return result


def measure(progress: Progress, *, held_out: bool, **sizes: int) -> dict[str, Any]:
    """Print how far estimates on foreign plants can be trusted; --held-out: for one run, last."""
    foreign: Kind = "held out" if held_out else "foreign"
    faults = conditions(sizes, foreign)
    alone = [
        Condition(
            f"{label}, {name}", trust_cases.hidden(kind, sizes["plants"], name, sizes["hidden"])
        )
        for label, kind in _kinds(foreign)
        for name in HIDDEN
    ]
    with workers(progress) as pool:
        calibrations = _calibrations(pool, [*faults, *alone])
        cold, warm = _estimates(pool, "faults", faults, calibrations, with_warm=True)
        healthy, _ = _estimates(pool, "hidden causes", alone, calibrations, with_warm=False)
    return {
        "kind": foreign,
        "sizes": sizes,
        "cold": {name: trust_scores.accuracy(found) for name, found in cold.items()},
        "warm": {name: trust_scores.accuracy(found) for name, found in warm.items()},
        "hidden": {
            name: trust_scores.hidden(found, HIDDEN[name.split(", ", 1)[1]])
            for name, found in healthy.items()
        },
    }


def _kinds(foreign: Kind) -> tuple[tuple[str, Kind], ...]:
    return ("foreign", foreign), ("own", "own")


def _unit_of(task: Task) -> tuple[Any, ...]:
    return task.unit, task.calibrated_on, task.sample_period


def _calibrations(pool: Workers, chosen: list[Condition]) -> dict[tuple[Any, ...], Any]:
    tasks = {_unit_of(task): task for condition in chosen for task in condition.tasks}
    found = pool.map("calibrations", trust_scores.calibrations, list(tasks.values()))
    return dict(zip(tasks, found, strict=True))


def _estimates(
    pool: Workers,
    what: str,
    chosen: list[Condition],
    calibrations: dict[tuple[Any, ...], Any],
    *,
    with_warm: bool,
) -> tuple[dict[str, list[Judged]], dict[str, list[Judged]]]:
    """Return the cold and the warm estimates of each condition."""
    work = [
        (task, calibrations[_unit_of(task)], with_warm)
        for condition in chosen
        for task in condition.tasks
    ]
    found = iter(pool.map(what, trust_scores.judged, work))
    cold: dict[str, list[Judged]] = {}
    warm: dict[str, list[Judged]] = {}
    for condition in chosen:
        rows = [next(found) for _ in condition.tasks]
        cold[condition.name] = [row[0] for row in rows]
        warm[condition.name] = [row[-1] for row in rows] if with_warm else []
    return cold, warm


def rows(figures: dict[str, Any]) -> list[Row]:
    """Return the rows of the targets."""
    cold, warm = figures["cold"], figures["warm"]
    result = []
    for name in ("foreign, faults alone", "foreign, with causes", "own, with causes"):
        one = cold[name]
        result += [
            at_most(f"{name}, median [%]", one["median"], MEDIAN_PERCENT),
            at_most("  90th percentile [%]", one["p90"], P90_PERCENT),
            _share_row("  right ones refused", one["right_refused"], RIGHT_REFUSED, one["right"]),
        ]
    result += [
        at_most(
            f"{kind}, with load, median [%]", cold[f"{kind}, with load"]["median"], LOAD_PERCENT
        )
        for kind in ("foreign", "own")
    ]
    for start, by_name in (("cold", cold), ("warm", warm)):
        windows = sum(one["windows"] for one in by_name.values())
        wrong = sum(one["wrong_and_confident"] * one["windows"] for one in by_name.values())
        result.append(
            _share_row(
                f"wrong and confident, {len(by_name)} conditions, {start}",
                wrong / windows,
                WRONG_AND_CONFIDENT,
                windows,
            )
        )
        judged = {name: one for name, one in by_name.items() if one["coverage"] == one["coverage"]}
        worst = max(judged, key=lambda name: abs(judged[name]["coverage"] - 0.9), default="")
        low, high = COVERAGE
        inside = [low <= one["coverage"] <= high for one in judged.values()]
        result.append(
            Row(
                f"  90 % interval covers, each condition, {start} [%]",
                f"{100 * low:.0f} to {100 * high:.0f}",
                f"{sum(inside)} of {len(by_name)}; {100 * judged[worst]['coverage']:.0f} ({worst})"
                if judged
                else "none",
                len(inside) == len(by_name) and all(inside),
            )
        )
    alone = figures["hidden"]
    worst = max(alone, key=lambda name: alone[name]["claimed"])
    causes = {name: name.split(", ", 1)[1] for name in alone}
    return [
        *result,
        all_of(
            "hidden causes alone: rows with faults claimed in 1 % at most",
            [one["claimed"] <= CLAIMED for one in alone.values()],
            f"{100.0 * alone[worst]['claimed']:.0f} % ({worst})",
        ),
        all_of(
            "  rows with the cause named in 95 %",
            [alone[name]["named"] >= NAMED for name in alone if causes[name] not in MAY_BE_SILENT],
        ),
    ]


def show(console: Console, figures: dict[str, Any]) -> None:
    """Print the tables."""
    title = "trust"
    if figures["kind"] == "held out":
        title = "trust, HELD-OUT EFFECTS: for one run at the end, not to be tuned on"
    console.print(target_table(title, rows(figures), beside=""))
    for start in ("cold", "warm"):
        console.print(_fault_table(figures[start], start))
    console.print(_coverage_table(figures["cold"]))
    console.print(_hidden_table(figures["hidden"]))


def _fault_table(by_name: dict[str, Any], start: str) -> Table:
    table = Table(
        "condition",
        "win-\ndows",
        "median\n%",
        "90 %\n%",
        "worst\n%",
        "valid",
        "degra-\nded",
        "re-\nfused",
        "right ones\nrefused %",
        "wrong and\nconfident %",
        "interval\ncovers %",
        "time\ns",
        title=f"faults, {start} start",
    )
    for name, one in by_name.items():
        table.add_row(
            name,
            str(one["windows"]),
            *(_text(one[key], 2) for key in ("median", "p90", "max")),
            *(str(count) for count in one["verdicts"].values()),
            *(
                _text(100.0 * one[key], 1)
                for key in ("right_refused", "wrong_and_confident", "coverage")
            ),
            f"{one['seconds_median']:.3f}",
        )
    return table


def _coverage_table(by_name: dict[str, Any]) -> Table:
    names = list(next(iter(by_name.values()))["coverage_by_component"])
    table = Table(
        "90 % interval covers %", *(name.replace("_", "\n") for name in names), "worst\nunit"
    )
    for name, one in by_name.items():
        shares = [one["coverage_by_component"][component] for component in names]
        shares.append(min(one["coverage_by_unit"].values(), default=float("nan")))
        table.add_row(name, *(_text(100.0 * share, 0) for share in shares))
    return table


def _hidden_table(by_name: dict[str, Any]) -> Table:
    table = Table(
        "hidden cause alone",
        "win-\ndows",
        "valid",
        "degra-\nded",
        "re-\nfused",
        "fault\nclaimed %",
        "cause\nnamed %",
        "goodness\nof fit",
        "claimed",
    )
    for name, one in by_name.items():
        claims = ", ".join(
            f"{fault.replace('_', ' ')} {count}" for fault, count in one["claims"].items()
        )
        table.add_row(
            name,
            str(one["windows"]),
            *(str(count) for count in one["verdicts"].values()),
            f"{100.0 * one['claimed']:.0f}",
            f"{100.0 * one['named']:.0f}",
            f"{one['goodness_of_fit']:.1f}",
            f"{claims}; median {one['largest_claimed_median']:.3f}" if claims else "",
        )
    return table


def _text(value: float, digits: int) -> str:
    return "" if value != value else f"{value:.{digits}f}"


def _share_row(what: str, share: float, limit: float, of: int) -> Row:
    return at_most(f"{what} [%]", 100.0 * share, 100.0 * limit, f"{100.0 * share:.2f} of {of}")


main = command(
    measure,
    show,
    quick={"plants": 5, "faulty": 30, "varied": 10, "hidden": 5},
    # 10,000 windows with faults, as the targets ask.
    full={"plants": 12, "faulty": 1200, "varied": 400, "hidden": 100},
    plants=10,
    faulty=120,
    varied=30,
    hidden=15,
    held_out=False,
)

if __name__ == "__main__":
    main()
