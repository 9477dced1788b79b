# SPDX-License-Identifier: Apache-2.0
"""Shared parts of the benchmarks: their commands, and processes to measure in."""

import json
import multiprocessing
import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from targets import Row, target_table

from ema_core.array_environment import array_environment
from ema_monitor.model.threads import limit_threads

Figures = dict[str, Any]
Item = TypeVar("Item")
Result = TypeVar("Result")


class Workers:
    """A pool of one single-threaded process per core, with a progress bar."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    @cached_property
    def _pool(self) -> ProcessPoolExecutor:
        os.environ.update(array_environment())
        # A fork would inherit the state of this process's threads.
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(os.cpu_count(), context, limit_threads, (1,))

    def map(self, what: str, work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """Return the result of ``work`` for each item, in order; ``what`` labels the progress."""
        chunk = max(1, min(8, len(items) // 8))
        return list(self.track(what, self._pool.map(work, items, chunksize=chunk), len(items)))

    def track(self, what: str, items: Iterable[Item], total: int | None = None) -> Iterable[Item]:
        """Return an iterable of the items that shows progress, labelled ``what``."""
        return self._progress.track(items, total=total, description=what)

    def close(self) -> None:
        """Stop the processes."""
        if "_pool" in vars(self):
            self._pool.shutdown()


def in_a_process(work: Callable[..., Result], *options: Any) -> Result:
    """Run ``work`` in a new process and return its result."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(work, *options).result()


def peak_mib(status: str) -> float:
    """Return the largest resident set in the content of ``/proc/PID/status`` [MiB].

    wait4 and getrusage are unsuitable, because the peak of the parent process is a lower bound of
    their result.
    """
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024.0


def cpu_s(process: int) -> float:
    """Return the processor time that a process has used so far [s]."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def command(
    measure: Callable[..., Figures],
    title: str,
    rows: Callable[[Figures], Iterable[Row]] | None = None,
    tables: Callable[[Figures], Iterable[Table | str]] = lambda _: (),
    *,
    width: int = 140,
    beside: str = "",
    quick: Mapping[str, int] | None = None,
    full: Mapping[str, int] | None = None,
    **options: Any,
) -> click.Command:
    """Return the command of a script, which measures, prints targets and tables, and writes JSON.

    ``measure`` receives the workers, and the options as keyword arguments; its docstring is the
    help. ``quick`` and ``full`` are the values of options with ``--quick`` and ``--full``. An
    option is its default value, or a parameter of click. ``beside`` is the heading of the column
    of reference values.
    """
    defaults = {n: value for n, value in options.items() if not isinstance(value, click.Parameter)}

    def run(output: Path | None, **passed: Any) -> None:
        chosen = dict(defaults)
        for name, sizes in (("quick", quick), ("full", full)):
            chosen |= (sizes or {}) if passed.pop(name, False) else {}
        chosen |= {name: value for name, value in passed.items() if value is not None}
        started = time.perf_counter()
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
        with Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True)) as progress:
            workers = Workers(progress)
            try:
                figures = measure(workers, **chosen)
            finally:
                workers.close()
        if output:
            output.write_text(json.dumps(figures, indent=1), encoding="utf-8")
        console = Console(width=width)
        if rows:
            console.print(target_table(title, rows(figures), beside))
        for part in tables(figures):
            console.print(part)
        console.print(f"{time.perf_counter() - started:.0f} s in all")

    file = click.Path(path_type=Path, dir_okay=False)
    parameters: list[click.Parameter] = [
        click.Option(["--json", "output"], type=file, help="File to write."),
        *(option for option in options.values() if isinstance(option, click.Parameter)),
    ]
    for name, sizes in (("quick", quick), ("full", full)):
        if sizes is not None:
            words = ", ".join(f"{key} {value}" for key, value in sizes.items())
            parameters.append(click.Option([f"--{name}"], is_flag=True, help=words))
    for name, value in defaults.items():
        is_flag = isinstance(value, bool)
        kind: Any = {"is_flag": True} if is_flag else {"type": type(value)}
        words = "" if is_flag else f"Default: {value}."
        flag = f"--{name.replace('_', '-')}"
        parameters.append(click.Option([flag], default=None, help=words, **kind))
    return click.Command(None, callback=run, params=parameters, help=measure.__doc__)
