# SPDX-License-Identifier: Apache-2.0
"""Identification of windows in a separate thread, in order of completion."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from ema_core.levels import ERROR, OK, WARN
from ema_core.steady_thread import SteadyThread
from ema_core.wording import counted
from ema_monitor.calibrations import CalibrationStore
from ema_monitor.diagnosis import Diagnosed, Diagnosis
from ema_monitor.identification.estimate import refusal
from ema_monitor.identification.search import Generation
from ema_monitor.node.publish.actuators import Actuators
from ema_monitor.node.publish.log import Log
from ema_monitor.node.settings import NodeSettings
from ema_monitor.node.work.actuator_work import ActuatorWork
from ema_monitor.node.work.baselines import Baselines
from ema_monitor.node.work.histories import Histories
from ema_monitor.node.work.results import Results
from ema_monitor.node.work.window_queue import QueueClosedError, WindowQueue
from ema_monitor.reasons import IdentificationFailed, MonitorStopped, Reason, Stage
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

_JOIN_S = 1.0


class IdentificationWorker:
    """Identifies windows one at a time, serving the actuators in turn.

    Every window gets an estimate or a refusal, except the refusals that ``WindowQueue`` drops. If
    the thread fails, its current window is refused and the thread is restarted. After ``stop``
    has returned, the thread publishes nothing, even if it still computes.

    Parameters
    ----------
    results
        Publishes estimates.
    histories
        Earlier estimates, from which the first search of a unit starts.
    actuators
        Status of the actuators.
    baselines
        Baselines that learn from records.
    settings, store
        Settings of the node, and calibrations in use.
    log
        Log of the node.
    is_simulated
        Whether time is simulated: any number of windows may then be queued.

    Attributes
    ----------
    queue
        The windows to identify.
    thread
        Thread that identifies windows.
    works
        Identification state of each monitored actuator.
    """

    def __init__(
        self,
        results: Results,
        histories: Histories,
        actuators: Actuators,
        baselines: Baselines,
        settings: NodeSettings,
        store: CalibrationStore,
        log: Log,
        *,
        is_simulated: bool,
    ) -> None:
        self._results = results
        self._histories = histories
        self._actuators = actuators
        self._baselines = baselines
        self._settings = settings
        self._store = store
        self._log = log
        self._is_simulated = is_simulated
        self.works: dict[str, ActuatorWork] = {}
        self._prepare()
        self.queue.close()

    def _prepare(self) -> None:
        # The previous thread may still be in a search.
        self.queue = queue = WindowQueue()
        self.thread = SteadyThread(
            "identification", partial(self._run, queue), partial(self._note_end, queue)
        )

    def status(self) -> tuple[int, str]:
        """Return level and message of the identification thread for ``/diagnostics``."""
        if not self.thread.is_alive:
            return WARN, "not active"
        if self.thread.failure:
            return ERROR, self.thread.failure
        return OK, f"waiting: {counted(len(self.queue), 'window')}"

    def start(self) -> None:
        """Start a new thread with a new queue."""
        self._prepare()
        self.thread.start()

    def follow(self, actuator_id: str) -> None:
        """Prepare for the windows of an actuator."""
        self.works[actuator_id] = ActuatorWork()

    def forget(self, actuator_id: str) -> None:
        """Forget an actuator and its queued windows."""
        self.works.pop(actuator_id, None)
        self.queue.forget(actuator_id)

    def of(self, actuator_id: str) -> ActuatorWork:
        """Return the identification state of an actuator; a new state if it was just forgotten."""
        return self.works.get(actuator_id) or ActuatorWork()

    def add(self, segment: Segment) -> bool:
        """Queue a window; if live, it may displace the oldest window of its actuator.

        Returns False if the thread does not run: the window must then be refused.
        """
        self.of(segment.description.actuator_id).note(segment)
        operation = self._settings.operation.value
        most_waiting = None if self._is_simulated else operation.waiting_windows
        try:
            dropped = self.queue.add(segment, most_waiting)
        except QueueClosedError:
            return False
        for displaced in dropped:
            kind = "stretch" if displaced.is_stretch else "window"
            text = f"{kind} {displaced.number} is dropped, {len(self.queue)} queued"
            self._log.warn(displaced.description.actuator_id, text)
        return True

    def stop(self) -> None:
        """Stop, even in the middle of a window, and refuse the queued windows.

        The stretches of ordinary motion combined so far are published, without the current one.
        """
        if not self.thread.is_alive:
            return
        self.thread.ending.set()
        waiting = self.queue.close()
        self.thread.end(_JOIN_S)
        current = self.queue.abandon()
        if current is not None:
            self.refuse(current, MonitorStopped(Stage.IDENTIFICATION), is_dropped=True)
        for segment in waiting:
            self.refuse(segment, MonitorStopped(Stage.QUEUE), is_dropped=True)
        for work in list(self.works.values()):
            # A thread that still computes uses the old diagnosis, and publishes nothing.
            if (diagnosis := work.diagnosis) is not None:
                work.diagnosis = diagnosis.stopped()
                for diagnosed in diagnosis.finish():
                    self._results.publish(diagnosed)

    def refuse(self, segment: Segment, cause: Reason, *, is_dropped: bool = False) -> None:
        """Publish a window's refusal by the trigger, or else a refusal with ``cause``.

        Refused stretches of ordinary motion are not published: they are frequent.
        """
        if segment.is_stretch:
            return
        refused, number = segment.window, segment.number
        if isinstance(refused, Window):
            refused = Refusal(refused.start_ns, refused.end_ns, cause, is_dropped)
        calibration = self._store.of(segment.description)
        estimate = refusal(refused, calibration, self._settings.search.value, refused.cause)
        diagnosed = Diagnosed(number, number, segment.description, estimate)
        self._results.publish(diagnosed, segment.window)

    def _run(self, queue: WindowQueue) -> None:
        while (segment := queue.next()) is not None:
            self._identify_and_publish(segment, queue)

    def _note_end(self, queue: WindowQueue, failure: str, trace: str) -> None:
        """Refuse the window during which the thread failed; queued windows remain."""
        self._log.report_end(failure, trace)
        current = queue.abandon()
        if current is not None:
            self.refuse(current, IdentificationFailed(failure))

    def _identify_and_publish(self, segment: Segment, queue: WindowQueue) -> None:
        actuator_id = segment.description.actuator_id
        work, status = self.works.get(actuator_id), self._actuators.get(actuator_id)
        if work is None or status is None:
            return  # just forgotten
        if work.diagnosis is None:
            work.diagnosis = Diagnosis()
            # The first search starts from the whole history of the unit.
            for estimate in self._histories.estimates(segment.description):
                work.diagnosis.begin_at(segment.description, estimate)
        diagnosis = work.diagnosis
        where = f"window {segment.number}"
        # A failure in one window must not end the identification of the next.
        results, failure = list[Diagnosed](), ""
        try:
            for step in self._diagnosed(segment, diagnosis):
                if isinstance(step, Diagnosed):
                    results.append(step)
                elif queue.is_closed:
                    return
        except Exception as error:
            failure = str(error)
            # Unusable settings are not a failure of the program: the estimate names them.
            if not isinstance(error, ValueError) or isinstance(error, np.linalg.LinAlgError):
                failure = self._log.failed(where, "the identification", error)
        with queue.publishing(segment) as may_publish:
            if not may_publish:
                return
            try:
                for diagnosed in results:
                    window = None if segment.is_stretch else segment.window
                    self._results.publish(diagnosed, window)
                    if isinstance(window, Window):
                        self._baselines.note(diagnosed, window)
                if failure:
                    self.refuse(segment, IdentificationFailed(failure))
            except Exception as error:
                failure = self._log.failed(where, "the identification", error)
            if segment.is_stretch:
                tally = diagnosis.tally
                failed = (IdentificationFailed(failure),)
                status.tally = tally._replace(reasons=failed) if failure else tally

    def _diagnosed(
        self, segment: Segment, diagnosis: Diagnosis
    ) -> Iterator[Generation | Diagnosed]:
        """Yield the generations and estimates of a window (see ``Diagnosis.add``)."""
        if (estimate := self._baselines.learn(segment)) is not None:
            yield Diagnosed(segment.number, segment.number, segment.description, estimate)
            return
        combining = self._settings.combining.value if segment.is_stretch else None
        calibration = self._store.of(segment.description)
        yield from diagnosis.add(segment, calibration, self._settings.search.value, combining)
