"""Options that say where tasks run, shared by the commands that have many."""

from dataclasses import dataclass
from functools import wraps
from typing import Any

import click

from ema_cli.parameters import Command
from ema_core.tasks import EXECUTORS, Workers
from ema_monitor.model.threads import available_cpus


@dataclass(frozen=True)
class ExecutorOptions:
    """What the options say."""

    kind: str
    workers: int | None
    scheduler: str

    @property
    def number(self) -> int:
        """How many tasks run at once on this machine."""
        return self.workers or available_cpus()

    def open(self) -> Workers:
        """Return the workers; ValueError and ClusterLostError as of `Workers`."""
        return Workers(self.kind, self.number, self.scheduler)


def executor_options(command: Command) -> Command:
    """Give a command the options as its argument ``executor``."""

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
        help="How many at once on this machine; by default as many as there are cores.",
    )
    @click.option(
        "--scheduler",
        default="",
        metavar="ADDRESS",
        help="With --executor dask: the cluster's scheduler, such as tcp://10.0.0.1:8786; without "
        "it a cluster of local processes is started.",
    )
    @wraps(command)
    def with_executor(kind: str, workers: int | None, scheduler: str, **given: Any) -> None:
        command(executor=ExecutorOptions(kind, workers, scheduler), **given)

    return with_executor
