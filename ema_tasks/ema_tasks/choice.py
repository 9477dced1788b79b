"""Pools by name."""

from collections.abc import Callable
from typing import Any, Final

from ema_tasks.local import ProcessPool, ThreadPool, nothing
from ema_tasks.pool import Pool

EXECUTORS: Final = ("processes", "threads", "dask")
"""Names of the pools."""


def open_pool(
    kind: str,
    workers: int,
    scheduler: str = "",
    *,
    prepare: Callable[..., None] = nothing,
    given: tuple[Any, ...] = (),
    limit_s: float = 0.0,
) -> Pool:
    """Return a pool.

    Parameters
    ----------
    kind
        One of ``EXECUTORS``.
    workers
        How many work at once on this machine.
    scheduler
        Address of a Dask scheduler; empty for a cluster on this machine.
    prepare, given, limit_s
        As of ``ProcessPool``; of no use to others.

    Raises
    ------
    ValueError
        When the kind is unknown, there are no workers, or a scheduler is given to another kind.
    ClusterLostError
        When the scheduler does not answer.
    """
    if kind not in EXECUTORS:
        raise ValueError(f"executor {kind!r} is unknown; known: {', '.join(EXECUTORS)}")
    if workers < 1:
        raise ValueError(f"workers = {workers}: expected at least 1")
    if scheduler and kind != "dask":
        raise ValueError(f"--scheduler {scheduler} is for the executor dask, not {kind}")
    if kind == "threads":
        return ThreadPool(workers)
    if kind == "processes":
        return ProcessPool(workers, prepare, given, limit_s)
    from ema_tasks.cluster import DaskPool

    return DaskPool(scheduler, workers)
