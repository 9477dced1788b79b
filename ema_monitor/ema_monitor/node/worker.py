"""Identification in its own thread: windows in, estimates out in the same order."""

import traceback
from typing import TYPE_CHECKING

import numpy as np

from ema_core.levels import ERROR, OK, WARN
from ema_core.steady_thread import SteadyThread
from ema_core.wording import counted
from ema_monitor.diagnosis import Diagnosed, Diagnosis
from ema_monitor.identification.estimate import refusal
from ema_monitor.node.window_queue import QueueClosedError, WindowQueue
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

if TYPE_CHECKING:
    from ema_monitor.node.monitor_node import MonitorNode

_JOIN_S = 1.0


class IdentificationWorker:
    """Identifies windows one after the other, of the actuators in turn.

    Every window gets an estimate or a refusal, but for the refusals that ``WindowQueue`` gives up.
    A thread that ends by itself refuses the window that it was at, and is begun again.

    Once ``stop`` has returned, the thread publishes nothing any more, even if it still computes.

    The node has calibrations and settings, and publishes each window with its estimate: of
    stretches of ordinary motion, the one that completes an estimate.
    """

    def __init__(self, node: "MonitorNode") -> None:
        self._node = node
        self._diagnoses: dict[str, Diagnosis] = {}
        self._thread: SteadyThread | None = None
        self.queue = WindowQueue()
        self.queue.close()

    @property
    def ends(self) -> int:
        """Number of times that the thread has ended by itself since the start."""
        return self._thread.ends if self._thread is not None else 0

    def status(self) -> tuple[int, str]:
        """Return level and message for ``/diagnostics``."""
        if self._thread is None:
            return WARN, "not active"
        if self._thread.failure:
            return ERROR, self._thread.failure
        return OK, f"waiting: {counted(len(self.queue), 'window')}"

    def start(self) -> None:
        """Begin to identify, with a new thread and queue."""
        # The previous thread may still be in a search.
        self.queue = queue = WindowQueue()
        self._thread = SteadyThread(
            "identification",
            lambda: self._run(queue),
            lambda failure, trace: self._note_end(queue, failure, trace),
        )
        self._thread.start()

    def forget(self, actuator_id: str) -> None:
        """Begin the later searches of an actuator anew, and drop its windows that wait."""
        self._diagnoses.pop(actuator_id, None)
        self.queue.forget(actuator_id)

    def clear(self) -> None:
        """Begin later searches anew."""
        self._diagnoses.clear()

    def add(self, segment: Segment, most_waiting: int | None) -> list[Segment]:
        """Queue a window as ``WindowQueue.add`` does; refuse it if the thread does not run."""
        try:
            return self.queue.add(segment, most_waiting)
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
        waiting = self.queue.close()
        thread.end(_JOIN_S)
        current = self.queue.abandon()
        if current is not None:
            reason = "the monitor was stopped during the identification"
            self.refuse(current, reason, is_dropped=True)
        for segment in waiting:
            reason = "the monitor was stopped before the window was identified"
            self.refuse(segment, reason, is_dropped=True)
        # A thread that still computes has the old ones, and publishes nothing any more.
        diagnoses = self._diagnoses
        self._diagnoses = {name: one.stopped() for name, one in diagnoses.items()}
        for one in diagnoses.values():
            for found in one.finish():
                self._node.publish_estimate(_completed(found), found.estimate)

    def refuse(self, segment: Segment, reason: str, *, is_dropped: bool = False) -> None:
        """Publish why a window is not identified; its own refusal when the reason is empty.

        A stretch of ordinary motion is one of many: that it is not identified is no news.
        """
        if segment.is_stretch:
            return
        window = segment.window
        if reason or isinstance(window, Window):
            window = Refusal(window.start_ns, window.end_ns, reason, is_dropped)
        calibration = self._node.calibration_of(segment.description)
        estimate = refusal(window, calibration, self._node.search.value, window.reason)
        self._node.publish_estimate(segment, estimate)

    def _run(self, queue: WindowQueue) -> None:
        while (segment := queue.next()) is not None:
            self._identify_and_publish(segment, queue)

    def _note_end(self, queue: WindowQueue, failure: str, trace: str) -> None:
        """Refuse the window at which the thread has ended; those that wait have to wait longer."""
        self._node.log_error(f"{failure}\n{trace}")
        current = queue.abandon()
        if current is not None:
            self.refuse(current, failure)

    def _identify_and_publish(self, segment: Segment, queue: WindowQueue) -> None:
        # A failure in one window must not end the identification of the others.
        found, reason = [], ""
        try:
            found = self._diagnosed(segment, queue)
        except Exception as error:
            reason = str(error)
            # Settings that cannot be used are no failure: the estimate names them.
            if not isinstance(error, ValueError) or isinstance(error, np.linalg.LinAlgError):
                reason = self._log_failure(segment, error)
        if found is None:
            return
        actuator_id = segment.description.actuator_id
        with queue.publishing(segment) as may_publish:
            if not may_publish:
                return
            try:
                for one in found:
                    of = _completed(one) if segment.is_stretch else segment
                    self._node.publish_estimate(of, one.estimate)
                if reason:
                    self.refuse(segment, reason)
            except Exception as error:
                reason = self._log_failure(segment, error)
            if segment.is_stretch:
                tally = self._diagnosis(segment).tally
                tally = tally._replace(reason=reason) if reason else tally
                self._node.units.report_tally(actuator_id, tally)

    def _diagnosed(self, segment: Segment, queue: WindowQueue) -> list[Diagnosed] | None:
        """Return the estimates of a window, of a stretch perhaps none; None if that was stopped."""
        found: list[Diagnosed] = []
        for one in self._diagnosis(segment).add(
            segment,
            self._node.calibration_of(segment.description),
            self._node.search.value,
            self._node.combining.value if segment.is_stretch else None,
        ):
            if isinstance(one, Diagnosed):
                found.append(one)
            elif queue.is_closed:
                return None
        return found

    def _diagnosis(self, segment: Segment) -> Diagnosis:
        """Return the diagnosis of an actuator; its first search begins where its history ends."""
        actuator_id = segment.description.actuator_id
        diagnosis = self._diagnoses.get(actuator_id)
        if diagnosis is None:
            diagnosis = self._diagnoses[actuator_id] = Diagnosis()
            latest = self._node.prognosis.latest(segment.description)
            if latest is not None:
                diagnosis.begin_at(segment.description, latest)
        return diagnosis

    def _log_failure(self, segment: Segment, error: Exception) -> str:
        reason = f"the identification failed: {error!r}"
        self._node.log_error(f"window {segment.number}: {reason}\n{traceback.format_exc()}")
        return reason


def _completed(found: Diagnosed) -> Segment:
    """Return what an estimate of ordinary motion is of; its telemetry is not kept."""
    estimate = found.estimate
    span = Refusal(estimate.start_ns, estimate.end_ns, estimate.reason)
    return Segment(found.number, found.description, span, is_stretch=True, last_stretch=found.last)
