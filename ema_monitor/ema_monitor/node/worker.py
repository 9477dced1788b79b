"""Identification in its own thread: windows in, estimates out in the same order."""

import traceback
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema_core.description import ActuatorDescription
from ema_core.levels import ERROR, OK, WARN
from ema_core.steady_thread import SteadyThread
from ema_core.wording import counted
from ema_monitor.calibration.loading import AnyCalibration
from ema_monitor.identification.combinations import Combinations
from ema_monitor.identification.estimate import Estimate, refusal
from ema_monitor.identification.search import Identification, LastFaults
from ema_monitor.identification.tally import Tally
from ema_monitor.node.settings import WindowSettings
from ema_monitor.node.window_queue import QueueClosedError, WindowQueue
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

_JOIN_S = 1.0
_STOPPED_DURING = "the monitor was stopped during the identification"


class IdentificationWorker:
    """Identifies windows one after the other, of the actuators in turn.

    Every window gets an estimate or a refusal, but for the refusals that ``WindowQueue`` gives up.
    A thread that ends by itself refuses the window that it was at, and is begun again.

    Once ``stop`` has returned, the thread publishes nothing any more, even if it still computes.

    Parameters
    ----------
    calibration_of
        Gives the calibration of an actuator, or why there is none.
    latest_estimate
        Gives the latest valid estimate in the history of an actuator, if any: its first search
        begins there.
    settings
        Gives the settings of searches and combinations for windows that carry none.
    publish
        Called with each window and its estimate; of stretches of ordinary motion, with the one
        that completes an estimate, and that.
    report_tally
        Called with the name of an actuator, and what became of its stretches so far.
    log_error
        Called with the traceback of a failure.

    """

    def __init__(
        self,
        calibration_of: Callable[[ActuatorDescription], AnyCalibration | str],
        latest_estimate: Callable[[ActuatorDescription], Estimate | None],
        settings: Callable[[], WindowSettings],
        publish: Callable[[Segment, Estimate], None],
        report_tally: Callable[[str, Tally], None],
        log_error: Callable[[str], object],
    ) -> None:
        self._calibration_of = calibration_of
        self._latest_estimate = latest_estimate
        self._settings = settings
        self._publish = publish
        self._report_tally = report_tally
        self._log_error = log_error
        self._last_faults = LastFaults()
        self._combinations = Combinations()
        self._searched: set[str] = set()
        # Numbers of the latest stretches.
        self._looked_at: dict[str, int] = {}
        self._thread: SteadyThread | None = None
        self._queue = WindowQueue()
        self._queue.close()

    @property
    def is_running(self) -> bool:
        """Whether the thread runs and is not to stop."""
        thread = self._thread
        return thread is not None and thread.is_alive and not self._queue.is_closed

    @property
    def ends(self) -> int:
        """Number of times that the thread has ended by itself since the start."""
        return self._thread.ends if self._thread is not None else 0

    @property
    def waiting(self) -> int:
        """Number of windows that wait."""
        return len(self._queue)

    @property
    def dropped(self) -> Mapping[str, int]:
        """Number of windows dropped since the start, by actuator."""
        return self._queue.dropped

    @property
    def unanswered(self) -> Mapping[str, int]:
        """Number of refusals that were never published since the start, by actuator."""
        return self._queue.unanswered

    def status(self) -> tuple[int, str]:
        """Return level and message for ``/diagnostics``."""
        if self._thread is not None and self._thread.failure:
            return ERROR, self._thread.failure
        if not self.is_running:
            return WARN, "not active"
        return OK, f"waiting: {counted(self.waiting, 'window')}"

    def start(self) -> None:
        """Begin to identify, with a new thread and queue."""
        # The previous thread may still be in a search.
        self._queue = queue = WindowQueue()
        self._thread = SteadyThread(
            "identification",
            lambda: self._run(queue),
            lambda failure, trace: self._note_end(queue, failure, trace),
        )
        self._thread.start()

    def forget(self) -> None:
        """Begin later searches anew."""
        self._last_faults.clear()
        self._combinations.clear()
        self._searched.clear()
        self._looked_at.clear()

    def forget_actuator(self, actuator_id: str) -> None:
        """Begin the later searches of one actuator anew; its windows that wait are let go."""
        self._last_faults.forget(actuator_id)
        self._combinations.forget(actuator_id)
        self._searched.discard(actuator_id)
        self._looked_at.pop(actuator_id, None)
        self._queue.forget(actuator_id)

    def add(self, segment: Segment, most_waiting: int | None) -> list[Segment]:
        """Queue a window as ``WindowQueue.add`` does; refuse it if the thread does not run."""
        try:
            return self._queue.add(segment, most_waiting)
        except QueueClosedError:
            self.refuse(segment, "the monitor is not active")
            return []

    def stop(self) -> None:
        """Stop, even within a window, and refuse the windows that wait.

        What stretches of ordinary motion have told so far is published, without the one that is
        being identified.
        """
        thread, self._thread = self._thread, None
        if thread is None:
            return
        thread.ending.set()
        waiting = self._queue.close()
        thread.end(_JOIN_S)
        current = self._queue.abandon()
        if current is not None:
            self.refuse(current, _STOPPED_DURING)
        for segment in waiting:
            self.refuse(segment, "the monitor was stopped before the window was identified")
        # A thread that still computes gives up its stretch once it is back from that.
        combinations, self._combinations = self._combinations, Combinations()
        for number, description, estimate in combinations.finish():
            last = self._looked_at.get(description.actuator_id, number)
            self._publish(_completed(number, last, description, estimate), estimate)

    def refuse(self, segment: Segment, reason: str) -> None:
        """Publish why a window is not identified; its own refusal when the reason is empty.

        A stretch of ordinary motion is one of many: that it is not identified is no news.
        """
        if not segment.is_stretch:
            self._publish(segment, self._refusal(segment, reason))

    def _run(self, queue: WindowQueue) -> None:
        while (segment := queue.next()) is not None:
            self._identify_and_publish(segment, queue)

    def _note_end(self, queue: WindowQueue, failure: str, trace: str) -> None:
        """Refuse the window at which the thread has ended; those that wait have to wait longer."""
        self._log_error(f"{failure}\n{trace}")
        current = queue.abandon()
        if current is not None:
            self.refuse(current, failure)

    def _identify_and_publish(self, segment: Segment, queue: WindowQueue) -> None:
        if segment.is_stretch:
            self._combine_and_publish(segment, queue)
            return
        # A failure in one window must not end the identification of the others.
        try:
            estimate = self._identify(segment, queue)
        except Exception as error:
            estimate = self._refusal(segment, self._log_failure(segment, error))
        with queue.publishing(segment) as may_publish:
            if not may_publish:
                return
            self._last_faults.record(segment.description, estimate)
            try:
                self._publish(segment, estimate)
            except Exception as error:
                reason = self._log_failure(segment, error)
                try:
                    self.refuse(segment, reason)
                except Exception as second:
                    self._log_failure(segment, second)

    def _combine_and_publish(self, segment: Segment, queue: WindowQueue) -> None:
        description, combinations = segment.description, self._combinations
        self._looked_at[description.actuator_id] = segment.number
        try:
            found = combinations.add(
                description,
                self._calibration_of(description),
                self._settings_of(segment).search,
                self._settings_of(segment).combining,
                segment.window,
                previous=self._previous(description),
                is_stopped=lambda: queue.is_closed,
            )
        except Exception as error:
            tally = combinations.tally(description.actuator_id)
            # Settings that cannot be used fail for each stretch anew: the status names them.
            if isinstance(error, ValueError) and not isinstance(error, np.linalg.LinAlgError):
                reason = str(error)
            else:
                reason = self._log_failure(segment, error)
            self._report_tally(description.actuator_id, tally._replace(reason=reason))
            with queue.publishing(segment):
                return
        with queue.publishing(segment) as may_publish:
            if not may_publish:
                return
            for number, of, estimate in found:
                self._last_faults.record(of, estimate)
                of_stretches = replace(
                    _completed(number, segment.number, of, estimate), settings=segment.settings
                )
                try:
                    self._publish(of_stretches, estimate)
                except Exception as error:
                    self._log_failure(segment, error)
            self._report_tally(description.actuator_id, combinations.tally(description.actuator_id))

    def _settings_of(self, segment: Segment) -> WindowSettings:
        """Return the settings with which a window is identified: those when it began."""
        return segment.settings or self._settings()

    def _previous(self, description: ActuatorDescription) -> NDArray[np.float64] | None:
        """Return the faults at which the next search begins, None for a healthy actuator."""
        if description.actuator_id not in self._searched:
            self._searched.add(description.actuator_id)
            if (latest := self._latest_estimate(description)) is not None:
                self._last_faults.record(description, latest)
        return self._last_faults.of(description, self._calibration_of(description))

    def _identify(self, segment: Segment, queue: WindowQueue) -> Estimate:
        description = segment.description
        run = Identification(
            segment.window,
            description,
            self._calibration_of(description),
            self._settings_of(segment).search,
            previous=self._previous(description),
        )
        try:
            for _ in run:
                if queue.is_closed:
                    return self._refusal(segment, _STOPPED_DURING)
        except ValueError as error:
            return self._refusal(segment, str(error))
        if run.estimate is None:
            raise RuntimeError("the identification ended without an estimate")
        return run.estimate

    def _log_failure(self, segment: Segment, error: Exception) -> str:
        reason = f"the identification failed: {error!r}"
        self._log_error(f"window {segment.number}: {reason}\n{traceback.format_exc()}")
        return reason

    def _refusal(self, segment: Segment, reason: str) -> Estimate:
        window = segment.window
        if reason or isinstance(window, Window):
            window = Refusal(window.start_ns, window.end_ns, reason)
        calibration = self._calibration_of(segment.description)
        return refusal(window, calibration, self._settings_of(segment).search, window.reason)


def _completed(
    number: int, last: int, description: ActuatorDescription, estimate: Estimate
) -> Segment:
    """Return what an estimate of ordinary motion is of; its telemetry is not kept."""
    span = Refusal(estimate.start_ns, estimate.end_ns, estimate.reason)
    return Segment(number, description, span, is_stretch=True, last_stretch=last)
