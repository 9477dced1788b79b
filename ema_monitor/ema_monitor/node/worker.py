"""Identification in its own thread: windows in, estimates out in the same order."""

import traceback
from collections.abc import Callable, Mapping

import numpy as np

from ema_core.description import ActuatorDescription
from ema_core.levels import ERROR, OK, WARN
from ema_core.steady_thread import SteadyThread
from ema_core.wording import counted
from ema_monitor.calibrations import AnyCalibration
from ema_monitor.diagnosis import Diagnosed, Diagnosis
from ema_monitor.identification.estimate import Estimate, refusal
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
        Gives the settings of searches and combinations.
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
        self._diagnoses: dict[str, Diagnosis] = {}
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
        self._diagnoses.clear()

    def forget_actuator(self, actuator_id: str) -> None:
        """Begin the later searches of one actuator anew, and drop its windows that wait."""
        self._diagnoses.pop(actuator_id, None)
        self._queue.forget(actuator_id)

    def add(self, segment: Segment, most_waiting: int | None) -> list[Segment]:
        """Queue a window as ``WindowQueue.add`` does; refuse it if the thread does not run."""
        try:
            return self._queue.add(segment, most_waiting)
        except QueueClosedError:
            self.refuse(segment, "the monitor is not active", is_dropped=True)
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
            self.refuse(current, _STOPPED_DURING, is_dropped=True)
        for segment in waiting:
            reason = "the monitor was stopped before the window was identified"
            self.refuse(segment, reason, is_dropped=True)
        # A thread that still computes has the old ones, and publishes nothing any more.
        diagnoses = self._diagnoses
        self._diagnoses = {name: one.stopped() for name, one in diagnoses.items()}
        for one in diagnoses.values():
            for found in one.finish():
                self._publish(_completed(found), found.estimate)

    def refuse(self, segment: Segment, reason: str, *, is_dropped: bool = False) -> None:
        """Publish why a window is not identified; its own refusal when the reason is empty.

        A stretch of ordinary motion is one of many: that it is not identified is no news.
        """
        if not segment.is_stretch:
            self._publish(segment, self._refusal(segment, reason, is_dropped=is_dropped))

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
        # A failure in one window must not end the identification of the others.
        try:
            found = self._diagnosed(segment, queue)
        except Exception as error:
            # Settings that cannot be used are no failure: the estimate names them.
            is_refusal = isinstance(error, ValueError) and not isinstance(
                error, np.linalg.LinAlgError
            )
            reason = str(error) if is_refusal else self._log_failure(segment, error)
            with queue.publishing(segment) as may_publish:
                if may_publish:
                    self._report_failure(segment, reason)
            return
        with queue.publishing(segment) as may_publish:
            if not may_publish:
                return
            for one in found:
                of = _completed(one) if segment.is_stretch else segment
                try:
                    self._publish(of, one.estimate)
                except Exception as error:
                    self._report_failure(segment, self._log_failure(segment, error))
            if segment.is_stretch:
                actuator_id = segment.description.actuator_id
                self._report_tally(actuator_id, self._diagnosis(segment).tally)

    def _diagnosed(self, segment: Segment, queue: WindowQueue) -> list[Diagnosed]:
        """Return the estimates of a window; those that a stretch completes may be none."""
        settings = self._settings()
        found: list[Diagnosed] = []
        for one in self._diagnosis(segment).add(
            segment,
            self._calibration_of(segment.description),
            settings.search,
            settings.combining if segment.is_stretch else None,
        ):
            if queue.is_closed:
                if not segment.is_stretch:
                    refused = self._refusal(segment, _STOPPED_DURING, is_dropped=True)
                    found = [
                        Diagnosed(segment.number, segment.number, segment.description, refused)
                    ]
                break
            if isinstance(one, Diagnosed):
                found.append(one)
        return found

    def _diagnosis(self, segment: Segment) -> Diagnosis:
        """Return the diagnosis of an actuator; its first search begins where its history ends."""
        actuator_id = segment.description.actuator_id
        diagnosis = self._diagnoses.get(actuator_id)
        if diagnosis is None:
            diagnosis = self._diagnoses[actuator_id] = Diagnosis()
            if (latest := self._latest_estimate(segment.description)) is not None:
                diagnosis.begin_at(segment.description, latest)
        return diagnosis

    def _report_failure(self, segment: Segment, reason: str) -> None:
        """Refuse a window that failed; of a stretch, the status names the reason."""
        try:
            if segment.is_stretch:
                tally = self._diagnosis(segment).tally._replace(reason=reason)
                self._report_tally(segment.description.actuator_id, tally)
            else:
                self.refuse(segment, reason)
        except Exception as error:
            self._log_failure(segment, error)

    def _log_failure(self, segment: Segment, error: Exception) -> str:
        reason = f"the identification failed: {error!r}"
        self._log_error(f"window {segment.number}: {reason}\n{traceback.format_exc()}")
        return reason

    def _refusal(self, segment: Segment, reason: str, *, is_dropped: bool = False) -> Estimate:
        window = segment.window
        if reason or isinstance(window, Window):
            window = Refusal(window.start_ns, window.end_ns, reason, is_dropped)
        calibration = self._calibration_of(segment.description)
        return refusal(window, calibration, self._settings().search, window.reason)


def _completed(found: Diagnosed) -> Segment:
    """Return what an estimate of ordinary motion is of; its telemetry is not kept."""
    estimate = found.estimate
    span = Refusal(estimate.start_ns, estimate.end_ns, estimate.reason)
    return Segment(found.number, found.description, span, is_stretch=True, last_stretch=found.last)
