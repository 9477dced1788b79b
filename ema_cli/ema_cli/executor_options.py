# SPDX-License-Identifier: Apache-2.0
"""Options that select the executor, for commands that run many tasks."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from typing import Any

import click

from ema_cli.parameters import Command
from ema_core.tasks import EXECUTORS, ClusterLostError, WorkerLostError, Workers
from ema_monitor.model.threads import available_cpus, limit_threads


@dataclass(frozen=True)
class ExecutorOptions:
    """Kind of executor, number of parallel local tasks, and address of a Dask scheduler."""

    kind: str
    number: int
    scheduler: str

    @contextmanager
    def open(self, stopped: Callable[[], str], kept: str) -> Iterator[Workers]:
        """Yield the workers. If interrupted or if workers are lost, end with a one-line message.

        Parameters
        ----------
        stopped
            Returns the line to print after an interrupt.
        kept
            Clause about the results so far, printed if workers are lost.
        """
        try:
            with (
                stops_in_a_line(stopped, kept),
                Workers(self.kind, self.number, self.scheduler) as workers,
            ):
                yield workers
        finally:
            limit_threads(None)


@contextmanager
def stops_in_a_line(stopped: Callable[[], str], kept: str) -> Iterator[None]:
    """Convert an interrupt, or the loss of workers, to a one-line error message.

    Parameters
    ----------
    stopped
        Returns the line to print after an interrupt.
    kept
        Clause about the results so far, printed if workers are lost.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise click.ClickException(stopped()) from None
    except (ClusterLostError, WorkerLostError) as error:
        raise click.ClickException(f"{error}; {kept}") from error


def executor_options(command: Command) -> Command:
    """Add executor options to a command, which receives them as the argument ``executor``."""

    @click.option(
        "--executor",
        "kind",
        default="processes",
        type=click.Choice(EXECUTORS),
        help="Where tasks run: processes or threads of this machine, or a Dask cluster.",
    )
    @click.option(
        "--workers",
        type=click.IntRange(1),
        help="Number of parallel tasks on this machine; by default the number of cores.",
    )
    @click.option(
        "--scheduler",
        default="",
        metavar="ADDRESS",
        help=(
            "With --executor dask: address of the scheduler, such as tcp://10.0.0.1:8786; by "
            "default a local cluster is started."
        ),
    )
    @wraps(command)
    def with_executor(kind: str, workers: int | None, scheduler: str, **arguments: Any) -> None:
        executor = ExecutorOptions(kind, workers or available_cpus(), scheduler)
        command(executor=executor, **arguments)

    return with_executor
