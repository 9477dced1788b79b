"""Options that say where tasks run, shared by the commands that have many."""

from dataclasses import dataclass

import click

from ema_cli.gathered_options import gathered
from ema_monitor.model.threads import available_cpus
from ema_tasks.choice import EXECUTORS, open_pool
from ema_tasks.pool import Pool

_OPTIONS = (
    click.option(
        "--executor",
        "kind",
        default="processes",
        type=click.Choice(EXECUTORS),
        help="Where tasks run: processes or threads of this machine, or a Dask cluster.",
    ),
    click.option(
        "--workers",
        type=click.IntRange(1),
        help="How many at once on this machine; by default as many as there are cores.",
    ),
    click.option(
        "--scheduler",
        default="",
        metavar="ADDRESS",
        help="With --executor dask: the cluster's scheduler, such as tcp://10.0.0.1:8786; without "
        "it a cluster of local processes is started.",
    ),
    click.option(
        "--task-limit",
        "limit_s",
        default=600.0,
        type=click.FloatRange(min=0.0),
        help="With --executor processes: a task that takes longer ends its process, at most three "
        "times [s]; 0: none does.",
    ),
)


@dataclass(frozen=True)
class ExecutorOptions:
    """What the options say."""

    kind: str
    workers: int | None
    scheduler: str
    limit_s: float

    def open(self) -> Pool:
        """Return the pool.

        Raises
        ------
        ValueError, ClusterLostError
            As of `open_pool`.
        """
        workers = workers_or_all(self.workers)
        return open_pool(self.kind, workers, self.scheduler, limit_s=self.limit_s)


def workers_or_all(workers: int | None) -> int:
    """Return a number of workers; where none is given, that of the cores."""
    return workers or available_cpus()


executor_options = gathered("executor", ExecutorOptions, ExecutorOptions.__annotations__, _OPTIONS)
"""Gives a command the options as ``executor``."""
