# SPDX-License-Identifier: Apache-2.0
"""Cost and scatter of learning a joint's baseline from the work of a simulated arm.

    python benchmarks/learning.py [--seed N] [--records N] [--json FILE]

Each joint of the arm works in cycles of 20 s with short rests and a payload of 2 kg. One record per
minute is stored and fitted, as in a monitor. The benchmark measures the processor time. It also
compares the scatter of friction between healthy records by how they are cut: at any phase of the
work cycle or at its start, with a length of less than one cycle, one cycle, or three cycles.
"""

import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, at_most, grid

from ema_core.acquisition import Acquisition
from ema_core.description import ActuatorDescription
from ema_core.parameters import NEUTRAL, ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.baselines.unit_baseline import UnitBaseline
from ema_monitor.calibration.joint_calibration import calibrate_joint
from ema_monitor.joint.learning import unusable
from ema_monitor.joint.shape import DRY
from ema_monitor.quantities import FRICTION
from ema_monitor.windows.window import Window
from ema_sim.robot.work import WorkSettings, simulate_work

MOST_PERCENT: Final = 0.5
"""Largest processor time of learning a joint [% of a core]."""

_RATE: Final = 100
_START_NS: Final = 1_700_000_000_000_000_000
_MINUTE: Final = 60 * _RATE
_JOINTS: Final = 6
_HEALTHY: Final = 12
_WARM: Final = 20
"""Cycles before the compared records, in which the gears warm up."""


class Work(NamedTuple):
    """Columns of all joints, ``(n, 6)`` each, and the index of the first sample of each cycle."""

    command: NDArray[np.float64]
    effort: NDArray[np.float64]
    position: NDArray[np.float64]
    speed: NDArray[np.float64]
    starts: NDArray[np.intp]

    def record(self, joint: int, first: int, samples: int) -> Window:
        """Return a record of a joint, from the index of its first sample and its length."""
        part = slice(first, first + samples)
        columns = (column[part, joint] for column in self[:-1])
        command, effort, position, speed = columns
        stamp_ns = _START_NS + first * 10**9 // _RATE
        return Window(Telemetry(stamp_ns, 1.0 / _RATE, first, command, effort, position, speed))


def work_of(seed: int, hours: float) -> Work:
    """Return the simulated work of an arm."""
    settings = WorkSettings(cycle_pause=1.0, payload=2.0)
    parts = [
        part
        for _, part in simulate_work(hours, seed=seed, sample_rate=_RATE, work=lambda _: settings)
    ]
    ends = np.cumsum([len(part) for part in parts])
    names = ("position_command", "effort", "position", "velocity")
    columns = (np.concatenate([getattr(part, name) for part in parts]) for name in names)
    command, effort, position, speed = columns
    return Work(command, effort, position, speed, np.concatenate([[0], ends[:-1]]))


def described(joint: int) -> ActuatorDescription:
    """Return the description of a joint."""
    return ActuatorDescription(
        f"joint_{joint}",
        "1",
        "",
        sample_period=1.0 / _RATE,
        drive="unknown",
        parameters=replace(ActuatorParameters(), **NEUTRAL),
        acquisition=Acquisition(effort_unit="N.m"),
    )


def cores_of(work: Work, joint: int, records: int) -> float:
    """Return the processor time of learning a joint per second of its records [cores].

    Each of the ``records`` lasts a minute.
    """
    with (
        tempfile.TemporaryDirectory(prefix="ema_learning_") as folder,
        UnitBaseline(Path(folder), described(joint)) as baseline,
    ):
        begin_s = time.process_time()
        for number in range(records):
            window = work.record(joint, number * _MINUTE, _MINUTE)
            if unusable(window.telemetry, described(joint)) is None:
                baseline.add(window)
            if baseline.is_fit_due:
                baseline.fit()
            baseline.progress()
        return (time.process_time() - begin_s) / (60.0 * records)


def scatter_of(work: Work, joint: int, firsts: list[int], samples: int) -> tuple[float, float]:
    """Return the scatter and the smallest detectable change of friction [-].

    Both are NaN if the records give no baseline, or if fewer than half of ``_HEALTHY`` are used.
    """
    records = [work.record(joint, first, samples) for first in firsts]
    try:
        calibration = calibrate_joint(records, described(joint))
    except ValueError:
        return float("nan"), float("nan")
    if calibration.windows < _HEALTHY // 2:
        return float("nan"), float("nan")
    values = calibration.baseline.values[:, DRY]
    smallest = calibration.comparer.smallest_changes_of_a_day[FRICTION]
    return float(np.std(values, ddof=1) / np.mean(values)), smallest


def measure(pool: Workers, seed: int, records: int) -> Figures:
    """Measure the processor time of learning, and the scatter of friction by the cut of records."""
    work = work_of(seed, (records + 2) / 60.0)
    cores = [cores_of(work, joint, records) for joint in pool.track("joints", list(range(3)))]
    cycle = int(work.starts[1])
    rng = np.random.default_rng(seed)
    begins = work.starts[_WARM : _WARM + 3 * _HEALTHY : 3].tolist()
    cuts = []
    for samples in (12 * _RATE, cycle, 3 * cycle):
        for is_at_start in (True, False):
            firsts = [first + (0 if is_at_start else int(rng.integers(cycle))) for first in begins]
            scatters = [scatter_of(work, joint, firsts, samples) for joint in range(_JOINTS)]
            cuts.append(
                {
                    "length_s": samples / _RATE,
                    "cut": "start of the cycle" if is_at_start else "any phase",
                    "scatter_percent": [100.0 * scatter for scatter, _ in scatters],
                    "smallest_percent": [100.0 * smallest for _, smallest in scatters],
                }
            )
    return {"cores": cores, "cuts": cuts}


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    what = "learning a joint at 100 Hz, one record a minute: % of a core"
    yield at_most(what, 100.0 * max(figures["cores"]), MOST_PERCENT)


def tables(figures: Figures) -> Iterator[Table | str]:
    """Yield tables of scatter and smallest change of friction, by the cut of the records."""
    joints = [f"joint {number + 1}" for number in range(_JOINTS)]
    for name, title in (
        ("scatter_percent", "standard deviation of friction of healthy records [%]"),
        ("smallest_percent", "smallest change of friction that would show [%]"),
    ):
        shown = ([cut["length_s"], cut["cut"], *cut[name]] for cut in figures["cuts"])
        yield grid(title, ["length [s]", "cut", *joints], shown, digits=3)


main = command(measure, "learning of a joint", rows, tables, width=130, seed=1, records=60)

if __name__ == "__main__":
    main()
