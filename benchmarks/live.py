"""Samples lost and latency in a live graph of three processes, read from the bags of demos.

    python benchmarks/live.py [--demos N] [--duration S] [--json FILE]

Actuator, monitor and recorder run as processes at 10,000 samples a second, in one demo after the
other, since an actuator of the demo wears out within a minute. Prints how many samples got lost on
the way to the monitor and to the recorder, and the time from a window's last sample to the
reception of its estimate; writes JSON.
"""

import subprocess
import tempfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from trials import command

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


def measure(progress: Progress, demos: int, duration: int) -> dict[str, Any]:
    """Print what is lost and how late estimates are in so many demos, each of a duration [s]."""
    read_demos = []
    with tempfile.TemporaryDirectory() as folder:
        for number in progress.track(range(demos), description="demos"):
            place = Path(folder, str(number))
            words = ["ema", "demo", "--duration", str(duration), "-o", str(place)]
            subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
            read_demos.append(read(place / "bag"))
    return pooled(read_demos)


def show(console: Console, figures: dict[str, Any]) -> None:
    """Print the figures, and why estimates were not valid."""
    table = Table("live graph at 10 kHz", "")
    for name, value in figures.items():
        text = f"{value:.3f}" if isinstance(value, float) else str(value)
        if name != "reasons":
            table.add_row(name.replace("_", " "), text)
    console.print(table)
    for reason in figures["reasons"]:
        console.print(f"no valid estimate: {reason}")


main = command(measure, show, 100, demos=4, duration=55)

if __name__ == "__main__":
    main()
