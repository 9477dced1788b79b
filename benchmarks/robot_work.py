# SPDX-License-Identifier: Apache-2.0
"""Arms at work: the wear at which a worn joint is identified, and false alarms on healthy days.

    python benchmarks/robot_work.py [--seeds N] [--hours H] [--json FILE]

Units of the simulated six-joint arm work in a pick-and-place cycle. Their telemetry is written to
files. `ema attach` recognises the columns, learns the baselines and reports the levels. Each case
runs twice: with the mass of the payload in a column `payload`, and without this column.

- Wear: 24 healthy cycles are followed by cycles in which the friction of one joint rises by 3 %
  each. For each joint, the benchmark reports the true increase in the first record with a warning
  that names friction, and whether any other joint is above OK.
- Work: two healthy arms, 12 joints, learn on three days and then work for ``--hours``, with
  payloads and temperatures that change over the day. No joint may give a warning.
"""

import json
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from click.testing import CliRunner
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, at_most, none_of

from ema_cli.main import main as ema
from ema_sim.robot.arm import JOINT_NAMES
from ema_sim.robot.work import RobotArm, WorkSettings, work_of_day

RATE: Final = 100
"""Sample rate [Hz]."""
START_S: Final = 1_793_664_000.0
"""Start of the first day [s]: 2026-11-03 in UTC."""
HEALTHY_CYCLES: Final = 24
WORN_CYCLES: Final = 14
GROWTH: Final = 0.03
"""Increase of friction per cycle, relative to healthy [-]."""
NAMED_BY: Final = 0.15
"""Increase of friction by which the joint should be named [-]."""

_DAY_S: Final = 86_400.0
_LEARNED_H: Final = (8.0, 12.0, 16.0)  # hour of the day at which records are learned
_LEARNED_CYCLES: Final = 10
_WORK_PAUSE_S: Final = 30.0

PAYLOADS: Final = {"known": True, "unknown": False}
"""Variants of the files by their name in the figures: True with a column `payload`."""


class _Log(NamedTuple):
    """Log of an arm's work: samples, and the end [s] and friction ratios of each cycle.

    The ratios are friction over healthy friction, one per joint.
    """

    start_s: float
    columns: dict[str, Any]
    ends_s: list[float]
    ratios: list[Any]


def log_of(
    arm: RobotArm, start_s: float, cycles: Sequence[tuple[WorkSettings, dict[str, float]]]
) -> _Log:
    """Simulate cycles, each with settings and wear by joint, from a time on. Return their log."""
    blocks, ends_s, ratios, samples = [], [], [], 0
    for work, wear in cycles:
        cycle = arm.begin_cycle(work, wear)
        blocks += list(cycle.blocks)
        samples += cycle.samples
        ends_s.append(start_s + samples / RATE)
        ratios.append(cycle.friction_ratio)
    columns = {"time": start_s + np.arange(samples) / RATE}
    columns["payload"] = np.concatenate([block.payload for block in blocks])
    for name in ("position", "velocity", "effort"):
        values = np.concatenate([getattr(block, name) for block in blocks])
        columns |= {f"{joint}_{name}": values[:, i] for i, joint in enumerate(JOINT_NAMES)}
    return _Log(start_s, columns, ends_s, ratios)


def attached(logs: Sequence[_Log], healthy: str, *, has_payload: bool) -> dict[str, Any]:
    """Return the report of `ema attach` for files of the logs, by joint.

    ``healthy`` is the argument of ``--healthy``. ``has_payload`` False omits the column `payload`.
    """
    with tempfile.TemporaryDirectory() as name:
        for number, log in enumerate(logs):
            columns = {
                key: values
                for key, values in log.columns.items()
                if has_payload or key != "payload"
            }
            np.savez(Path(name, f"log_{number:02d}.npz"), **columns)
        result = CliRunner().invoke(ema, ["attach", name, "--healthy", healthy, "--json"])
    if result.exit_code not in (0, 3):
        raise RuntimeError(result.output) from result.exception
    return {joint["joint"]: joint for joint in json.loads(result.stdout)}


def wear_case(case: tuple[int, str]) -> dict[str, Any]:
    """Return the outcomes for an arm with one wearing joint, by ``PAYLOADS``."""
    seed, joint = case
    arm = RobotArm(seed=seed, sample_rate=RATE)
    work = WorkSettings(healthy_cycles=0)
    healthy = log_of(arm, START_S, [(work, {})] * HEALTHY_CYCLES)
    worn = log_of(arm, START_S + 7200.0, [(work, {joint: GROWTH})] * WORN_CYCLES)
    return {
        name: _wear_outcome(
            joint,
            worn,
            np.mean(healthy.ratios, axis=0),
            attached((healthy, worn), "2026-11-03T01:00", has_payload=has_payload),
        )
        for name, has_payload in PAYLOADS.items()
    }


def _wear_outcome(joint: str, worn: _Log, healthy: Any, joints: dict[str, Any]) -> dict[str, Any]:
    """Return the outcome of a report: errors of the wearing joint, and the other joints.

    ``named_at`` is the true increase of friction in the first record that names it [-], or None.
    ``healthy`` has the mean friction ratio of each joint in the healthy cycles.
    """
    at = JOINT_NAMES.index(joint)
    named = None
    for record in joints[joint]["records"]:
        if record["level"] in ("WARN", "ERROR") and "friction" in record["changed"]:
            last = np.searchsorted(worn.ends_s, 1e-9 * record["end_ns"])
            named = float(worn.ratios[min(last, WORN_CYCLES - 1)][at]) - 1.0
            break
    levels = {
        name: {record["level"] for record in item["records"]} for name, item in joints.items()
    }
    false_alarms = [
        name for name, reported in levels.items() if name != joint and reported & {"WARN", "ERROR"}
    ]
    return {
        "joint": joint,
        "named_at": named,
        "errors": list(_errors(joints[joint], worn, at, float(healthy[at]))),
        "others": false_alarms,
        "unjudged": [
            name for name, reported in levels.items() if "OK" not in reported and name != joint
        ],
    }


def _errors(
    joint: dict[str, Any], worn: _Log, at: int, healthy: float
) -> Iterator[tuple[float, bool]]:
    """Yield the error of each reported change of friction [-], and whether its interval holds.

    Records without a change are skipped. ``healthy`` is the joint's mean friction ratio in the
    healthy cycles.
    """
    ends_s = np.array(worn.ends_s)
    ratios = np.array(worn.ratios)[:, at]
    for record in joint["records"]:
        friction = record["friction"]
        if friction is None or friction["change"] is None:
            continue
        first, last = np.searchsorted(ends_s, (1e-9 * record["start_ns"], 1e-9 * record["end_ns"]))
        truth = float(np.mean(ratios[first : last + 1])) / healthy - 1.0
        yield friction["change"] - truth, friction["low"] <= truth <= friction["high"]


def work_case(case: tuple[int, float]) -> dict[str, Any]:
    """Return the levels of a healthy arm at work, after learning on three days, by ``PAYLOADS``.

    ``case`` has the seed of the arm and the hours of work.
    """
    seed, hours = case
    arm = RobotArm(seed=seed, sample_rate=RATE)
    logs = []
    for day, hour in enumerate(_LEARNED_H):
        start_s = START_S + day * _DAY_S + 3600.0 * hour
        logs.append(log_of(arm, start_s, [(_work(hour), {})] * _LEARNED_CYCLES))
    for hour in range(round(hours)):
        start_s = START_S + 3 * _DAY_S + 3600.0 * hour
        count = int(3600.0 / (19.0 + _WORK_PAUSE_S))
        logs.append(log_of(arm, start_s, [(_work(hour), {})] * count))
    return {
        name: _work_outcome(attached(logs, "2026-11-06", has_payload=has_payload))
        for name, has_payload in PAYLOADS.items()
    }


def _work_outcome(joints: dict[str, Any]) -> dict[str, Any]:
    return {
        name: {
            "levels": [record["level"] for record in joint["records"]],
            "friction": [
                record["friction"]["change"] for record in joint["records"] if record["friction"]
            ],
            "reason": joint["reason"],
        }
        for name, joint in joints.items()
    }


def _work(hour: float) -> WorkSettings:
    work = work_of_day(hour % 24.0)
    return WorkSettings(
        cycle_pause=_WORK_PAUSE_S, payload=work.payload, ambient=work.ambient, healthy_cycles=0
    )


def measure(workers: Workers, seeds: int, hours: float) -> Figures:
    """Measure the wear at which joints are named, and false alarms of healthy arms."""
    cases = [(seed, joint) for seed in range(seeds) for joint in JOINT_NAMES]
    worn = workers.map("arms that wear", wear_case, cases)
    work = workers.map("arms at work", work_case, [(100 + arm, hours) for arm in range(2)])
    return {"wear": worn, "work": work, "hours": hours}


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    for payload in PAYLOADS:
        worn = [case[payload] for case in figures["wear"]]
        with_it = f", payload {payload}"
        late = [
            case
            for case in worn
            if case["named_at"] is None or case["named_at"] > NAMED_BY + GROWTH
        ]
        yield Row(
            f"joint that wears named by +{100 * NAMED_BY:.0f} %{with_it}",
            str(len(worn)),
            str(len(worn) - len(late)),
            not late,
        )
        yield none_of(f"other joints above OK{with_it}", sum(len(case["others"]) for case in worn))
        warned = [
            f"{name} of arm {number}"
            for number, arm in enumerate(figures["work"])
            for name, joint in arm[payload].items()
            if {"WARN", "ERROR"} & set(joint["levels"])
        ]
        yield none_of(
            f"healthy joints of 12 with a warning in {figures['hours']:g} h{with_it}",
            len(warned),
            ", ".join(warned),
        )
    errors = [abs(error) for case in figures["wear"] for error, _ in case["known"]["errors"]]
    yield at_most(
        "error of the friction ratio, 95 % of records [%]",
        100.0 * float(np.quantile(errors, 0.95)),
        5.0,
    )


def tables(figures: Figures) -> Iterator[Table]:
    """Yield a table with two rows for each joint."""
    table = Table(title=f"Friction of one joint rises by {100 * GROWTH:g} % a cycle")
    for heading in (
        *("joint", "payload", "named at [%]: median (worst)", "not named"),
        *("error [%]: median, rms, largest", "90 % interval holds [%]"),
        "without a level while others wear",
    ):
        table.add_column(heading, justify="right")
    for joint in JOINT_NAMES:
        for payload in PAYLOADS:
            table.add_row(joint, payload, *_cells([c[payload] for c in figures["wear"]], joint))
    yield table


def _cells(outcomes: Sequence[dict[str, Any]], joint: str) -> list[str]:
    cases = [case for case in outcomes if case["joint"] == joint]
    named = [100.0 * case["named_at"] for case in cases if case["named_at"] is not None]
    errors = np.array([error for case in cases for error, _ in case["errors"]])
    held = [holds for case in cases for _, holds in case["errors"]]
    other_cases = [case for case in outcomes if case["joint"] != joint]
    stale = sum(joint in case["unjudged"] for case in other_cases)
    size = "-"
    if len(errors):
        sizes = np.median(np.abs(errors)), np.sqrt(np.mean(errors**2)), np.max(np.abs(errors))
        size = ", ".join(f"{100.0 * error:.1f}" for error in sizes)
    return [
        f"{np.median(named):.1f} ({max(named):.1f})" if named else "-",
        str(len(cases) - len(named)),
        size,
        f"{100.0 * np.mean(held):.0f}" if held else "-",
        f"{stale} of {len(other_cases)}",
    ]


main = command(
    measure, "arms at work", rows, tables, quick={"seeds": 1, "hours": 2}, seeds=10, hours=24.0
)

if __name__ == "__main__":
    main()
