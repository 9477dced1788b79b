"""Speed of the two model kernels against C++, on this computer.

    python benchmarks/kernels.py [--json FILE]

The monitor model in windows of 0.5 s per second, and as a ratio to the yardstick; the reference
actuator in time per step, and as a ratio to the same steps in scalar C++. What is compared
alternates, and each ratio is taken within one turn. Prints a table and writes JSON. Needs g++.
"""

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any, Final

import click
import numpy as np
import yardstick_form
from rich.console import Console
from rich.markup import escape
from rich.progress import track
from rich.table import Table
from yardstick import HERE, build, seconds_per_window

from ema_core.commands import Command
from ema_core.faults import fault_vector, random_faults
from ema_core.parameters import ActuatorParameters
from ema_core.simd import LANES
from ema_core.telemetry import COLUMNS, Telemetry
from ema_monitor.model.monitor_model import MonitorModel
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator

TURNS: Final = 11
CALLS: Final = 10
YARDSTICK_FORM: Final = "yardstick form"
BATCHES: Final = (16, 32, 64, 256)
STEPS_S: Final = (1e-5, 2e-5)
SAMPLE_PERIOD: Final = 1e-4
COMMAND: Final = Command().sample(SAMPLE_PERIOD)
FAULTS: Final = {
    "healthy": {},
    "faulty": {"eccentricity": 0.3, "short_circuit_a": 0.2, "friction": 0.25},
}
BUILDS: Final = {"C++": (), "C++ -ffast-math": ("-ffast-math",)}


def monitor_seconds(cores: int) -> dict[str, float]:
    """Time of a window [s] by step and batch, with so many cores, measured in this process."""
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])
    rest = np.concatenate([[0.0], COMMAND])
    idle = (np.zeros(len(rest)) for _ in COLUMNS[1:])
    window = Window(Telemetry(0, SAMPLE_PERIOD, 0, rest, *idle))
    rng = np.random.default_rng(1)
    population = np.array([random_faults(rng) for _ in range(max(BATCHES))])
    times = {}
    for dt in STEPS_S:
        model = MonitorModel(ActuatorParameters(), dt=dt)
        for batch in BATCHES:
            faults = population[:batch]
            times[f"{dt:g} {batch}"] = best_time(partial(model.respond, window, faults)) / batch
    if cores == 1:
        lanes, command = yardstick_form.individuals(), yardstick_form.command()
        current = np.empty((LANES, len(command) // yardstick_form.DECIMATION))
        dt = yardstick_form.STEP_S
        times[YARDSTICK_FORM] = (
            best_time(lambda: yardstick_form.run(lanes, command, dt, current)) / LANES
        )
    return times


def best_time(work: Callable[[], object]) -> float:
    """Time of the fastest of some calls after a first one [s], as the yardstick reports its own."""
    work()
    times = []
    for _ in range(CALLS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def in_process(cores: int) -> dict[str, float]:
    """Measure in a process of its own, which keeps to so many cores."""
    command = [sys.executable, __file__, "--cores", str(cores)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def reference_step(case: str) -> float:
    """Time of a step of the reference actuator [s]."""
    actuator = SimulatedActuator(sample_period=SAMPLE_PERIOD)
    actuator.faults = fault_vector(FAULTS[case])
    start = time.perf_counter()
    actuator.advance(COMMAND)
    return (time.perf_counter() - start) / round(len(COMMAND) * SAMPLE_PERIOD / 1e-6)


def cpp_steps(flags: Iterable[str]) -> dict[str, float]:
    """Time of a step of the C++ twin [s] by case, median of its repetitions."""
    program = build(HERE / "reference_step.cpp", *flags)
    printed = subprocess.run([program], check=True, capture_output=True, text=True).stdout
    return {case: 1e-9 * float(median) for case, _, median in map(str.split, printed.splitlines())}


def cpp_difference() -> float:
    """Return the largest difference of the smoothed current between both references [A].

    Smoothed by a Hann window of 2 ms, as single samples are chaotic once a leg switches a step
    earlier in one of them.
    """
    program = build(HERE / "reference_step.cpp")
    printed = subprocess.run(
        [program, "--current"], check=True, capture_output=True, text=True
    ).stdout
    hann = np.hanning(round(2e-3 / SAMPLE_PERIOD) + 2)
    worst = 0.0
    for case, cpp in zip(FAULTS, np.split(np.array(printed.split(), float), 2), strict=True):
        actuator = SimulatedActuator(sample_period=SAMPLE_PERIOD)
        actuator.faults = fault_vector(FAULTS[case])
        difference = actuator.advance(COMMAND).current - cpp
        worst = max(worst, float(np.abs(np.convolve(difference, hann / hann.sum())).max()))
    return worst


def summary(values: list[float]) -> dict[str, float]:
    """Median and 95th percentile."""
    return {"median": statistics.median(values), "p95": float(np.percentile(values, 95))}


@click.command()
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--cores", type=int, hidden=True)
def main(output: Path | None, cores: int | None) -> None:
    """Print the table and write the JSON file."""
    if cores is not None:
        click.echo(json.dumps(monitor_seconds(cores)))
        return
    console = Console(width=100)
    unit: list[float] = []
    monitor: dict[str, dict[str, list[float]]] = {"1": {}, "2": {}}
    reference: dict[str, dict[str, list[float]]] = {case: {} for case in FAULTS}
    difference = cpp_difference()
    for _ in track(range(TURNS), "turns", console=Console(stderr=True)):
        unit.append(seconds_per_window())
        for cores_text, by_run in monitor.items():
            for run, seconds in in_process(int(cores_text)).items():
                by_run.setdefault(run, []).append(seconds)
        for name, flags in BUILDS.items():
            for case, seconds in cpp_steps(flags).items():
                reference[case].setdefault(name, []).append(seconds)
        for case, by_name in reference.items():
            by_name.setdefault("numba", []).append(
                statistics.median(reference_step(case) for _ in range(5))
            )
    results: dict[str, Any] = {
        "yardstick_windows_per_s": summary([1 / u for u in unit]),
        "monitor": {},
        "reference": {},
        "reference_difference_A": difference,
    }
    table = Table("what", "median", "95 %", "ratio", "95 %", title="kernels")
    for column in table.columns[1:]:
        column.justify = "right"

    def row(name: str, values: list[float], ratios: list[float], digits: int) -> dict[str, Any]:
        result = {"value": summary(values), "ratio": summary(ratios)}
        cells = [f"{x:.{digits}f}" for x in result["value"].values()]
        table.add_row(escape(name), *cells, *(f"{x:.2f}" for x in result["ratio"].values()))
        return result

    row("yardstick [windows/s], one core", [1 / u for u in unit], [1.0], 0)
    form = monitor["1"].pop(YARDSTICK_FORM)
    results["yardstick_form"] = row(
        f"its form through our lanes [windows/s], {LANES}, one core",
        [1 / t for t in form],
        [u / t for u, t in zip(unit, form, strict=True)],
        0,
    )
    for run in monitor["1"]:
        dt, batch = run.split()
        rates = {n: [1 / t for t in monitor[n][run]] for n in monitor}
        results["monitor"][run] = {
            "dt_s": float(dt),
            "batch": int(batch),
            "scaling": summary([b / a for a, b in zip(rates["1"], rates["2"], strict=True)]),
        }
        for n, values in rates.items():
            name = f"pair form [windows/s], {1e6 * float(dt):.0f} us, {batch}, cores: {n}"
            ratios = [rate * u for rate, u in zip(values, unit, strict=True)]
            results["monitor"][run][f"cores_{n}"] = row(name, values, ratios, 0)
        scaling = results["monitor"][run]["scaling"]
        table.add_row("  two cores over one", "", "", *(f"{x:.2f}" for x in scaling.values()))
    for case, by_name in reference.items():
        results["reference"][case] = {}
        for name, seconds in by_name.items():
            ratios = [n / s for n, s in zip(by_name["numba"], seconds, strict=True)]
            results["reference"][case][name] = row(
                f"reference {case} [ns/step], {name}; numba over it",
                [1e9 * s for s in seconds],
                ratios,
                1,
            )
    console.print(table)
    console.print(f"reference, numba less C++, smoothed current: {difference:.2g} A at most")
    if output:
        output.write_text(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
