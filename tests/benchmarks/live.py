"""Samples lost and latency in a live graph of three processes, read from the bag of a demo.

    python tests/benchmarks/live.py [--duration S] [--json FILE]

Actuator, monitor and recorder run as processes at 10,000 samples a second. Prints how many samples
got lost on the way to the monitor and to the recorder, and the time from a window's last sample to
the reception of its estimate; writes JSON.
"""

import json
import subprocess
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from ema_messages.stamps import stamp_from_message
from ema_recording.reader import Bag

_TELEMETRY: Final = "/ema/telemetry"
_ESTIMATES: Final = "/ema/fault_estimate"
_STATUS: Final = "/diagnostics"


def measure(path: Path) -> dict[str, Any]:
    """Return the figures of a demo's bag."""
    bag = Bag(path)
    blocks = [
        (item.message.first_index, len(item.message.command)) for item in bag.messages([_TELEMETRY])
    ]
    missing = [after[0] - before[0] - before[1] for before, after in pairwise(blocks)]
    latencies_s = [
        (item.log_time_ns - stamp_from_message(item.message.window_end)) * 1e-9
        for item in bag.messages([_ESTIMATES])
        if item.message.valid
    ]
    statuses = [
        {pair.key: pair.value for pair in status.values}
        for item in bag.messages([_STATUS])
        for status in item.message.status
        if status.name.startswith("monitor: ") and status.name.endswith(" telemetry")
    ]
    last = statuses[-1]
    return {
        "samples": sum(count for _, count in blocks),
        "samples_lost_by_recorder": sum(missing),
        "blocks_heard_by_monitor": int(last["blocks"]),
        "samples_lost_by_monitor": int(last["samples lost"]),
        "windows": int(last["windows"]),
        "estimates": len(latencies_s),
        "latency_median_s": float(np.median(latencies_s)),
        "latency_95_percent_s": float(np.quantile(latencies_s, 0.95)),
    }


@click.command()
@click.option("--duration", "duration_s", default=60.0, show_default=True)
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
def main(duration_s: float, output: Path | None) -> None:
    """Print the table and write the JSON file."""
    with tempfile.TemporaryDirectory() as folder:
        demo = ["ema", "demo", "--duration", str(duration_s), "-o", f"{folder}/demo"]
        subprocess.run(demo, check=True, stdout=subprocess.DEVNULL)
        figures = measure(Path(folder, "demo", "bag"))
    table = Table("live graph", "", title=f"{duration_s:g} s at 10 kHz")
    for name, value in figures.items():
        table.add_row(
            name.replace("_", " "), f"{value:.3f}" if isinstance(value, float) else str(value)
        )
    Console(width=100).print(table)
    if output:
        output.write_text(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
