# SPDX-License-Identifier: Apache-2.0
"""Graphs that run for hours: growth of memory, threads, descriptors and shared memory.

A graph has four actuators, a monitor, a recorder and a dashboard. Memory means anonymous pages. Its
slope is the slope of a line through all samples after ten minutes, or after a third of a shorter
run, with a standard deviation for dependent samples. A monitor may also grow by its stored tests.
Two hours produce a bag of 6 GB.
"""

import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..ros.graph import Graph
from .case import Case
from .graphs import check_record, end_graph, start_actuators

SETTLED_MIN: Final = 10.0
MOST_MB_PER_MIN: Final = 0.05
TEST_MB: Final = 20.0 / 3650
"""Largest memory of a test in a monitor [MB]: 20 MB for ten years of daily tests."""
_ACTUATORS: Final = 4
_SAMPLE_S: Final = 5.0
_MB: Final = 1e-6
_SIGMAS: Final = 2.0
_SHARED: Final = "/dev/shm/"
_SECTOR_BYTES: Final = 512


@dataclass(frozen=True)
class Sample:
    """Memory [MB], threads and descriptors of a process, some minutes after the start."""

    minute: float
    memory_mb: float
    threads: int
    descriptors: int


@dataclass(frozen=True)
class Growth:
    """Growth of a process over the time that is judged.

    Attributes
    ----------
    memory_mb
        Memory at the end [MB].
    slope, sigma
        Growth of the memory and its standard deviation [MB/min].
    threads, descriptors
        Growth of the number of threads and descriptors from the first to the last third.
    """

    memory_mb: float
    slope: float
    sigma: float
    threads: int
    descriptors: int

    def grows(self, tests_mb: float) -> bool:
        """Return whether the process grows more than allowed.

        ``tests_mb`` is the growth that its tests explain [MB/min].
        """
        return (
            self.slope - _SIGMAS * self.sigma > MOST_MB_PER_MIN + tests_mb
            or self.threads > 0
            or self.descriptors > 0
        )

    @property
    def is_judged(self) -> bool:
        """True if the slope is accurate enough to detect the largest allowed growth."""
        return self.sigma * _SIGMAS <= MOST_MB_PER_MIN


def run(case: Case, minutes: float) -> None:
    """Run the graph of a case for some minutes, and judge the growth of its processes."""
    bag = case.folder / "bag"
    course: dict[str, list[Sample]] = {}
    shared: list[int] = []
    with Graph(case.folder / "graph") as graph:
        try:
            _begin(graph, case, bag)
            started_s = time.monotonic()
            while (minute := (time.monotonic() - started_s) / 60.0) < minutes:
                graph.wait(_SAMPLE_S)
                for name, process in graph.processes.items():
                    course.setdefault(name, []).append(sample_of(name, process.pid, minute))
                shared.append(shared_bytes(process.pid for process in graph.processes.values()))
            for loss in _lost(graph):
                case.fail(loss)
            end_graph(case, graph)
        except AssertionError as error:
            case.fail(str(error))
        for failure in graph.failures():
            case.fail(failure)
    check_record(case, bag)
    _judge(case, course, shared, minutes, len(graph.estimates) / minutes)


def _judge(
    case: Case, course: dict[str, list[Sample]], shared: list[int], minutes: float, tests: float
) -> None:
    """Print the growth of each process, and record failures; ``tests`` is tests per minute."""
    settled = min(SETTLED_MIN, minutes / 3.0)
    for name, samples in course.items():
        growth = growth_of(samples, settled)
        words = (
            f"{growth.memory_mb:.1f} MB, {growth.slope:+.3f} ± {growth.sigma:.3f} MB/min, "
            f"{growth.threads:+d} threads, {growth.descriptors:+d} descriptors"
        )
        of_tests = tests * TEST_MB if name.startswith("monitor") else 0.0
        print(f"{name}: {words}, of it {of_tests:.3f} MB/min for {tests:.1f} tests a minute")
        if growth.grows(of_tests):
            case.fail(f"{name} grows: {words}")
        elif not growth.is_judged:
            case.fail(f"{name} cannot be judged: {words}: run longer")
    settled_shared = shared[len(shared) // 3 :] or [0]
    grown_mb = (settled_shared[-1] - settled_shared[0]) * _MB
    case.require(grown_mb <= 0.0, f"shared memory grew by {grown_mb:.1f} MB")


def _begin(graph: Graph, case: Case, bag: Path) -> None:
    names = [f"flap_{number}" for number in range(_ACTUATORS)]
    graph.start("recorder", output=bag, max_bag_size=100_000_000)
    graph.start("dashboard", port=0)
    graph.start("monitor", history_folder=case.folder / "history")
    start_actuators(graph, names, case.rng().integers(10**6, size=_ACTUATORS).tolist())


def _lost(graph: Graph) -> list[str]:
    """Return the losses that the nodes report."""
    losses = []
    for name, status in graph.status.items():
        for key in ("samples lost", "windows dropped", "lost messages", "dropped messages"):
            if int(float(status.values.get(key, "0"))):
                losses.append(f"{name}: {key} {status.values[key]}")
    return losses


def sample_of(name: str, pid: int, minute: float) -> Sample:
    """Return a sample of a process; AssertionError if it has died."""
    try:
        return sample(pid, minute)
    except (FileNotFoundError, ProcessLookupError, ValueError, IndexError) as error:
        # The file of a process that ended and was not waited for is empty.
        raise AssertionError(f"{name} died after {minute:.1f} min") from error


def sample(pid: int, minute: float) -> Sample:
    """Return the current memory, threads and descriptors of a process."""
    folder = Path(f"/proc/{pid}")
    rollup = (folder / "smaps_rollup").read_text()
    own_kib = int(rollup.partition("\nAnonymous:")[2].split()[0])
    return Sample(
        minute,
        own_kib * 1024 * _MB,
        sum(1 for _ in (folder / "task").iterdir()),
        sum(1 for _ in (folder / "fd").iterdir()),
    )


def shared_bytes(pids: Iterable[int]) -> int:
    """Return the shared memory of Fast DDS that processes have mapped [B]."""
    paths = set()
    for pid in pids:
        try:
            maps = Path(f"/proc/{pid}/maps").read_text(encoding="utf-8")
        except (FileNotFoundError, ProcessLookupError):
            continue  # it has died, which its next sample reports
        for line in maps.splitlines():
            if (at := line.find(_SHARED)) >= 0:
                paths.add(Path(line[at:].removesuffix(" (deleted)")))
    return sum(path.stat().st_blocks * _SECTOR_BYTES for path in paths if path.exists())


def growth_of(samples: list[Sample], settled_min: float) -> Growth:
    """Return the growth of a process after a settling time [min]."""
    judged = [entry for entry in samples if entry.minute >= settled_min]
    minutes = np.array([entry.minute for entry in judged])
    memory = np.array([entry.memory_mb for entry in judged])
    slope, sigma = line(minutes, memory)
    third = max(1, len(judged) // 3)
    counts = [
        max(getattr(entry, key) for entry in judged[-third:])
        - max(getattr(entry, key) for entry in judged[:third])
        for key in ("threads", "descriptors")
    ]
    return Growth(float(memory[-1]), slope, sigma, *counts)


def line(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float]:
    """Return the slope of a straight line through points, and its standard deviation.

    The residuals are dependent. Their effective number follows from their lag-1 correlation, as for
    a first-order autoregressive process.
    """
    if len(x) < 4:
        return 0.0, float("inf")
    (slope, offset) = np.polyfit(x, y, 1)
    residual = y - slope * x - offset
    power = float(residual @ residual)
    if power == 0.0:
        return float(slope), 0.0
    rho = min(max(float(residual[1:] @ residual[:-1]) / power, 0.0), 0.99)
    independent = max(len(x) * (1.0 - rho) / (1.0 + rho), 3.0)
    variance = power / len(x) / (independent - 2.0) / float(np.var(x))
    return float(slope), float(np.sqrt(variance))
