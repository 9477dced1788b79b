# SPDX-License-Identifier: Apache-2.0
"""Logging and status reports for the parts of a monitor."""

import time
import traceback
from collections.abc import Sequence
from typing import Any, Final, Protocol

from ema_ros.status import Task
from ema_ros.throttle import Throttle

_PERIOD_S: Final = 30.0


class Reporter(Protocol):
    """Interface to a managed node that logs and publishes task status."""

    def get_logger(self) -> Any:
        """Return the logger of the node."""

    def tasks(self, actuator_id: str = "") -> list[Task]:
        """Return the status of an actuator, or of all actuators for an empty name."""
        ...

    def report(self, tasks: Sequence[Task] = ()) -> None:
        """Publish the status of these tasks, or of all tasks if the sequence is empty."""

    def report_end(self, failure: str, trace: str) -> None:
        """Report that a thread has ended unexpectedly, with the traceback."""


class Log:
    """Thread-safe logger that also publishes status changes."""

    def __init__(self, reporter: Reporter) -> None:
        self._reporter = reporter
        self._logger = reporter.get_logger()
        self._throttle = Throttle(_PERIOD_S)

    def info(self, text: str) -> None:
        """Log an informational message."""
        self._logger.info(text)

    def warning(self, text: str) -> None:
        """Log a warning."""
        self._logger.warning(text)

    def error(self, text: str) -> None:
        """Log an error."""
        self._logger.error(text)

    def warn(self, actuator_id: str, text: str, *, is_first: bool = False) -> None:
        """Log a rate-limited warning; if ``is_first``, also publish the status."""
        passed = self._throttle.passed(f"{actuator_id or 'input'}: {text}", time.monotonic())
        if passed is not None:
            self.warning(passed)
        if is_first:
            self.report_on(actuator_id)

    def failed(self, where: str, what: str, error: Exception) -> str:
        """Log the failure of a step with its traceback. Return the reason."""
        reason = f"{what} failed: {error!r}"
        self.error(f"{where or 'actuator'}: {reason}\n{traceback.format_exc()}")
        return reason

    def report(self) -> None:
        """Publish the status of the node and of all its tasks."""
        self._reporter.report()

    def report_on(self, actuator_id: str) -> None:
        """Publish the status of one actuator, which is faster than publishing all."""
        self._reporter.report(self._reporter.tasks(actuator_id))

    def report_end(self, failure: str, trace: str) -> None:
        """Report that a thread has ended unexpectedly, with the traceback."""
        self._reporter.report_end(failure, trace)
