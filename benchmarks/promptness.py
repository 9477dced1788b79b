# SPDX-License-Identifier: Apache-2.0
"""Time that nodes take to end on request, and data that a killed recorder loses.

    python benchmarks/promptness.py [--repeats N] [--json FILE]

Prints the time from SIGINT to the end of each node's process, also for a monitor during an
identification, and the length of the recording that is lost when its recorder is killed. The tests
of the nodes wait for the same ends without a time limit, because the time depends on the load of
the machine.
"""

import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, Final

import numpy as np
from graph import Graph, Process
from script import Figures, Workers, command
from targets import Row, at_most

from ema_bags.reader import Bag

END_S: Final = 2.0
LOST_S: Final = 0.5
KILLED: Final = "recorder: lost when killed"


def ended_s(process: Process) -> float:
    """Interrupt a process. Return the time until it ends [s]."""
    begin_s = time.monotonic()
    process.send_signal(signal.SIGINT)
    process.wait()
    return time.monotonic() - begin_s


def ends(graph: Graph, name: str, **parameters: Any) -> float:
    """Start a node and interrupt it when it is active. Return the time until it ends [s]."""
    process = graph.start(name, **parameters)
    graph.wait_for_status(f"/ema/{name}: lifecycle", lambda entry: entry["message"] == "active")
    return ended_s(process)


def ends_while_it_identifies(graph: Graph) -> float:
    """Interrupt a monitor during an identification. Return the time until it ends [s]."""
    actuator = graph.start("actuator")
    # An identification with ten million evaluations takes minutes.
    monitor = graph.start("monitor", algorithm="pso", budget=10_000_000, history_folder="memory")
    graph.wait_for_status(
        "/ema/monitor: flap telemetry", lambda entry: entry.get("windows", "0") != "0"
    )
    took_s = ended_s(monitor)
    ended_s(actuator)
    return took_s


def lost_s(graph: Graph, folder: Path) -> float:
    """Kill a recorder. Return the length of the recording that is lost [s]."""
    actuator, recorder = graph.start("actuator"), graph.start("recorder", output=str(folder))
    graph.wait_for_status(
        "/ema/recorder: recording", lambda entry: int(entry.get("messages", 0)) > 300
    )
    recorder.kill()
    killed_ns = time.time_ns()
    recorder.wait()
    ended_s(actuator)
    last = list(Bag(folder).raw_messages())[-1]
    return 1e-9 * (killed_ns - last.log_time_ns)


def measure(pool: Workers, repeats: int) -> Figures:
    """Measure the time that nodes take to end, and the loss of a killed recorder."""
    with tempfile.TemporaryDirectory() as place, Graph() as graph:
        folders = (Path(place, str(number)) for number in count())
        cases: dict[str, Callable[[], float]] = {
            "actuator: SIGINT to end": partial(ends, graph, "actuator"),
            "monitor: SIGINT to end": partial(ends, graph, "monitor", history_folder="memory"),
            "  while it identifies": partial(ends_while_it_identifies, graph),
            "recorder: SIGINT to end": lambda: ends(graph, "recorder", output=str(next(folders))),
            KILLED: lambda: lost_s(graph, next(folders)),
        }
        return {
            name: [work() for _ in range(repeats)]
            for name, work in pool.track("ends", cases.items())
        }


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    for name, values in figures.items():
        most = max(values)
        measured = f"{most:.2f} (median {np.median(values):.2f})"
        yield at_most(f"{name} [s]", most, LOST_S if name == KILLED else END_S, measured)


main = command(measure, "promptness", rows, repeats=5)

if __name__ == "__main__":
    main()
