"""Workers of a Dask cluster, elsewhere or started here."""

from collections import deque
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from typing import Any, Final

from ema_tasks.pool import MOST_DEATHS, ClusterLostError, Outcome, Pool, Task, WorkerLostError

CONNECT_S: Final = 10.0
"""Time after which a scheduler that does not answer is out of reach [s]."""

_MOST_SILENCES: Final = 30
_LOOK_S: Final = 1.0


class DaskPool(Pool):
    """Workers of a Dask cluster.

    Parameters
    ----------
    scheduler
        Address of its scheduler, such as ``tcp://10.0.0.1:8786``; empty to start a cluster of local
        processes, which ends with the pool.
    workers
        Number of local processes; of another cluster its scheduler knows them.

    Raises
    ------
    ClusterLostError
        When the scheduler does not answer.
    ValueError
        When ``distributed`` is not installed.
    """

    def __init__(self, scheduler: str, workers: int) -> None:
        super().__init__()
        try:
            from distributed import Client, LocalCluster
        except ImportError as error:
            raise ValueError(
                "the executor dask needs the package distributed: pip install 'ema_tasks[dask]'"
            ) from error
        self._cluster: Any = None
        if not scheduler:
            self._cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                dashboard_address="127.0.0.1:0",
            )
        self.address = scheduler or self._cluster.scheduler_address
        try:
            self._client: Any = Client(self.address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise ClusterLostError(
                f"the Dask scheduler {self.address} does not answer within {CONNECT_S:g} s: {error}"
            ) from error
        self.dashboard = self._client.dashboard_link or ""
        self.description = f"Dask cluster {self.address}"
        self._futures: dict[int, tuple[Task, Any]] = {}
        self._done: SimpleQueue[int] = SimpleQueue()
        self._submitted = 0
        self._suspects: deque[Task] = deque()

    @property
    def workers(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Threads of the workers that the scheduler has now, at least one."""
        if not self._is_there():
            return 1
        with self._reached():
            return max(1, sum(self._client.nthreads().values()))

    @property
    def has_room(self) -> bool:
        """Whether another task would find an idle worker soon."""
        # The number of workers is asked of the scheduler: not for each task.
        if self._submitted % 16 == 0 or not hasattr(self, "_room"):
            self._room = 3 * self.workers + 2
        return self._pending < self._room and not self._suspects

    def _is_there(self) -> bool:
        return self._client.status == "running"

    def _begin(self, task: Task) -> None:
        number = self._submitted = self._submitted + 1
        with self._reached():
            future = self._client.submit(task.function, *task.arguments, pure=False)
        self._futures[number] = task, future
        future.add_done_callback(lambda _: self._done.put(number))

    def _next(self) -> Outcome:
        silences = 0
        while True:
            if self._suspects and not self._futures:
                self._begin(self._suspects.popleft())
            try:
                number = self._done.get(timeout=_LOOK_S)
            except Empty:
                silences = 0 if self._is_there() else silences + 1
                if silences >= _MOST_SILENCES or self._client.status == "closed":
                    raise self._lost() from None
                continue
            task, future = self._futures.pop(number)
            if future.status in ("cancelled", "lost"):
                # Its scheduler has ended: another one at the same address knows nothing of it.
                self._again(task)
                continue
            with self._reached():
                error = None if future.status == "finished" else future.exception()
            if type(error).__name__ == "KilledWorker":
                if not task.deaths:
                    # Dask suspects all tasks that an ended worker had: by itself it will show.
                    task.deaths = 1
                    self._suspects.append(task)
                    continue
                error = WorkerLostError(
                    "the workers of the cluster that worked on it ended, one after the other"
                )
            return Outcome(task.name, None if error else self._result(future), error)

    def _result(self, future: Any) -> Any:
        with self._reached():
            return future.result(timeout=CONNECT_S * 6)

    @contextmanager
    def _reached(self) -> Iterator[None]:
        """Say that the scheduler is out of reach, whatever its library raises then."""
        try:
            yield
        except (CancelledError, OSError, RuntimeError, TimeoutError) as error:
            raise self._lost() from error

    def _again(self, task: Task) -> None:
        task.deaths += 1
        if task.deaths > MOST_DEATHS or not self._is_there():
            raise self._lost()
        self._begin(task)

    def _lost(self) -> ClusterLostError:
        return ClusterLostError(
            f"the Dask scheduler {self.address} is out of reach; what is done is kept"
        )

    def _close(self, *, is_failed: bool) -> None:
        # Where the scheduler has ended there is nobody to tell: what failed stays the error.
        with suppress(ClusterLostError), self._reached():
            if is_failed and self._is_there():
                self._client.cancel([future for _, future in self._futures.values()])
        self._futures.clear()
        with suppress(ClusterLostError), self._reached():
            self._client.close(timeout=CONNECT_S)
        if self._cluster is not None:
            self._cluster.close(timeout=CONNECT_S)
