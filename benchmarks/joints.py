# SPDX-License-Identifier: Apache-2.0
"""Accuracy for unknown drives: joints of other manufacturers, compared with least squares.

    python benchmarks/joints.py [--quick] [--joints A,B] [--seeds N] [--json FILE] [--folder FOLDER]

`ema calibrate` calibrates units of ``joint_plants`` on healthy records of a few days. `ema estimate
--json` judges their tests from a month later on. Least squares fits the same logs. Further tests
have a friction change of the reported smallest detectable size. `--held-out` runs the joints that
are reserved for a single run at the end. `--healthy-trials 10000` adds 10,000 healthy tests, to
measure the rate of false alarms.
"""

import json
import re
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import click
import numpy as np
import pandas as pd
from click.testing import CliRunner
from joint_plants import (
    DEVELOPMENT,
    FIRST_TEST_DAY,
    HEALTHY,
    HELD_OUT,
    JOINTS,
    Case,
    Joint,
    Unit,
    cases,
    healthy_days,
    write_truth,
)
from numpy.typing import NDArray
from rich.table import Table
from scipy.signal import savgol_filter
from scipy.stats import t as student
from script import Figures, Workers, command
from targets import Row, at_least, at_most, grid, none_of, percent, share_at_least, untargeted

from ema_cli.main import main as ema

WITHIN: Final = 0.1
WANTED_ERROR: Final = 1.0
WANTED_SMALLEST: Final = 5.0
COVER: Final = (0.85, 0.95)
MOST_ALARMS: Final = 1e-3
TRIALS_EACH: Final = 25
"""Healthy tests of a unit that serves only to count false alarms."""

NAMES: Final = {
    "friction": "friction",
    "viscous": "viscous_friction",
    "torque": "torque_per_ampere",
    "load": "load",
    "play": "play",
}
"""Quantity that changes, by kind of case."""
CONSEQUENCES: Final = ("friction_over_inertia", "tracking_lag")
"""Quantities that change with other quantities. No fault is attributed to them."""
OUTCOMES: Final = ("named", "not separated", "departed", "missed", "not judged", "wrong")

_FIRST_TRIAL: Final = 1000


@dataclass(frozen=True)
class Task:
    """A unit to calibrate on healthy records, and its tests by name."""

    unit: Unit
    records: int
    days: int
    tests: Mapping[str, Case]
    sized: int = 0
    """Number of further tests with a friction change of the reported smallest size."""
    folder: Path | None = None


class LeastSquares:
    """Least-squares fit of the effort, as a reference; alarms at 3 sigma.

    The regressors are acceleration, speed, sign of the speed, a constant and, if the joint has
    gravity, the sine of the position.
    """

    NAMES: Final = ("inertia", "viscous_friction", "friction", "load", "gravity")

    def __init__(self, joint: Joint, healthy: Sequence[Path]) -> None:
        self.joint = joint
        fits = np.array([self.fit(path) for path in healthy])
        self.mean = fits.mean(axis=0)
        self.sigma = fits.std(axis=0, ddof=1) * np.sqrt(1.0 + 1.0 / len(fits))
        self.quantile = float(student.ppf(0.95, len(fits) - 1))

    def fit(self, path: Path) -> NDArray[np.float64]:
        """Return the coefficients of a log, in the order of ``NAMES``."""
        log = pd.read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)
        q, step = log["position"].to_numpy(), 1.0 / self.joint.rate_hz
        width = max(7, int(0.03 / step) | 1)
        v = np.asarray(savgol_filter(q, width, 3, 1, step))
        if self.joint.has_speed:
            v = np.asarray(savgol_filter(log["speed"], width, 2))
        a = np.asarray(savgol_filter(q, width, 3, 2, step))
        effort = np.asarray(savgol_filter(log["effort"], width, 2))
        columns = [a, v, np.sign(v), np.ones_like(v)]
        if self.joint.gravity:
            columns.append(np.sin(q))
        moves = np.abs(v) > 0.1 * np.max(np.abs(v))
        return np.linalg.lstsq(np.column_stack(columns)[moves], effort[moves])[0]

    def judge(self, path: Path) -> Figures:
        """Return the relative change of friction with its 90 % interval, and the alarm.

        The alarm names the coefficient that deviates most, or is "" below 3 sigma.
        """
        fit = self.fit(path)
        size = np.abs(fit - self.mean) / self.sigma
        largest = int(np.argmax(size))
        friction, healthy = fit[2], self.mean[2]
        off = self.quantile * self.sigma[2]
        ends = sorted((friction + sign * off) / healthy - 1.0 for sign in (-1.0, 1.0))
        return {
            "change": friction / healthy - 1.0,
            "low": ends[0],
            "high": ends[1],
            "alarm": self.NAMES[largest] if size[largest] > 3.0 else "",
        }


def run(*arguments: str | Path) -> tuple[int, str, str, float]:
    """Run a command. Return its exit code, stdout, errors and processor time [s].

    The errors are stderr, or the exception if the command crashed.
    """
    started = time.process_time()
    done = CliRunner().invoke(ema, list(map(str, arguments)))
    spent = time.process_time() - started
    crashed = done.exception and not isinstance(done.exception, SystemExit)
    return done.exit_code, done.stdout, repr(done.exception) if crashed else done.stderr, spent


def estimated(path: Path, calibration: Path) -> Figures:
    """Return exit code, verdict, quantities and figures of `ema estimate` for a record.

    Without a comparison, verdict, quantities and figures are empty.
    """
    code, printed, errors, spent = run("estimate", path, "--calibration", calibration, "--json")
    try:
        estimates = json.loads(printed)
    except json.JSONDecodeError:
        estimates = []
    compared = next((estimate for estimate in estimates if estimate.get("comparison")), {})
    comparison = compared.get("comparison") or {"quantities": [], "figures": []}
    reason = "; ".join({estimate.get("reason", "") for estimate in estimates} - {""})
    return {
        "code": code,
        "verdict": compared.get("verdict", ""),
        "reason": reason or (errors.strip().splitlines() or [""])[-1],
        "quantities": {quantity["name"]: quantity for quantity in comparison["quantities"]},
        "figures": [entry["name"] for entry in comparison["figures"]],
        "cpu_s": spent,
    }


def judged_unit(task: Task) -> Figures:
    """Write the records of a unit, calibrate it and judge its tests. Return reports and truth."""
    unit, truth = task.unit, {}
    with ExitStack() as stack:
        folder = task.folder or Path(stack.enter_context(TemporaryDirectory()))
        folder = folder / f"{unit.name}_{unit.seed}"
        unit.write_description(folder)

        def write(name: str, day: int, number: int, case: Case) -> Path:
            record = unit.record(day, number, case)
            truth[name] = {"day": day, "dry": record.dry, **vars(case)}
            return unit.write(record, folder, name)

        healthy = [
            write(f"healthy_{i}", day, number, HEALTHY)
            for i, (day, number) in enumerate(healthy_days(task.records, task.days))
        ]
        usual = np.mean([value["dry"] for value in truth.values()])
        calibration = folder / "calibration.yaml"
        calibration.unlink(missing_ok=True)
        code, _, errors, spent = run("calibrate", *healthy, "-o", calibration, "--replace")
        failure = errors.strip()[-300:] if not calibration.exists() else ""
        least_squares = LeastSquares(unit.joint, healthy)
        tests: list[Figures] = []

        def judge(name: str, case: Case, kind: str) -> None:
            file = f"test_{name.replace(' ', '_')}"
            path = write(file, FIRST_TEST_DAY + 2 * len(tests), 0, case)
            tests.append(
                {
                    "case": name,
                    "kind": kind,
                    "wear": case.friction - 1.0,
                    "change": truth[file]["dry"] / usual - 1.0,
                    "ours": estimated(path, calibration),
                    "least_squares": least_squares.judge(path),
                }
            )
            if not task.folder:
                path.unlink()

        for name, case in task.tests.items():
            judge(name, case, name.split()[0])
        sizes = [test["smallest_change"] for test in map(_friction, tests) if test]
        sizes = [size for size in sizes if size is not None and np.isfinite(size)]
        smallest = float(np.median(sizes)) if sizes else float("nan")
        for i in range(task.sized if sizes else 0):
            judge(f"smallest {i}", Case(friction=1.0 + smallest), "smallest")
        write_truth(folder, truth)
    return {
        "joint": unit.name,
        "seed": unit.seed,
        "calibration": {"code": code, "error": failure, "cpu_s": spent},
        "smallest": smallest,
        "tests": tests,
    }


def measure(
    pool: Workers,
    joints: str,
    seeds: int,
    records: int,
    days: int,
    healthy: int,
    sized: int,
    healthy_trials: int,
    held_out: bool,
    folder: Path | None = None,
) -> Figures:
    """Measure the accuracy on joints of other manufacturers, compared with least squares."""
    chosen = joints.split(",") if joints else list(HELD_OUT if held_out else DEVELOPMENT)
    if unknown := set(chosen) - set(JOINTS):
        raise click.UsageError(f"no joint {', '.join(unknown)}: expected some of {list(JOINTS)}")
    tasks = [
        Task(Unit(name, seed), records, days, cases(JOINTS[name], healthy), sized, folder)
        for seed in range(seeds)
        for name in chosen
    ]
    trials = {f"healthy {i}": HEALTHY for i in range(TRIALS_EACH)}
    more = [
        Task(Unit(chosen[i % len(chosen)], _FIRST_TRIAL + i // len(chosen)), records, days, trials)
        for i in range(-(-healthy_trials // TRIALS_EACH))
    ]
    return {"units": pool.map("joints", judged_unit, [*tasks, *more])}


def _friction(test: Figures) -> Figures | None:
    """Return the reported friction of a test, or None if it is not judged."""
    friction = test["ours"]["quantities"].get("friction")
    return friction if friction and friction["judgement"] != "not judged" else None


def is_alarm(ours: Figures) -> bool:
    """Return whether a record is reported as different from the healthy records."""
    changed = any(quantity["judgement"] == "changed" for quantity in ours["quantities"].values())
    return changed or bool(ours["figures"]) or ours["verdict"] == "departed"


def outcome(test: Figures) -> str:
    """Return the outcome of a test with a fault, one of ``OUTCOMES``."""
    wanted, ours = NAMES.get(test["kind"], "friction"), test["ours"]
    changed = {
        name: quantity
        for name, quantity in ours["quantities"].items()
        if quantity["judgement"] == "changed" and name not in CONSEQUENCES
    }
    wrong_candidates = [quantity for name, quantity in changed.items() if name != wanted]
    if any(wanted not in quantity["rivals"] for quantity in wrong_candidates):
        return "wrong"
    if wanted in changed and not changed[wanted]["rivals"]:
        return "named"
    if changed:
        return "not separated"
    if is_alarm(ours):
        return "departed"
    quantity = ours["quantities"].get(wanted)
    return "not judged" if not quantity or quantity["judgement"] == "not judged" else "missed"


def of_joint(units: Sequence[Figures]) -> Figures:
    """Return the errors, intervals, alarms and outcomes of the tests of several units."""
    tests = [test for unit in units for test in unit["tests"]]
    wear = [test for test in tests if test["kind"] == "friction"]
    healthy = [test for test in tests if test["kind"] == "healthy"]
    judged = [(test, friction) for test in tests if (friction := _friction(test))]
    errors = [_error(test, friction) for test, friction in judged if test["kind"] == "friction"]
    plain = [_error(test, test["least_squares"]) for test in wear]
    same = [_error(test, test["least_squares"]) for test in wear if _friction(test)]
    covered = [
        (test, friction) for test, friction in judged if test["kind"] in ("friction", "healthy")
    ]
    reasons = Counter(_reason(test) for test in tests if not _friction(test))
    sizes = [unit["smallest"] for unit in units if np.isfinite(unit["smallest"])]
    plain_covered = [_covers(test, test["least_squares"]) for test in (*wear, *healthy)]
    plain_alarms = [bool(test["least_squares"]["alarm"]) for test in healthy]
    return {
        "error": _rms(errors),
        "least_squares": {
            "error": _rms(plain),
            "error_where_judged": _rms(same),
            "within": [abs(error) < WITHIN for error in plain],
            "covered": plain_covered,
            "alarms": plain_alarms,
        },
        "within": [bool(f := _friction(test)) and abs(_error(test, f)) < WITHIN for test in wear],
        "covered": [_covers(test, friction) for test, friction in covered],
        "alarms": [is_alarm(test["ours"]) for test in healthy],
        "not_judged": [_friction(test) is None for test in tests],
        "reasons": dict(reasons.most_common()),
        "outcomes": {
            kind: dict(Counter(outcome(test) for test in tests if test["kind"] == kind))
            for kind in NAMES
        },
        "smallest": float(np.median(sizes)) if sizes else np.inf,
        "found_smallest": [
            outcome(test) in ("named", "not separated")
            for test in tests
            if test["kind"] == "smallest"
        ],
        "cpu_ms": 1e3 * float(np.median([test["ours"]["cpu_s"] for test in tests])),
    }


def _error(test: Figures, friction: Figures) -> float:
    """Return the relative error of the friction ratio; the truth includes the scatter of days."""
    return (1.0 + friction["change"]) / (1.0 + test["change"]) - 1.0


def _covers(test: Figures, friction: Figures) -> bool:
    """Return whether an interval contains the wear, which excludes the scatter of days."""
    return bool(friction["low"] <= test["wear"] <= friction["high"])


def _reason(test: Figures) -> str:
    friction = test["ours"]["quantities"].get("friction")
    words = (friction and friction["reason"]) or test["ours"]["reason"] or "no estimate"
    # Reasons that differ only in their numbers or paths count as equal.
    return re.sub(r"\S*/\S*|\d[\d.]*", "*", words)


def _rms(errors: Sequence[float]) -> float:
    return 100.0 * float(np.sqrt(np.mean(np.square(errors)))) if errors else float("nan")


def _share(flags: Sequence[bool]) -> float:
    return float(np.mean(flags)) if flags else float("nan")


def by_joint(figures: Figures) -> dict[str, Figures]:
    """Return the results of each joint by name, and of all joints as "all"."""
    units: list[Figures] = figures["units"]
    names = dict.fromkeys(unit["joint"] for unit in units)
    joints = {name: of_joint([unit for unit in units if unit["joint"] == name]) for name in names}
    return joints | {"all": of_joint(units)}


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    joints = by_joint(figures)
    every = joints.pop("all")
    for name, joint in joints.items():
        # A joint without a judged test misses its target.
        error = joint["error"] if joint["error"] == joint["error"] else np.inf
        beside = f"{joint['least_squares']['error']:.2f}"
        what = f"joint {name}: friction error, rms [%]"
        yield at_most(what, error, WANTED_ERROR, beside=beside)
    worse = [
        name
        for name, joint in joints.items()
        if not joint["error"] <= max(joint["least_squares"]["error_where_judged"], WANTED_ERROR)
    ]
    yield none_of("joints with a larger friction error than least squares", len(worse))
    plain = every["least_squares"]
    row = share_at_least("joints: friction within 10 %", every["within"], 1.0)
    yield row._replace(beside=percent(_share(plain["within"]), 1))
    low, high = COVER
    cover = _share(every["covered"])
    target, measured = f"{100.0 * low:g} to {100.0 * high:g}", percent(cover, 1)
    what = "joints: 90 % intervals of friction hold [%]"
    beside = percent(_share(plain["covered"]), 1)
    yield Row(what, target, measured, low <= cover <= high, beside)
    alarms, theirs = (1000.0 * _share(entry["alarms"]) for entry in (every, plain))
    what = f"joints: false alarms of {len(every['alarms'])} healthy tests, in 1000"
    yield at_most(what, alarms, 1000.0 * MOST_ALARMS, beside=f"{theirs:.0f}")
    wrong = sum(counts.get("wrong", 0) for counts in every["outcomes"].values())
    yield none_of("joints: faults attributed to another quantity", wrong)
    for kind, counts in every["outcomes"].items():
        if count := sum(counts.values()):
            right = counts.get("named", 0), counts.get("not separated", 0)
            words = f"{right[0]}, {right[1]} of {count}"
            yield untargeted(f"  {kind}: named, not separated", words)
    yield at_most(
        "joints: smallest detectable change of friction, median [%]",
        100.0 * every["smallest"],
        WANTED_SMALLEST,
    )
    found_smallest = 100.0 * _share(every["found_smallest"] or [False])
    yield at_least("joints: friction changes of that size found [%]", found_smallest, 90.0)
    yield untargeted("joints: processor time of a record [ms]", f"{every['cpu_ms']:.0f}")


def tables(figures: Figures) -> Iterator[Table | str]:
    """Yield the tables to print below the targets."""
    joints = by_joint(figures)
    yield grid(
        "friction (least squares in brackets)",
        (
            *("joint", "error, rms %", "within 10 %", "90 % intervals hold %", "false alarms"),
            *("not judged", "smallest change %", "of that size found", "ms"),
        ),
        (
            (
                name,
                *_beside(joint["error"], joint["least_squares"]["error"], ".1f"),
                *_beside(*_counts("within", joint)),
                *_beside(
                    *(percent(_share(of["covered"])) for of in (joint, joint["least_squares"]))
                ),
                *_beside(*_counts("alarms", joint)),
                _count(joint["not_judged"]),
                100.0 * joint["smallest"],
                _count(joint["found_smallest"]),
                f"{joint['cpu_ms']:.0f}",
            )
            for name, joint in joints.items()
        ),
    )
    yield grid(
        "outcomes of tests with a fault",
        ("joint", "case", *OUTCOMES),
        (
            (name, kind, *(counts.get(outcome, "") for outcome in OUTCOMES))
            for name, joint in joints.items()
            for kind, counts in joint["outcomes"].items()
            if counts
        ),
    )
    for name, joint in joints.items():
        if name != "all":
            yield from (f"{name}: {n} not judged: {words[:200]}" for words, n in _top(joint))
    for unit in figures["units"]:
        if error := unit["calibration"]["error"]:
            yield f"{unit['joint']} {unit['seed']}: no calibration: {error}"


def _top(entry: Figures) -> Iterable[tuple[str, Any]]:
    return list(entry["reasons"].items())[:3]


def _count(flags: Sequence[bool]) -> str:
    return f"{sum(flags)} of {len(flags)}"


def _counts(key: str, entry: Figures) -> tuple[str, str]:
    return _count(entry[key]), str(sum(entry["least_squares"][key]))


def _beside(ours: Any, plain: Any, form: str = "") -> Iterator[str]:
    yield f"{ours:{form}} ({plain:{form}})"


QUICK: Final = {"seeds": 1, "healthy": 2, "sized": 4}
FOLDER: Final = click.Path(file_okay=False, path_type=Path)
main = command(
    measure,
    "joints of other makes",
    rows,
    tables,
    width=150,
    beside="least squares",
    quick=QUICK,
    joints="",
    seeds=2,
    records=10,
    days=3,
    healthy=6,
    sized=8,
    healthy_trials=0,
    held_out=False,
    folder=click.Option(["--folder"], type=FOLDER, help="Folder to keep the records in."),
)

if __name__ == "__main__":
    main()
