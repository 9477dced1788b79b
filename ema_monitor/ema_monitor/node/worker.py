"""Identification in a thread of its own: windows in, estimates out in the same order."""

import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from ema_core.description import ActuatorDescription
from ema_core.levels import ERROR, OK, WARN
from ema_core.wording import counted
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.search import Identification, LastFaults, identify
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.model.monitor_model import compile_kernels
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

_JOIN_S = 1.0
_STOPPED_DURING = "the monitor was stopped during the identification"


class QueueClosedError(Exception):
    """A window was added to a queue that is closed."""


class WindowQueue:
    """A queue of windows between the thread that receives and the one that identifies.

    Live, a window beyond the limit of its actuator drops that actuator's oldest one: the refusal
    of that one stays in its place, so that order and numbers are kept and every window gets an
    estimate. No actuator can drop the windows of another.

    Parameters
    ----------
    most_waiting
        How many windows of an actuator may wait; None for any number.

    Attributes
    ----------
    dropped
        Number of windows dropped.
    """

    def __init__(self, most_waiting: int | None = None) -> None:
        self.dropped = 0
        self._most_waiting = most_waiting
        self._queue: deque[Segment] = deque()
        self._changed = threading.Condition()
        self._closed = False
        self._current: Segment | None = None
        self._is_publishing = False

    def __len__(self) -> int:
        with self._changed:
            return sum(isinstance(item.window, Window) for item in self._queue)

    @property
    def is_closed(self) -> bool:
        """Whether no more windows are accepted."""
        return self._closed

    def limit(self, most_waiting: int | None) -> None:
        """Change how many windows of an actuator may wait, from the next one on.

        Parameters
        ----------
        most_waiting
            As at construction.
        """
        self._most_waiting = most_waiting

    def add(self, found: Segment) -> list[Segment]:
        """Add a window, or the refusal of one, at the end.

        Parameters
        ----------
        found
            The window.

        Returns
        -------
        list of Segment
            The windows that were dropped for it.

        Raises
        ------
        QueueClosedError
            When the queue is closed.
        """
        with self._changed:
            if self._closed:
                raise QueueClosedError
            self._queue.append(found)
            dropped = []
            if self._most_waiting is not None:
                places = self._places_of(found.description.actuator_id)
                surplus = max(0, len(places) - self._most_waiting)
                dropped = [self._drop(place, self._most_waiting) for place in places[:surplus]]
            self._changed.notify_all()
        return dropped

    def next(self) -> Segment | None:
        """Wait for the next window and return it; None when the queue is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._queue or self._closed)
            self._current = None if self._closed else self._queue.popleft()
            return self._current

    @contextmanager
    def publishing(self, found: Segment) -> Iterator[bool]:
        """Give whether the estimate of a window is to be published, in this context alone.

        Parameters
        ----------
        found
            The window that ``next`` returned last; not to be published once it is abandoned.
        """
        with self._changed:
            self._is_publishing = self._current is found
        try:
            yield self._is_publishing
        finally:
            with self._changed:
                self._is_publishing = False
                self._current = None
                self._changed.notify_all()

    def close(self) -> list[Segment]:
        """Accept no more windows; return those that wait."""
        with self._changed:
            self._closed = True
            waiting = list(self._queue)
            self._queue.clear()
            self._changed.notify_all()
        return waiting

    def abandon(self) -> Segment | None:
        """Return the window whose identification goes on, if any: it will not be published.

        If its estimate is just being published, wait until it is, and return None.
        """
        with self._changed:
            self._changed.wait_for(lambda: not self._is_publishing)
            current, self._current = self._current, None
        return current

    def _places_of(self, actuator_id: str) -> list[int]:
        """Return where windows of an actuator stand in the queue, the oldest first."""
        return [
            place
            for place, item in enumerate(self._queue)
            if item.description.actuator_id == actuator_id and isinstance(item.window, Window)
        ]

    def _drop(self, place: int, most_waiting: int) -> Segment:
        self.dropped += 1
        dropped = self._queue[place]
        reason = f"dropped: more than {counted(most_waiting, 'window')} waited for identification"
        refusal = Refusal(dropped.window.start_ns, dropped.window.end_ns, reason)
        self._queue[place] = replace(dropped, window=refusal)
        return dropped


class IdentificationWorker:
    """Identifies windows one after the other; every window gets an estimate, be it a refusal.

    Once ``stop`` has returned, the thread publishes nothing any more, whatever it is still at.

    Parameters
    ----------
    calibration_of
        Gives the calibration of an actuator, or why there is none.
    settings
        Gives how to search; asked for each window.
    last_faults
        Where warm searches begin.
    publish
        Called with each window and its estimate.
    log_error
        Called with the traceback of what failed.

    Attributes
    ----------
    failure
        Why the thread ended by itself; empty when it did not.
    """

    def __init__(
        self,
        calibration_of: Callable[[ActuatorDescription], Calibration | str],
        settings: Callable[[], SearchSettings],
        last_faults: LastFaults,
        publish: Callable[[Segment, Estimate], None],
        log_error: Callable[[str], object],
    ) -> None:
        self._calibration_of = calibration_of
        self._settings = settings
        self._last_faults = last_faults
        self._publish = publish
        self._log_error = log_error
        self._thread: threading.Thread | None = None
        self._queue = WindowQueue()
        self._queue.close()
        self.failure = ""

    @property
    def is_running(self) -> bool:
        """Whether the thread lives and has not been told to stop."""
        thread = self._thread
        return thread is not None and thread.is_alive() and not self._queue.is_closed

    @property
    def waiting(self) -> int:
        """Number of windows that wait."""
        return len(self._queue)

    @property
    def dropped(self) -> int:
        """Number of windows dropped since the start."""
        return self._queue.dropped

    def status(self) -> tuple[int, str]:
        """Return level and words for ``/diagnostics``."""
        if self.failure:
            return ERROR, self.failure
        return (
            (OK, f"waiting: {counted(self.waiting, 'window')}")
            if self.is_running
            else (WARN, "not active")
        )

    def start(self) -> None:
        """Begin to identify, with a new thread and queue."""
        # The thread of before may still be in the middle of a compilation.
        self._queue = WindowQueue()
        self.failure = ""
        self._thread = threading.Thread(
            target=self._run, args=(self._queue,), name="identification", daemon=True
        )
        self._thread.start()

    def add(self, found: Segment, most_waiting: int | None) -> list[Segment]:
        """Let a window, or the refusal of one, wait; it is refused if nothing is running.

        Parameters
        ----------
        found
            The window.
        most_waiting
            How many windows of an actuator may wait; None for any number.

        Returns
        -------
        list of Segment
            The windows that were dropped for it.
        """
        self._queue.limit(most_waiting)
        try:
            return self._queue.add(found)
        except QueueClosedError:
            self.refuse(found, self.failure or "the monitor is not active")
            return []

    def stop(self) -> None:
        """Stop, in the middle of a window if need be, and refuse the windows that wait."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        waiting = self._queue.close()
        # A compilation cannot be interrupted: the thread ends by itself when it is done. One
        # that failed is refusing the last windows.
        thread.join(None if self.failure else _JOIN_S)
        current = self._queue.abandon()
        if current is not None:
            self.refuse(current, _STOPPED_DURING)
        for found in waiting:
            self.refuse(found, "the monitor was stopped before the window was identified")

    def refuse(self, found: Segment, reason: str) -> None:
        """Publish that a window is not identified.

        Parameters
        ----------
        found
            The window, or its refusal.
        reason
            Why; that of the refusal when empty.
        """
        self._publish(found, self._refusal(found, reason))

    def _run(self, queue: WindowQueue) -> None:
        try:
            compile_kernels()
            while (found := queue.next()) is not None:
                self._identify_and_publish(found, queue)
        except Exception as error:
            self.failure = f"the identification thread has ended: {error!r}"
            self._log_error(f"{self.failure}\n{traceback.format_exc()}")
            for found in queue.close():
                self.refuse(found, self.failure)

    def _identify_and_publish(self, found: Segment, queue: WindowQueue) -> None:
        # One window that cannot be dealt with must not end the work on the others.
        try:
            estimate = self._identify(found, queue)
        except Exception as error:
            estimate = self._refusal(found, self._failed(found, error))
        with queue.publishing(found) as is_wanted:
            if not is_wanted:
                return
            self._last_faults.record(found.description, estimate)
            try:
                self._publish(found, estimate)
            except Exception as error:
                reason = self._failed(found, error)
                try:
                    self.refuse(found, reason)
                except Exception as second:
                    self._failed(found, second)

    def _identify(self, found: Segment, queue: WindowQueue) -> Estimate:
        description = found.description
        calibration = self._calibration_of(description)
        previous = self._last_faults.of(description, calibration)
        run = Identification(
            found.window, description, calibration, self._settings(), previous=previous
        )
        try:
            for _ in run:
                if queue.is_closed:
                    return self._refusal(found, _STOPPED_DURING)
        except ValueError as error:
            return self._refusal(found, str(error))
        if run.estimate is None:
            raise RuntimeError("the identification ended without an estimate")
        return run.estimate

    def _failed(self, found: Segment, error: Exception) -> str:
        reason = f"the identification failed: {error!r}"
        self._log_error(f"window {found.number}: {reason}\n{traceback.format_exc()}")
        return reason

    def _refusal(self, found: Segment, reason: str) -> Estimate:
        window, description = found.window, found.description
        refused = Refusal(window.start_ns, window.end_ns, reason) if reason else window
        return identify(refused, description, self._calibration_of(description), self._settings())
