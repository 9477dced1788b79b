"""Samples lost and latency in a live graph of three processes, read from the bags of demos.

    python benchmarks/live.py [--demos N] [--duration S] [--json FILE]

Actuator, monitor and recorder run as processes at 10,000 samples a second, in one demo after the
other, since an actuator of the demo wears out within a minute. Prints how many samples got lost on
the way to the monitor and to the recorder, and the time from a window's last sample to the
reception of its estimate; writes JSON.
"""

import json
import subprocess
import tempfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from ema_bags.reader import Bag
from ema_ros.stamps import stamp_from_message

_TELEMETRY: Final = "/ema/telemetry"
_ESTIMATES: Final = "/ema/fault_estimate"
_STATUS: Final = "/diagnostics"


@dataclass(frozen=True)
class Demo:
    """What the bag of a demo contains.

    Attributes
    ----------
    counts
        Of samples, blocks, windows and estimates.
    latencies_s
        From a window's last sample to the reception of its estimate, by the recorder [s].
    computing_s
        From window to estimate, as the monitor says [s].
    evaluations
        Windows of the model that an estimate took.
    reasons
        Why estimates were not valid.
    """

    counts: dict[str, int]
    latencies_s: list[float]
    computing_s: list[float]
    evaluations: list[int]
    reasons: list[str]


def read(path: Path) -> Demo:
    """Return what a demo's bag contains."""
    bag = Bag(path)
    blocks = [
        (item.message.first_index, len(item.message.command)) for item in bag.messages([_TELEMETRY])
    ]
    missing = [after[0] - before[0] - before[1] for before, after in pairwise(blocks)]
    estimates = list(bag.messages([_ESTIMATES]))
    valid = [item for item in estimates if item.message.valid]
    statuses = [
        {pair.key: pair.value for pair in status.values}
        for item in bag.messages([_STATUS])
        for status in item.message.status
        if status.name.startswith("/ema/monitor: ") and status.name.endswith(" telemetry")
    ]
    last = statuses[-1]
    return Demo(
        {
            "samples": sum(count for _, count in blocks),
            "samples_lost_by_recorder": sum(missing),
            "blocks_heard_by_monitor": int(last["blocks"]),
            "samples_lost_by_monitor": int(last["samples lost"]),
            "windows": int(last["windows"]),
            "estimates": len(valid),
            "warm_estimates": sum(item.message.warm_start for item in valid),
        },
        [(item.log_time_ns - stamp_from_message(item.message.window_end)) * 1e-9 for item in valid],
        [item.message.computing_time for item in valid],
        [item.message.evaluations for item in valid],
        [item.message.reason for item in estimates if not item.message.valid],
    )


def pooled(demos: list[Demo]) -> dict[str, Any]:
    """Return the figures of all demos together."""
    rows = {
        "latency": [value for demo in demos for value in demo.latencies_s],
        "computing": [value for demo in demos for value in demo.computing_s],
    }
    figures: dict[str, Any] = {
        name: sum(demo.counts[name] for demo in demos) for name in demos[0].counts
    }
    for name, values in rows.items():
        figures[f"{name}_median_s"] = float(np.median(values))
        figures[f"{name}_95_percent_s"] = float(np.quantile(values, 0.95))
    evaluations = [value for demo in demos for value in demo.evaluations]
    return figures | {
        "evaluations_median": float(np.median(evaluations)),
        "reasons": [reason for demo in demos for reason in demo.reasons],
    }


@click.command()
@click.option("--demos", "count", default=4, show_default=True, type=click.IntRange(1))
@click.option("--duration", "duration_s", default=55.0, show_default=True, help="Of a demo [s].")
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
def main(count: int, duration_s: float, output: Path | None) -> None:
    """Print the table and write the JSON file."""
    demos = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(count):
            place = Path(folder, str(number))
            command = ["ema", "demo", "--duration", str(duration_s), "-o", str(place)]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            demos.append(read(place / "bag"))
    figures = pooled(demos)
    table = Table("live graph", "", title=f"{count} demos of {duration_s:g} s at 10 kHz")
    for name, value in figures.items():
        if name == "reasons":
            continue
        table.add_row(
            name.replace("_", " "), f"{value:.3f}" if isinstance(value, float) else str(value)
        )
    Console(width=100).print(table)
    for reason in figures["reasons"]:
        click.echo(f"no valid estimate: {reason}")
    if output:
        output.write_text(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
