# SPDX-License-Identifier: Apache-2.0
"""Speed of the two model kernels compared with C++ on this computer.

    python benchmarks/kernels.py [--json FILE]

The speed of the monitor model is in windows of 0.5 s per second, and as a ratio to the yardstick.
The speed of the reference actuator is in time per step, and as a ratio to the same steps in scalar
C++. The programs compared run in turns, and each ratio is taken within one turn. Needs g++.
"""

import os
import statistics
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Final

import numpy as np
import yardstick_form
from rich.table import Table
from script import Figures, Workers, command, in_a_process
from targets import Row, at_least, at_most, grid, untargeted
from yardstick import HERE, build, seconds_per_window

from ema_core.commands import Command
from ema_core.faults import fault_vector, random_faults
from ema_core.parameters import ActuatorParameters
from ema_core.simd import LANES
from ema_core.telemetry import COLUMNS, Telemetry
from ema_monitor.model.monitor_model import MonitorModel
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator

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
SHARE: Final = 0.9
"""Least speed of the batch kernel in the yardstick's form, over the speed of the yardstick [-]."""
SCALING: Final = 1.7
"""Least speed of two cores over one, from batches of 64 on [-]."""
LARGE_BATCH: Final = 64


def monitor_seconds(cores: int) -> dict[str, float]:
    """Return the time of a window [s], by step and batch, on a number of cores.

    With one core, the time of the yardstick's form is included. Restricts this process to these
    cores.
    """
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
        lanes, chirp = yardstick_form.individuals(), yardstick_form.command()
        current = np.empty((LANES, len(chirp) // yardstick_form.DECIMATION))
        work = partial(yardstick_form.run, lanes, chirp, yardstick_form.STEP_S, current)
        times[YARDSTICK_FORM] = best_time(work) / LANES
    return times


def best_time(work: Callable[[], object]) -> float:
    """Return the time of the fastest of several calls after a warm-up call [s].

    The yardstick reports its own time in the same manner.
    """
    work()
    times = []
    for _ in range(CALLS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def reference_step(case: str) -> float:
    """Return the time of a step of the reference actuator [s]."""
    actuator = SimulatedActuator(sample_period=SAMPLE_PERIOD)
    actuator.faults = fault_vector(FAULTS[case])
    start = time.perf_counter()
    actuator.advance(COMMAND)
    return (time.perf_counter() - start) / round(len(COMMAND) * SAMPLE_PERIOD / 1e-6)


def cpp(*arguments: str) -> str:
    """Return the output of the C++ twin of the reference actuator."""
    program = build(HERE / "reference_step.cpp")
    return subprocess.run(
        [program, *arguments], check=True, capture_output=True, text=True, encoding="utf-8"
    ).stdout


def cpp_difference() -> float:
    """Return the largest difference of the smoothed current between both references [A].

    The Hann window of 2 ms is necessary because single samples are chaotic: they differ as soon as
    a leg switches a step earlier in one of the programs.
    """
    hann, worst = np.hanning(round(2e-3 / SAMPLE_PERIOD) + 2), 0.0
    currents = np.split(np.array(cpp("--current").split(), float), 2)
    for case, current in zip(FAULTS, currents, strict=True):
        actuator = SimulatedActuator(sample_period=SAMPLE_PERIOD)
        actuator.faults = fault_vector(FAULTS[case])
        difference = actuator.advance(COMMAND).current - current
        worst = max(worst, float(np.abs(np.convolve(difference, hann / hann.sum())).max()))
    return worst


def summary(values: Sequence[float]) -> dict[str, float]:
    """Return the median and the 95th percentile."""
    return {"median": statistics.median(values), "p95": float(np.percentile(values, 95))}


def compared(values: Iterable[float], ratios: Iterable[float]) -> Figures:
    """Return the summaries of measured values, and of their ratios to a reference."""
    return {"value": summary([*values]), "ratio": summary([*ratios])}


def measure(pool: Workers, turns: int) -> Figures:
    """Measure the speeds of the kernels in turns."""
    unit: list[float] = []
    # Seconds of each turn: of the monitor by cores and run, of the reference by case and build.
    monitor: dict[int, list[dict[str, float]]] = {1: [], 2: []}
    reference: dict[str, dict[str, list[float]]] = {
        case: {name: [] for name in ("C++", "numba")} for case in FAULTS
    }
    difference = cpp_difference()
    for _ in pool.track("turns", range(turns)):
        unit.append(seconds_per_window())
        for cores, results in monitor.items():
            results.append(in_a_process(monitor_seconds, cores))
        for case, _, nanoseconds in map(str.split, cpp().splitlines()):
            reference[case]["C++"].append(1e-9 * float(nanoseconds))
        for case, by_name in reference.items():
            by_name["numba"].append(statistics.median(reference_step(case) for _ in range(5)))

    def speed(run: str, cores: int) -> Figures:
        seconds = [times[run] for times in monitor[cores]]
        ratios = (u / s for u, s in zip(unit, seconds, strict=True))
        return compared((1.0 / s for s in seconds), ratios)

    return {
        "yardstick_windows_per_s": summary([1.0 / u for u in unit]),
        "yardstick_form": speed(YARDSTICK_FORM, 1),
        "monitor": {
            f"{dt:g} {batch}": {
                "dt_s": dt,
                "batch": batch,
                "cores_1": speed(f"{dt:g} {batch}", 1),
                "cores_2": speed(f"{dt:g} {batch}", 2),
                "scaling": summary(
                    [
                        first[f"{dt:g} {batch}"] / second[f"{dt:g} {batch}"]
                        for first, second in zip(*monitor.values(), strict=True)
                    ]
                ),
            }
            for dt in STEPS_S
            for batch in BATCHES
        },
        "reference": {
            case: {
                name: compared(
                    (1e9 * s for s in seconds),
                    (n / s for n, s in zip(by_name["numba"], seconds, strict=True)),
                )
                for name, seconds in by_name.items()
            }
            for case, by_name in reference.items()
        },
        "reference_difference_A": difference,
    }


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    form = figures["yardstick_form"]["ratio"]["median"]
    yield at_least("kernel, yardstick's form, 16 lanes, of the yardstick's speed", form, SHARE)
    for run in figures["monitor"].values():
        ratio = run["cores_1"]["ratio"]["median"]
        what = f"  shipped form, {1e6 * run['dt_s']:.0f} us steps, {run['batch']} individuals"
        yield untargeted(what, f"{ratio:.2f}")
        if run["batch"] >= LARGE_BATCH:
            yield at_least("  two cores over one", run["scaling"]["median"], SCALING)
    for case, by_name in figures["reference"].items():
        ratio, time_ns = by_name["C++"]["ratio"]["median"], by_name["numba"]["value"]["median"]
        what = f"reference step, {case}, time over C++"
        yield at_most(what, ratio, 1.0, f"{ratio:.2f} ({time_ns:.0f} ns)")


def tables(figures: Figures) -> Iterator[Table | str]:
    """Yield the tables to print below the targets."""
    measured = {f"its form through our {LANES} lanes": figures["yardstick_form"]}
    for run in figures["monitor"].values():
        what = f"pair form, {1e6 * run['dt_s']:.0f} us, {run['batch']}"
        measured[f"{what}, one core"] = run["cores_1"]
        measured[f"{what}, two cores"] = run["cores_2"]
    yield grid(
        f"windows/s; the yardstick, one core: {figures['yardstick_windows_per_s']['median']:.0f}",
        ("what", "median", "95 %", "ratio", "95 %"),
        (
            (what, *times["value"].values(), *times["ratio"].values())
            for what, times in measured.items()
        ),
    )
    yield grid(
        "reference [ns/step]; numba over it",
        ("what", "median", "95 %", "ratio", "95 %"),
        (
            (f"{case}, {name}", *times["value"].values(), *times["ratio"].values())
            for case, by_name in figures["reference"].items()
            for name, times in by_name.items()
        ),
    )
    difference = figures["reference_difference_A"]
    yield f"reference, numba less C++, smoothed current: {difference:.2g} A at most"


main = command(measure, "kernels", rows, tables, width=100, turns=11)

if __name__ == "__main__":
    main()
