"""What every pool of workers does: it takes tasks, and gives their outcomes as they come."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any, Final

MOST_DEATHS: Final = 3
"""Workers that a task may end, one after the other, before it is given up."""


@dataclass
class Task:
    """A call that a worker is to make.

    Attributes
    ----------
    name
        What the caller knows it by.
    deaths
        Workers that ended while they worked on it.
    """

    name: Any
    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    deaths: int = 0


@dataclass(frozen=True)
class Outcome:
    """What became of a task.

    Attributes
    ----------
    name
        Name of the task.
    value
        What its function returned; None when it did not.
    error
        What it raised, or ``WorkerLostError``; None when it returned.
    """

    name: Any
    value: Any
    error: BaseException | None = None

    def result(self) -> Any:
        """Return the value, or raise the error."""
        if self.error is not None:
            raise self.error
        return self.value


class WorkerLostError(RuntimeError):
    """A task ended each of the workers that it was given to."""


class ClusterLostError(RuntimeError):
    """The workers are out of reach: what was submitted will not end."""


class Pool(AbstractContextManager["Pool", None], ABC):
    """Workers; where the block ends by an exception, tasks that have not begun are dropped.

    Attributes
    ----------
    workers
        How many work at once.
    description
        What they are, in words.
    dashboard
        Address of the page that shows them; empty when there is none.
    """

    workers: int
    description: str
    dashboard: str = ""

    def __init__(self) -> None:
        self._pending = 0
        # Tasks of an earlier round are forgotten.
        self._round = 0

    @property
    def pending(self) -> int:
        """Number of tasks whose outcome has not been taken."""
        return self._pending

    @property
    def has_room(self) -> bool:
        """Whether another task would find an idle worker soon; more of them only use memory."""
        return self._pending < 2 * self.workers + 2

    def submit(self, name: Any, function: Callable[..., Any], *arguments: Any) -> None:
        """Take a task; function and arguments must be importable and picklable elsewhere."""
        self._pending += 1
        self._begin(Task((self._round, name), function, arguments))

    def next(self) -> Outcome:
        """Wait for the next outcome, in any order; a task whose worker ends is begun anew.

        Raises
        ------
        ClusterLostError
            When there will be none.
        """
        while True:
            outcome = self._next()
            number, name = outcome.name
            if number == self._round:
                self._pending -= 1
                return replace(outcome, name=name)

    def forget(self) -> None:
        """Forget the tasks that have no outcome yet: they may still be worked on."""
        self._pending = 0
        self._round += 1

    def run(
        self, function: Callable[..., Any], items: Iterable[Any]
    ) -> Generator[Outcome, None, None]:
        """Call a function with each item, and yield the outcomes, named by the items, as they come.

        Items are taken as workers become free, so that many need no memory. Where the iterator is
        closed before its end, the tasks without an outcome are forgotten.
        """
        try:
            for item in items:
                while not self.has_room:
                    yield self.next()
                self.submit(item, function, item)
            while self.pending:
                yield self.next()
        finally:
            self.forget()

    def __exit__(self, kind: object, *_: object) -> None:
        self._close(is_failed=kind is not None)

    @abstractmethod
    def _begin(self, task: Task) -> None: ...

    @abstractmethod
    def _next(self) -> Outcome: ...

    @abstractmethod
    def _close(self, *, is_failed: bool) -> None: ...
