# SPDX-License-Identifier: Apache-2.0
"""Lost samples and latency in a live graph of three processes, read from the bags of demos.

    python benchmarks/live.py [--demos N] [--duration S] [--json FILE]

Actuator, monitor and recorder run as processes at 10,000 samples per second. Several short demos
follow each other, because the actuator of the demo wears out within a minute. Prints the number of
samples lost between actuator and monitor and between actuator and recorder, and the time from a
window's last sample to the reception of its estimate. Writes JSON.
"""

import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, at_least, at_most, grid, none_of

from ema_bags.reader import Bag
from ema_ros.stamps import stamp_from_message

_TELEMETRY: Final = "/ema/telemetry"
_ESTIMATES: Final = "/ema/fault_estimate"
_STATUS: Final = "/ema/node_status"


def read(path: Path) -> Figures:
    """Return the counts of a demo's bag, and lists with an item per estimate.

    The lists of times and evaluations have the valid estimates, ``reasons`` has the invalid ones.
    """
    bag = Bag(path)
    blocks = [
        (item.message.first_index, len(item.message.command)) for item in bag.messages([_TELEMETRY])
    ]
    estimates = list(bag.messages([_ESTIMATES]))
    valid = [item for item in estimates if item.message.valid]
    *_, status = (counts for item in bag.messages([_STATUS]) for counts in item.message.telemetry)
    return {
        "samples": sum(count for _, count in blocks),
        "samples_lost_by_recorder": sum(b[0] - a[0] - a[1] for a, b in pairwise(blocks)),
        "blocks_heard_by_monitor": int(status.blocks),
        "samples_lost_by_monitor": int(status.samples_lost),
        "windows": int(status.windows),
        "estimates": len(valid),
        "warm_estimates": sum(item.message.warm_start for item in valid),
        # The recorder's clock gives the latency, the monitor the computing time.
        "latency": [
            (item.log_time_ns - stamp_from_message(item.message.window_end)) * 1e-9
            for item in valid
        ],
        "computing": [item.message.computing_time for item in valid],
        "evaluations": [item.message.evaluations for item in valid],
        "reasons": [item.message.reason for item in estimates if not item.message.valid],
    }


def pooled(demos: Sequence[Figures]) -> Figures:
    """Return the combined figures of all demos: sums, medians and 95th percentiles."""
    # Numbers are added up, lists joined.
    figures: Figures = {
        name: sum((demo[name] for demo in demos), type(first)()) for name, first in demos[0].items()
    }
    for name in ("latency", "computing"):
        seconds = figures.pop(name)
        figures[f"{name}_median_s"] = float(np.median(seconds))
        figures[f"{name}_95_percent_s"] = float(np.quantile(seconds, 0.95))
    figures["evaluations_median"] = float(np.median(figures.pop("evaluations")))
    return figures


def measure(pool: Workers, demos: int, duration: int) -> Figures:
    """Measure lost samples and latency of estimates in several demos, each of a duration [s]."""
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for number in pool.track("demos", range(demos)):
            place = Path(folder, str(number))
            words = ["ema", "demo", "--duration", str(duration), "-o", str(place)]
            subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
            results.append(read(place / "bag"))
    return pooled(results)


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    count = figures["windows"]
    median, late = figures["latency_median_s"], figures["latency_95_percent_s"]
    lost = figures["samples_lost_by_monitor"] + figures["samples_lost_by_recorder"]
    what = f"live, {count} windows: last sample to estimate, median [s]"
    yield at_most(what, median, 0.1, f"{median:.3f}")
    yield at_least("  windows", count, 100, str(count))
    yield at_most("  95th percentile [s]", late, 0.3, f"{late:.3f}")
    yield none_of("  samples lost", lost, f"{lost} of {figures['samples']}")


def tables(figures: Figures) -> Iterator[Table | str]:
    """Yield a table of all figures, and a line with the reason for each invalid estimate."""
    shown = {name: value for name, value in figures.items() if name != "reasons"}
    yield grid(
        "live graph at 10 kHz",
        ("what", ""),
        ((name.replace("_", " "), value) for name, value in shown.items()),
        digits=3,
    )
    for reason in figures["reasons"]:
        yield f"no valid estimate: {reason}"


main = command(measure, "live graph", rows, tables, width=100, demos=4, duration=55)

if __name__ == "__main__":
    main()
