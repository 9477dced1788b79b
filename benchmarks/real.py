# SPDX-License-Identifier: Apache-2.0
"""Reports of the commands for records of real actuators (docs/real-data.md).

    python benchmarks/real.py FOLDER [--json FILE] [--picture FILE]
    python benchmarks/real_document.py FILE --write docs/real-data.md

FOLDER has `ball_screw*.parquet` (Cranfield, CORD 5097649; a ball screw of 5 mm lead with three
loads, healthy and with twelve seeded faults), `aircraft_ema*.parquet` (project REPRISE; sixteen
tests over six months, until the jam) and, optionally, `emps_normal.parquet` and
`emps_pulses.parquet` (a benchmark of system identification). Each trial of the ball screw is
imported as a table on a separate day, the tests a month after the healthy trials. `ema import`,
`calibrate`, `estimate`, `label` and `predict` process whole trials; `ema moves` processes the table
of the aircraft. No healthy trial is judged by a calibration that includes it, and no trial by its
own label. The benchmark takes 3 minutes on two idle cores.
"""

import json
import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, NamedTuple

import click
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from joints import run
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, at_most, grid, none_of, percent, share_at_least, untargeted

from ema_core.levels import LEVEL_NAMES

SAMPLE: Final = Path(__file__).parents[1] / "bags" / "real"
PERIOD_S: Final = 0.04
HEALTHY: Final = "normal"
LOADS: Final = (20, 40, -40)
TRIALS: Final = (1, 2, 3, 4, 5)
DAYS: Final = (1, 3, 5)
"""Numbers of healthy days to compare, with one trial per day."""
FIRST_TEST_DAY: Final = 40
MIDNIGHT: Final = pd.Timestamp("2025-03-03", tz="UTC").timestamp()

FOUND: Final = {
    "lubrication": (("lackLubrication1", "lackLubrication2"), {20: 0.95, 40: 0.95}),
    "backlash 1": (("backlash1",), {20: 0.95, 40: 0.95, -40: 0.95}),
    "backlash 2": (("backlash2",), {20: 0.95, 40: 0.95, -40: 0.6}),
}
"""Faults that should be found: states, and the required share of trials by load [kg]."""
RIGHT: Final = {20: 0.88, 40: 0.78, -40: 0.85}
"""Required share of trials whose state, one of thirteen, is named correctly, by load [kg]."""
REPORTED: Final = ("lackLubrication1", "lackLubrication2", "backlash1", "backlash2", "spalling4")
WARNING: Final = 0.2
"""Relative change of friction at the first warning [-].

The level OK is justified only if a smaller change is detectable.
"""
LIMIT: Final = 1.5
"""Ratio to the healthy current at which the aircraft actuator has to be removed [-]."""

NEWTONS: Final = 35.15
"""Force per volt of command of EMPS [N/V]."""
PUBLISHED: Final = {"inertia": 95.11, "viscous friction": 203.5, "friction": 20.39}
"""Mass [kg], viscous friction [N.s/m] and Coulomb friction [N] of EMPS."""
PULSES_N: Final = 88.0
WITHIN: Final = 0.02

_DESCRIPTION: Final = """\
actuator_id: carriage
serial_number: EMPS
sample_period: 0.001
drive: unknown
parameters: {tau: 1.0, lead: 0.02}  # any lead
"""
_MAPPING: Final = """\
position: {source: position_m, unit: m}
command: {source: reference_m, unit: m}
current: {source: force_n, kind: force, unit: N}
clock: {source: time_s}
"""
_MOVES: Final = """\
time: date
figures: [rms_current_a]
like: [frequency_hz]
test: test_no
"""


class Trial(NamedTuple):
    """A trial of the ball screw."""

    state: str
    load: int
    number: int

    @property
    def bag(self) -> str:
        """File name of the trial's bag as a test."""
        return f"test_{self.state}_{self.load}_{self.number}.mcap"

    @property
    def healthy_bag(self) -> str:
        """File name of the trial's bag as a healthy trial."""
        return f"healthy_{self.load}_{self.number}.mcap"


class Comparison(NamedTuple):
    """Healthy trials of a load, labelled trials, and the trials to judge with both."""

    load: int
    days: int
    healthy: Sequence[int]
    tests: Sequence[Trial]
    labelled: Sequence[Trial] = ()


def succeed(*arguments: str | Path) -> str:
    """Run a command and return its stdout; RuntimeError if it fails."""
    code, printed, errors, _ = run(*arguments)
    if code:
        raise RuntimeError(f"ema {' '.join(map(str, arguments))}: exit code {code}: {errors}")
    return printed


def imported(folder: Path, trial: tuple[Trial, int, pd.DataFrame]) -> None:
    """Write a trial as a table on its day, and import the table into a bag."""
    (key, day, records), columns = trial, ["set_point_mm", "position_error_mm", "current_a"]
    name = key.bag if day >= FIRST_TEST_DAY else key.healthy_bag
    table = (folder / name).with_suffix(".csv")
    records = records.sort_values(["repetition", "sample"])[columns].astype(float).round(4)
    time = MIDNIGHT + 86_400.0 * day + 8 * 3600.0 + PERIOD_S * np.arange(len(records))
    records.assign(time_s=np.round(time, 2)).to_csv(table, index=False)
    arguments = "--mapping", SAMPLE / "mapping.yaml", "--actuator", SAMPLE / "actuator.yaml"
    succeed("import", table, *arguments, "-o", folder / name)


def written(folder: Path, source: Path, workers: Workers) -> list[Trial]:
    """Import all trials of the ball screw and return them."""
    frame = pd.concat([pd.read_parquet(path) for path in sorted(source.glob("ball_screw*"))])
    frame["state"] = frame["state"].astype(str)
    frame = frame[frame["trial"].isin(TRIALS)]
    groups: dict[Trial, pd.DataFrame] = {
        Trial(str(state), int(load), int(number)): records  # pyright: ignore
        for (state, load, number), records in frame.groupby(["state", "load_kg", "trial"])  # pyright: ignore
    }
    items = [(key, FIRST_TEST_DAY + i, group) for i, (key, group) in enumerate(groups.items())]
    items += [(key, 2 * key.number, group) for key, group in groups.items() if key.state == HEALTHY]
    workers.map("import", partial(imported, folder), items)
    return list(groups)


def comparisons(trials: Sequence[Trial]) -> list[Comparison]:
    """Return the comparisons to make.

    Without labels, each number of days judges every faulty trial once. With labels, each trial is
    judged once.
    """
    chosen = []
    for load in LOADS:
        here = [trial for trial in trials if trial.load == load]
        faulty = [trial for trial in here if trial.state != HEALTHY]
        healthy = [trial for trial in here if trial.state == HEALTHY]
        chosen.append(Comparison(load, len(TRIALS), TRIALS, faulty))
        for first in range(len(TRIALS)):
            turned = TRIALS[first:] + TRIALS[:first]
            for days in DAYS[:-1]:
                tests = [trial for trial in healthy if trial.number in turned[days:]]
                tests += [trial for trial in faulty if trial.number == turned[days]]
                chosen.append(Comparison(load, days, turned[:days], tests))
            # Leave whole trials out: the other four healthy trials judge the healthy one.
            left = [trial for trial in here if trial.number == turned[0]]
            labelled = [trial for trial in faulty if trial.number != turned[0]]
            chosen.append(Comparison(load, len(turned) - 1, turned[1:], left, labelled))
    return chosen


def compared(folder: Path, comparison: Comparison) -> list[Figures]:
    """Calibrate and label as a comparison states. Return the report of each of its tests."""
    calibration = calibrated(folder, comparison)
    for state in sorted({trial.state for trial in comparison.labelled}):
        bags = [folder / trial.bag for trial in comparison.labelled if trial.state == state]
        succeed("label", calibration, *bags, "--state", state)
    return [
        {
            "state": test.state,
            "load": test.load,
            "trial": test.number,
            "days": comparison.days,
            "labelled": bool(comparison.labelled),
            **estimated(folder / test.bag, calibration),
        }
        for test in comparison.tests
    ]


def calibrated(folder: Path, comparison: Comparison) -> Path:
    """Calibrate on the healthy trials of a comparison. Return the path of the calibration."""
    load, healthy = comparison.load, comparison.healthy
    name = f"{load}_{'_'.join(map(str, healthy))}{'_labelled' * bool(comparison.labelled)}.yaml"
    bags = [folder / Trial(HEALTHY, load, number).healthy_bag for number in healthy]
    succeed("calibrate", *bags, "-o", folder / name, "--replace")
    return folder / name


def estimated(bag: Path, calibration: Path) -> Figures:
    """Return the report of `ema estimate` for a record; RuntimeError without a report."""
    code, printed, errors, _ = run("estimate", bag, "--calibration", calibration, "--json")
    if not printed:
        raise RuntimeError(f"{bag}: {errors}")
    [report] = json.loads(printed)
    comparison = report["comparison"]
    return {
        "code": code,
        "verdict": report["verdict"],
        "reason": report["reason"],
        "quantities": {quantity["name"]: quantity for quantity in comparison["quantities"]},
        "figures": [entry["name"] for entry in comparison["figures"]],
        "states": comparison["states"] or {},
    }


def reported(folder: Path, load: int) -> list[Figures]:
    """Return level and friction of tests after calibration on one healthy day."""
    calibration = calibrated(folder, Comparison(load, 1, TRIALS[-1:], ()))
    reports = []
    for state in (HEALTHY, *REPORTED):
        bag = folder / Trial(state, load, 1).bag
        test = estimated(bag, calibration)
        code, printed, errors, _ = run("predict", bag, "--calibration", calibration, "--json")
        if not printed:
            raise RuntimeError(f"{bag}: {errors}")
        level = LEVEL_NAMES[json.loads(printed)["level"]]
        friction = test["quantities"]["friction"]
        report = {"state": state, "load": load, "level": level, "code": code, "friction": friction}
        reports.append(report | {"verdict": test["verdict"]})
    return reports


def emps(source: Path) -> Figures:
    """Return the reports of the commands for EMPS: coefficients, thirds and an unknown load."""
    normal = pd.read_parquet(source / "emps_normal.parquet")
    pulses = pd.read_parquet(source / "emps_pulses.parquet")
    third = len(normal) // 3
    parts = {f"third {i + 1}": normal[i * third : (i + 1) * third] for i in range(3)}
    removed = pulses.assign(command_v=pulses["command_v"] - pulses["pulse_v"])
    records = {"own record": normal, **parts, "pulses": pulses, "pulses not measured": removed}
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "actuator.yaml").write_text(_DESCRIPTION, encoding="utf-8")
        (folder / "mapping.yaml").write_text(_MAPPING, encoding="utf-8")
        for day, (name, record) in enumerate(records.items()):
            time = record["time_s"] - record["time_s"].iloc[0]
            at = MIDNIGHT + 86_400.0 * (day and FIRST_TEST_DAY + day)
            table = record[["reference_m", "position_m"]].assign(
                time_s=at + time, force_n=NEWTONS * record["command_v"]
            )
            table.to_csv(folder / f"{name}.csv", index=False)
        calibration = folder / "calibration.yaml"
        printed = succeed("calibrate", folder / "own record.csv", "-o", calibration)
        return {
            "printed": printed.splitlines()[0],
            "coefficients": {
                name: float(re.findall(rf"[:,] {name} (-?[\d.]+)", printed)[0])
                for name in (*PUBLISHED, "constant load")
            },
            "records": {name: estimated(folder / f"{name}.csv", calibration) for name in records},
        }


def aircraft(path: Path) -> list[Figures]:
    """Return the report of `ema moves` for each test with moves of up to 1 Hz.

    Each report is based on the earlier tests.
    """
    moves = pd.read_parquet(path)
    with TemporaryDirectory() as name:
        table, mapping = Path(name) / "moves.csv", Path(name) / "moves.yaml"
        moves[moves["frequency_hz"] <= 1.0].to_csv(table, index=False)
        mapping.write_text(_MOVES, encoding="utf-8")
        arguments = "--mapping", mapping, "--limit", str(LIMIT), "--reference", "4"
        _, printed, errors, _ = run("moves", table, *arguments, "--json")
    if not printed:
        raise RuntimeError(errors)
    return [
        {**test, "test": number, "date": str(pd.Timestamp(test["stamp_ns"]).date())}
        for number, test in enumerate(json.loads(printed), 1)
    ]


def measure(workers: Workers, folder: Path, picture: Path | None = None) -> Figures:
    """Run the commands on the records of real actuators in FOLDER."""
    with TemporaryDirectory() as name:
        trials = written(Path(name), folder, workers)
        reports = workers.map("report", partial(reported, Path(name)), LOADS)
        # Start the longest tasks first, to keep all workers busy until the end.
        tasks = sorted(comparisons(trials), key=lambda entry: not entry.labelled)
        judged = workers.map("compare", partial(compared, Path(name)), tasks)
    figures: Figures = {
        "trials": [test for group in judged for test in group],
        "reports": [test for group in reports for test in group],
        "aircraft": {path.stem: aircraft(path) for path in sorted(folder.glob("aircraft_ema*"))},
    }
    if (folder / "emps_normal.parquet").exists():
        figures["emps"] = emps(folder)
    if picture:
        draw(figures, picture)
    return figures


def has_departed(test: Figures) -> bool:
    """Return whether a trial departs from the healthy trials."""
    return test["verdict"] == "departed"


def is_open(test: Figures) -> bool:
    """Return whether a trial does not depart, but its friction is not judged."""
    friction = test["quantities"]["friction"]["judgement"]
    return not has_departed(test) and friction == "not judged"


def kind(state: str) -> str:
    """Return the kind of a state, without its severity."""
    return state.rstrip("0123456789")


def named(test: Figures) -> str:
    """Return the most probable state of a trial; "" without labelled states."""
    state = next(iter(test["states"]), "")
    return HEALTHY if state == "healthy" else state


def changes(test: Figures) -> str:
    """Return the changed quantities, with signs, and figures of a trial, separated by commas."""
    signs = {
        name: "+" if quantity["change"] > 0.0 else "-"
        for name, quantity in test["quantities"].items()
        if quantity["judgement"] == "changed"
    }
    return ", ".join([*(f"{name} {sign}" for name, sign in signs.items()), *test["figures"]])


def chosen(figures: Figures, days: int, load: int | None = None, *states: str) -> list[Figures]:
    """Return the trials that are compared with a number of healthy days, by load and state.

    With five days, a healthy trial is compared with the other four. ``load`` None selects all
    loads, and no ``states`` select all states.
    """
    return [
        test
        for test in figures["trials"]
        if (not states or test["state"] in states) and load in (None, test["load"])
        if (
            test["labelled"]
            if test["state"] == HEALTHY and days == len(TRIALS)
            else test["days"] == days and not test["labelled"]
        )
    ]


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    for days in DAYS:
        healthy = chosen(figures, days, None, HEALTHY)
        what = f"false alarms of 15 healthy trials, {days} healthy days, {len(healthy)} comparisons"
        yield none_of(what, sum(map(has_departed, healthy)))
    for days in DAYS[1:]:
        for name, (states, least) in FOUND.items():
            for load, share in least.items():
                tests = chosen(figures, days, load, *states)
                what = f"{name} found at {load} kg, {days} healthy days"
                yield share_at_least(what, list(map(has_departed, tests)), share)
    for days in DAYS:
        for load in LOADS:
            what = f"smallest detectable change of friction at {load} kg, {days} healthy days [%]"
            yield untargeted(what, f"{smallest_change(figures, days, load):.1f}")
    blind = sum(report["level"] == "OK" and is_blind(report) for report in figures["reports"])
    yield none_of("one healthy day: OK although a warning could not be seen", blind)
    for load, least in RIGHT.items():
        tests = [
            trial for trial in figures["trials"] if trial["labelled"] and trial["load"] == load
        ]
        right = [named(test) == test["state"] for test in tests]
        yield share_at_least(f"13 labelled states at {load} kg named rightly", right, least)
        kinds = [kind(named(test)) == kind(test["state"]) for test in tests]
        yield untargeted("  4 kinds [%]", f"{percent(float(np.mean(kinds)), 1)} of {len(kinds)}")
    if "emps" in figures:
        yield from _emps_rows(figures["emps"])
    for name, tests in figures["aircraft"].items():
        yield from _aircraft_rows(name, tests)


def smallest_change(figures: Figures, days: int, load: int | None = None) -> float:
    """Return the median over trials of the smallest detectable change of friction [%]."""
    frictions = [test["quantities"]["friction"] for test in chosen(figures, days, load)]
    changes = [friction["smallest_change"] for friction in frictions]
    return 100.0 * float(np.nanmedian(np.array(changes, dtype=float)))


def is_blind(report: Figures) -> bool:
    """Return whether the test could have missed a change of friction that gives a warning."""
    friction = report["friction"]
    smallest = friction["smallest_change"]
    return friction["judgement"] == "not judged" or smallest is None or smallest >= WARNING


def _emps_rows(results: Figures) -> Iterator[Row]:
    for name, truth in PUBLISHED.items():
        error = results["coefficients"][name] / truth - 1.0
        what = f"EMPS: {name} from published value [%]"
        yield at_most(what, 100.0 * abs(error), 100.0 * WITHIN, f"{100.0 * error:+.1f}")
    records = results["records"]
    report = records["own record"]
    judged = report["verdict"] == "valid" and not is_open(report)
    yield Row("EMPS: own record", "valid", report["verdict"], judged)
    thirds = [record["verdict"] == "valid" for name, record in records.items() if "third" in name]
    yield share_at_least("EMPS: thirds of the own record judged", thirds, 1.0)
    load = records["pulses not measured"]["quantities"]["load"]
    met = load["judgement"] == "changed" and abs(abs(load["change"]) / PULSES_N - 1.0) < 0.1
    measured = f"{load['change']:.0f} {load['unit']}" if load["change"] else load["judgement"]
    yield Row("EMPS: load of pulses that are not measured", "88 N", measured, met)


def _aircraft_rows(name: str, tests: list[Figures]) -> Iterator[Row]:
    levels = [test["level"] for test in tests]
    autumn, until, last = levels[5:9], levels[9:13], levels[13:]
    yield Row(f"{name}: WARN by 4 October", "WARN", ", ".join(until), until[-1] != "OK")
    are_errors = all(level == "ERROR" for level in last)
    yield Row("  9, 11 and 12 October", "ERROR", ", ".join(last), are_errors)
    yield Row("  tests 6 to 9", "<= WARN", ", ".join(autumn), "ERROR" not in autumn)
    [*_, fourth] = (test["life_days"] for test in tests if test["date"] == "2017-10-04")
    yield Row(
        "  4 October, life to 1.5 times healthy, 5 to 95 % [d]",
        "holds 5",
        f"{fourth[0]:.1f} to {fourth[2]:.1f}" if fourth else "none",
        bool(fourth) and fourth[0] <= 5.0 <= fourth[2],
    )
    september = [test for test in tests if "2017-09" in test["date"] and test["life_days"]]
    yield none_of("  lives predicted in September", len(september))


def tables(figures: Figures) -> Iterator[Table | str]:
    """Yield the tables to print below the targets."""
    states = list(dict.fromkeys(trial["state"] for trial in figures["trials"]))
    for days in DAYS:
        cells = {
            (state, load): chosen(figures, days, load, state) for state in states for load in LOADS
        }
        yield grid(
            f"trials that depart, {days} healthy days (friction not judged)",
            ("state", *(f"{load} kg" for load in LOADS)),
            ((state, *(_departing(cells[state, load]) for load in LOADS)) for state in states),
        )
    cells = {
        (state, load): Counter(filter(None, map(changes, chosen(figures, 5, load, state))))
        for state in states
        for load in LOADS
    }
    yield grid(
        "what departs most often, 5 healthy days",
        ("state", *(f"{load} kg" for load in LOADS)),
        (
            (state, *(next(iter(dict(cells[state, load].most_common(1))), "") for load in LOADS))
            for state in states
        ),
    )
    yield grid(
        "after one healthy day",
        ("state", "load", "verdict", "level", "friction", "smallest change [%]", "exit code"),
        (
            (
                *(report[key] for key in ("state", "load", "verdict", "level")),
                report["friction"]["judgement"],
                100.0 * (report["friction"]["smallest_change"] or math.nan),
                report["code"],
            )
            for report in figures["reports"]
        ),
    )
    for load in LOADS:
        tests = [
            trial for trial in figures["trials"] if trial["labelled"] and trial["load"] == load
        ]
        wrong = Counter((t["state"], named(t)) for t in tests if named(t) != t["state"])
        words = (f"{true} as {taken} {n}" for (true, taken), n in wrong.most_common())
        yield f"labelled states at {load} kg named wrongly: {', '.join(words) or 'none'}"
    if "emps" in figures:
        yield figures["emps"]["printed"].partition(": ")[2]
        for name, record in figures["emps"]["records"].items():
            reason = record["reason"].partition(". Not judged")[0]
            yield f"EMPS, {name}: {record['verdict']}: {reason}"
    for name, tests in figures["aircraft"].items():
        yield grid(
            name,
            ("test", "date", "ratio", "level", "probability", "life [d]"),
            (
                (
                    *(test[key] for key in ("test", "date", "ratio", "level")),
                    f"{test['probability']:.1e}",
                    " / ".join(f"{value:.1f}" for value in test["life_days"] or ()),
                )
                for test in tests
            ),
        )


def _departing(tests: Sequence[Figures]) -> str:
    if not tests:
        return ""
    words = f"{sum(map(has_departed, tests))} of {len(tests)}"
    left = sum(map(is_open, tests))
    return f"{words} ({left})" if left else words


def draw(figures: Figures, path: Path) -> None:
    """Draw the change of friction of the ball screw, and the life of the aircraft actuator."""
    picture, (left, right) = plt.subplots(
        1, 2, figsize=(12.0, 4.6), layout="constrained", width_ratios=(3, 2)
    )
    days = DAYS[-1]
    states = list(dict.fromkeys(trial["state"] for trial in figures["trials"]))
    states = [HEALTHY, *(state for state in states if state != HEALTHY)]
    for place, load in enumerate(LOADS):
        points = defaultdict[bool, list[tuple[float, float]]](list)
        for at, state in enumerate(states):
            for test in chosen(figures, days, load, state):
                change = test["quantities"]["friction"]["change"]
                if change is not None:
                    points[has_departed(test)].append((at + 0.22 * (place - 1), 100.0 * change))
        marker, colour = "o^s"[place], f"C{place}"
        for departs, pairs in points.items():
            x, y = np.array(pairs).T
            face = colour if departs else "none"
            left.plot(x, y, marker, color=colour, mfc=face, ms=4.5, ls="")
        left.plot([], [], marker, color=colour, ls="", label=f"{load} kg")
    left.plot([], [], "o", color="0.3", mfc="none", ls="", label="does not depart")
    smallest = smallest_change(figures, days)
    left.axhspan(-smallest, smallest, color="0.9", zorder=0, label="friction alone may not show")
    left.set_xticks(range(len(states)), states, rotation=60, ha="right", fontsize=8)
    left.set_ylabel("change of Coulomb friction [%]")
    left.set_title(f"ball screw, one mark a trial, {days} healthy days", fontsize=10)
    left.legend(fontsize=8, ncols=2)
    for name, tests in figures["aircraft"].items():
        ratios = [test["ratio"] for test in tests]
        numbers = np.arange(1, len(tests) + 1)
        right.plot(numbers, ratios, "-", color="0.7", lw=1)
        for level, colour in (("STALE", "0.5"), ("OK", "C2"), ("WARN", "C1"), ("ERROR", "C3")):
            at_level = [test["level"] == level for test in tests]
            label = {"STALE": "reference"}.get(level, level)
            points = numbers[at_level], np.array(ratios)[at_level]
            right.plot(*points, "o", color=colour, label=label)
        right.axhline(LIMIT, color="0.3", lw=1, ls="--")
        dates = [test["date"][5:] for test in tests]
        right.set_xticks(numbers, dates, rotation=60, ha="right", fontsize=8)
        right.set_title(f"{name}: current over healthy, 2017", fontsize=10)
    right.legend(fontsize=8)
    picture.savefig(path, dpi=110)
    plt.close(picture)


FOLDER: Final = click.Path(exists=True, file_okay=False, path_type=Path)
main = command(
    measure,
    "real machines",
    rows,
    tables,
    width=150,
    folder=click.Argument(["folder"], type=FOLDER),
    picture=click.Option(["--picture"], type=click.Path(path_type=Path), help="Picture to write."),
)

if __name__ == "__main__":
    main()
