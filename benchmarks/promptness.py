# SPDX-License-Identifier: Apache-2.0
"""How promptly nodes end on request, and write a recording to disk.

    python benchmarks/promptness.py [--repeats N] [--json FILE]

Prints how long the process of each node takes from SIGINT to its end, that of the monitor while it
identifies as well, and how much of a recording is lost when its recorder is killed. The tests wait
for the same ends, but for any time: how long they take depends on what else the machine does.
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
    """Interrupt a process; return how long it takes to end [s]."""
    begin_s = time.monotonic()
    process.send_signal(signal.SIGINT)
    process.wait()
    return time.monotonic() - begin_s


def ends(graph: Graph, name: str, **parameters: Any) -> float:
    """Return how long a node that is up takes to end [s]."""
    process = graph.start(name, **parameters)
    graph.wait_for_status(f"/ema/{name}: lifecycle", lambda entry: entry["message"] == "active")
    return ended_s(process)


def ends_while_it_identifies(graph: Graph) -> float:
    """Return how long a monitor takes to end in the midst of an identification [s]."""
    actuator = graph.start("actuator")
    # At ten million evaluations it takes minutes.
    monitor = graph.start("monitor", algorithm="pso", budget=10_000_000, history_folder="memory")
    graph.wait_for_status(
        "/ema/monitor: flap telemetry", lambda entry: entry.get("windows", "0") != "0"
    )
    took_s = ended_s(monitor)
    ended_s(actuator)
    return took_s


def lost_s(graph: Graph, folder: Path) -> float:
    """Return how much of a recording is lost when its recorder is killed [s]."""
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
    """Print how promptly nodes end, and what a killed recorder loses, so many times each."""
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
    """Return the rows of the targets."""
    for name, values in figures.items():
        most = max(values)
        measured = f"{most:.2f} (median {np.median(values):.2f})"
        yield at_most(f"{name} [s]", most, LOST_S if name == KILLED else END_S, measured)


main = command(measure, "promptness", rows, repeats=5)

if __name__ == "__main__":
    main()
