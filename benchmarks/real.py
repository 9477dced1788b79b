"""What a unit's own normal shows on records of two real actuators (docs/real-data.md).

    python benchmarks/real.py FOLDER [--json FILE] [--picture FILE]

FOLDER holds `ball_screw*.parquet` (Cranfield, CORD 5097649; a ball screw of 5 mm lead in three
loads, healthy and with twelve seeded faults) and `aircraft_ema*.parquet` (project REPRISE; sixteen
tests over six months, to the jam). Each trial is imported, and diagnosed as a monitor does it, by a
calibration of the healthy trials of its load, and by one of all loads, untold. Whole trials are
left out: a healthy one is judged by the others; labelled states by the other trials of all states.
Tests of the aircraft are judged by those before them, the first four as reference.
"""

from collections import defaultdict
from collections.abc import Iterator
from itertools import chain, product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import click
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, at_least, grid, none_of, percent, share_at_least

from ema_bags.inputs.files import InputFile
from ema_bags.inputs.importing import Imported, import_series
from ema_bags.inputs.mapping import load_mapping
from ema_core.telemetry import join
from ema_monitor.calibrations import calibrate
from ema_monitor.diagnosis import Diagnosed, diagnose
from ema_monitor.identification.tally import CombinationSettings
from ema_monitor.normal.features import Part, figures_of, mean_of
from ema_monitor.normal.moves import Move, MoveSeries
from ema_monitor.normal.normal import DEPARTED, HealthyTest
from ema_monitor.normal.states import LabelledTest, States, known_states
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import ANY_MOTION, TriggerSettings
from ema_monitor.windows.window import Window
from ema_ros.actuator_file import load_description

SAMPLE: Final = Path(__file__).parents[1] / "bags" / "real"
MAPPING: Final = load_mapping(SAMPLE / "mapping.yaml")
PERIOD_S: Final = 0.04
HEALTHY: Final = "normal"
LOADS: Final = (20, 40, -40)
FOUND: Final = {
    "lackLubrication1": ((20, 40, -40), 0.95),
    "lackLubrication2": ((20, 40, -40), 0.95),
    "backlash1": ((20, 40, -40), 0.95),
    "backlash2": ((20, 40), 0.95),
    "spalling7": ((20, 40, -40), 0.80),
    "spalling8": ((20, 40, -40), 0.80),
}
RIGHT: Final = {4: (0.97, 0.88, 0.95), 13: (0.88, 0.75, 0.88)}
LIMIT: Final = 1.5
"""Ratio to the healthy current at which the aircraft actuator has to be removed."""

Test = tuple[str, int, int]
"""State, load [kg] and trial."""


def ball_screw_trials(folder: Path) -> dict[Test, pd.DataFrame]:
    """Return the records of each trial."""
    frame = pd.concat([pd.read_parquet(path) for path in sorted(folder.glob("ball_screw*"))])
    frame["state"] = frame["state"].astype(str)
    return dict(iter(frame.groupby(["state", "load_kg", "trial"])))  # pyright: ignore


def imported(records: pd.DataFrame) -> Imported:
    """Return records as their owner would import them."""
    with TemporaryDirectory() as folder:
        table = Path(folder) / "trial.csv"
        records.assign(time_s=PERIOD_S * np.arange(len(records))).to_csv(table, index=False)
        series = InputFile(table, MAPPING).series(MAPPING)
        return import_series(series, MAPPING, load_description(SAMPLE / "actuator.yaml"))


def cycles(trial: pd.DataFrame) -> list[Part]:
    """Return the figures of each cycle of a trial."""
    some = [imported(cycle) for _, cycle in trial.groupby("repetition")]
    return list(chain.from_iterable(figures_of(join(list(one.blocks()))) for one in some))


def stretches(trial: pd.DataFrame) -> list[Segment]:
    """Return the stretches of motion in a trial."""
    found = imported(trial.sort_values(["repetition", "sample"]))
    finder = WindowFinder(TriggerSettings(windows=ANY_MOTION), found.description)
    events = chain(*map(finder.feed, found.blocks()), finder.finish())
    return [one for one in events if isinstance(one, Segment)]


def diagnosed(
    trials: dict[Test, list[Segment]], *, of_its_load: bool
) -> dict[str, dict[str, list[Any]]]:
    """Return of each trial, by state and load: how likely it is for a healthy unit, and verdicts.

    A verdict is "fault" where a valid estimate has one.
    """
    found: dict[str, dict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    for (state, load, trial), segments in trials.items():
        healthy = [
            one.window
            for (other, at, number), some in trials.items()
            if other == HEALTHY and (at == load or not of_its_load)
            if (other, at, number) != (state, load, trial)
            for one in some
            if isinstance(one.window, Window)
        ]
        calibration = calibrate(healthy, segments[0].description)
        windows = [one.window for one in segments if isinstance(one.window, Window)]
        parts = [part for one in windows for part in figures_of(one.telemetry)]
        departure = calibration.normal.departure(windows[0].start_ns, parts)
        verdicts = []
        for one in diagnose(segments, calibration, combining=CombinationSettings()):
            if isinstance(one, Diagnosed):
                is_fault = one.estimate.valid and bool(np.any(one.estimate.found))
                verdicts.append("fault" if is_fault else one.estimate.verdict)
        found[state][str(load)].append([departure.probability if departure else 1.0, verdicts])
    return {state: dict(by_load) for state, by_load in found.items()}


def is_found(trial: list[Any]) -> bool:
    """Return whether a trial departs or has a fault, by one of its estimates."""
    return bool({"departed", "fault"} & set(trial[1]))


def ranked(tests: dict[Test, dict[str, float]]) -> dict[str, float]:
    """Return the share of pairs in which the first severity of lubrication is below the second."""
    shares = {}
    for load in (20, 40):
        first, second = (
            [one["friction_current"] for (state, at, _), one in tests.items() if (state, at) == key]
            for key in (("lackLubrication1", load), ("lackLubrication2", load))
        )
        shares[str(load)] = float(np.mean([a < b for a, b in product(first, second)]))
    return shares


def labelled(tests: dict[Test, list[Part]]) -> dict[str, dict[str, float]]:
    """Return the shares of tests whose kind and state are named rightly, each by other trials."""
    shares = {}
    for load in LOADS:
        here = {key: parts for key, parts in tests.items() if key[1] == load}
        kind, right = [], []
        for trial in sorted({key[2] for key in here}):
            known = [
                LabelledTest(state, _test(parts), [part.features for part in parts])
                for (state, _, number), parts in here.items()
                if number != trial
            ]
            states = States(known_states(known))
            for (state, _, number), parts in here.items():
                if number == trial:
                    found = states.probabilities(_test(parts))
                    named = next(iter(found))
                    right.append(named == state)
                    kind.append(named.rstrip("0123456789") == state.rstrip("0123456789"))
        shares[str(load)] = {"4": float(np.mean(kind)), "13": float(np.mean(right))}
    return shares


def _test(parts: list[Part]) -> HealthyTest:
    return HealthyTest(0, mean_of(parts))


def aircraft(path: Path) -> list[Figures]:
    """Return what is told of each test by those before it, the first four as reference."""
    series, told = MoveSeries(limit=LIMIT, reference=4), []
    for number, test in pd.read_parquet(path).groupby("test_no"):
        day = pd.Timestamp(test["date"].iloc[0])
        slow = test[test["frequency_hz"] <= 1.0].groupby("frequency_hz")["rms_current_a"].median()
        figures = {f"RMS at {hz:g} Hz": float(rms) for hz, rms in slow.items()}  # pyright: ignore
        verdict = series.add(Move(day.value, figures))
        told.append(
            {
                "test": number,
                "date": str(day.date()),
                "ratio": verdict.ratio,
                "level": verdict.level,
                "probability": verdict.probability,
                "life_days": verdict.life_days and list(verdict.life_days),
            }
        )
    return told


def measure(_: Workers, folder: Path, picture: Path | None = None) -> Figures:
    """Print what a unit's own normal shows of the records in FOLDER."""
    trials = ball_screw_trials(folder)
    parts = {key: cycles(trial) for key, trial in trials.items()}
    tests = {key: mean_of(one) for key, one in parts.items()}
    motion = {key: stretches(trial) for key, trial in trials.items()}
    figures: Figures = {
        "trials": diagnosed(motion, of_its_load=True),
        "untold": diagnosed(motion, of_its_load=False),
        "ranked": ranked(tests),
        "states": labelled(parts),
        "aircraft": {path.stem: aircraft(path) for path in sorted(folder.glob("aircraft_ema*"))},
    }
    if picture:
        draw(figures, picture)
    return figures


def rows(figures: Figures) -> Iterator[Row]:
    """Return the rows of the targets."""
    for key, by in (("trials", ""), ("untold", ", load untold")):
        found = figures[key]
        healthy = [is_found(one) for some in found[HEALTHY].values() for one in some]
        yield none_of(f"false alarms of {len(healthy)} healthy trials{by}", sum(healthy))
        for state, (loads, least) in FOUND.items():
            some = [is_found(one) for load in loads for one in found[state].get(str(load), [])]
            where = ", ".join(map(str, loads))
            yield share_at_least(f"{state} found at {where} kg{by}", some, least)
    for load, share in figures["ranked"].items():
        yield at_least(f"lubrication 1 below 2 at {load} kg, pairs [%]", 100.0 * share, 90.0)
    for number, wanted in RIGHT.items():
        shares = [figures["states"][str(load)][str(number)] for load in LOADS]
        target, measured = (" / ".join(map(percent, some)) for some in (wanted, shares))
        are_met = all(share >= one for share, one in zip(shares, wanted, strict=True))
        yield Row(f"{number} labelled states at 20, 40, -40 kg [%]", target, measured, are_met)
    for name, told in figures["aircraft"].items():
        yield from _aircraft_rows(name, told)


def _aircraft_rows(name: str, told: list[Figures]) -> Iterator[Row]:
    levels = [one["level"] for one in told]
    autumn, until, last = levels[5:9], levels[9:13], levels[13:]
    yield Row(f"{name}: WARN by 4 October", "WARN", ", ".join(until), until[-1] != "OK")
    are_errors = all(level == "ERROR" for level in last)
    yield Row("  9, 11 and 12 October", "ERROR", ", ".join(last), are_errors)
    yield Row("  tests 6 to 9", "<= WARN", ", ".join(autumn), "ERROR" not in autumn)
    [*_, fourth] = (one["life_days"] for one in told if one["date"] == "2017-10-04")
    yield Row(
        "  4 October, life to 1.5 times healthy, 5 to 95 % [d]",
        "holds 5",
        f"{fourth[0]:.1f} to {fourth[2]:.1f}" if fourth else "none",
        bool(fourth) and fourth[0] <= 5.0 <= fourth[2],
    )
    september = [one for one in told if "2017-09" in one["date"] and one["life_days"]]
    yield none_of("  lives predicted in September", len(september))


def tables(figures: Figures) -> Iterator[Table]:
    """Return what is printed below the targets."""
    yield grid(
        "trials that depart or have a fault",
        ("state", *(f"{load} kg" for load in LOADS)),
        (
            (
                state,
                *(
                    f"{sum(map(is_found, cell))} of {len(cell)}"
                    for load in LOADS
                    for cell in [by_load.get(str(load), [])]
                ),
            )
            for state, by_load in figures["trials"].items()
        ),
    )
    for name, told in figures["aircraft"].items():
        yield grid(
            name,
            ("test", "date", "ratio", "level", "probability", "life [d]"),
            (
                (
                    *(one[key] for key in ("test", "date", "ratio", "level")),
                    f"{one['probability']:.1e}",
                    " / ".join(f"{value:.1f}" for value in one["life_days"] or ()),
                )
                for one in told
            ),
        )


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw how far trials of the ball screw depart, and the life of the aircraft actuator."""
    picture, (left, right) = plt.subplots(
        1, 2, figsize=(12.0, 4.6), layout="constrained", width_ratios=(3, 2)
    )
    states = list(figures["trials"])
    for load, marker, colour in zip(LOADS, "o^s", ("C0", "C1", "C2"), strict=True):
        for at, state in enumerate(states):
            values = np.array([one[0] for one in figures["trials"][state].get(str(load), [])])
            size = -np.log10(np.clip(values, 1e-12, 1.0))
            offset = 0.22 * (LOADS.index(load) - 1)
            label = f"{load} kg" if at == 0 else None
            places = np.full(len(size), at + offset)
            left.plot(places, size, marker, color=colour, ms=4, label=label, ls="")
    left.axhline(-np.log10(DEPARTED), color="0.3", lw=1, ls="--")
    left.text(3.6, 2.1, "departs above", fontsize=8)
    left.set_xticks(range(len(states)), states, rotation=60, ha="right", fontsize=8)
    left.set_ylabel("- log10 of the probability for a healthy trial")
    left.set_title("ball screw: one mark a trial (12: 1e-12 or less)", fontsize=10)
    left.legend(fontsize=8)
    for name, told in figures["aircraft"].items():
        ratios = [one["ratio"] for one in told]
        numbers = np.arange(1, len(told) + 1)
        right.plot(numbers, ratios, "-", color="0.7", lw=1)
        for level, colour in (("STALE", "0.5"), ("OK", "C2"), ("WARN", "C1"), ("ERROR", "C3")):
            chosen = [one["level"] == level for one in told]
            label = {"STALE": "reference"}.get(level, level)
            right.plot(numbers[chosen], np.array(ratios)[chosen], "o", color=colour, label=label)
        right.axhline(LIMIT, color="0.3", lw=1, ls="--")
        dates = [one["date"][5:] for one in told]
        right.set_xticks(numbers, dates, rotation=60, ha="right", fontsize=8)
        right.set_title(f"{name}: current over healthy, 2017", fontsize=10)
    right.legend(fontsize=8)
    picture.savefig(path, dpi=110)


FOLDER: Final = click.Path(exists=True, file_okay=False, path_type=Path)
main = command(
    measure,
    "real machines",
    rows,
    tables,
    width=110,
    folder=click.Argument(["folder"], type=FOLDER),
    picture=click.Option(["--picture"], type=click.Path(path_type=Path), help="Draw both."),
)

if __name__ == "__main__":
    main()
