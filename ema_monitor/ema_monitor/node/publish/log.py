"""Log and status of a monitor, as its parts write them."""

import time
import traceback
from collections.abc import Sequence
from typing import Any, Final, Protocol

from ema_ros.status import Task
from ema_ros.throttle import Throttle

_PERIOD_S: Final = 30.0


class Reporter(Protocol):
    """Logs, and publishes the status of tasks: a managed node."""

    def get_logger(self) -> Any:
        """Return its logger."""

    def tasks(self, actuator_id: str = "") -> list[Task]:
        """Return the status of one actuator; of each one when empty."""
        ...

    def report(self, tasks: Sequence[Task] = ()) -> None:
        """Publish the status of some tasks, of all when there are none."""

    def report_end(self, failure: str, trace: str) -> None:
        """Report that a thread has ended unexpectedly, with the traceback."""


class Log:
    """Logs what happens, and reports the status where it has changed; any thread may call."""

    def __init__(self, reporter: Reporter) -> None:
        self._reporter = reporter
        self._logger = reporter.get_logger()
        self._throttle = Throttle(_PERIOD_S)

    def info(self, text: str) -> None:
        """Log what happens."""
        self._logger.info(text)

    def warning(self, text: str) -> None:
        """Log what is wrong."""
        self._logger.warning(text)

    def error(self, text: str) -> None:
        """Log what failed."""
        self._logger.error(text)

    def warn(self, actuator_id: str, text: str, *, is_first: bool = False) -> None:
        """Log what is wrong now and then, and the first of its kind in the status at once."""
        passed = self._throttle.passed(f"{actuator_id or 'input'}: {text}", time.monotonic())
        if passed is not None:
            self.warning(passed)
        if is_first:
            self.report_on(actuator_id)

    def failed(self, where: str, what: str, error: Exception) -> str:
        """Log what has just failed, with its traceback, and return the reason."""
        reason = f"{what} failed: {error!r}"
        self.error(f"{where or 'actuator'}: {reason}\n{traceback.format_exc()}")
        return reason

    def report(self) -> None:
        """Publish the status of the node and of all its tasks."""
        self._reporter.report()

    def report_on(self, actuator_id: str) -> None:
        """Publish the status of one actuator alone: of all it would take long."""
        self._reporter.report(self._reporter.tasks(actuator_id))

    def report_end(self, failure: str, trace: str) -> None:
        """Report that a thread has ended unexpectedly, with the traceback."""
        self._reporter.report_end(failure, trace)
