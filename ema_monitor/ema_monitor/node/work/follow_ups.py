# SPDX-License-Identifier: Apache-2.0
"""Forecast, advice and window fit after a test, published in a separate thread."""

import threading
from collections import deque
from collections.abc import Callable
from typing import Final

from ema_core.description import ActuatorDescription
from ema_core.steady_thread import SteadyThread
from ema_monitor.calibration.joint_calibration import JointCalibration
from ema_monitor.calibrations import CalibrationStore
from ema_monitor.diagnosis import Diagnosed
from ema_monitor.identification.joint_estimate import record_curve
from ema_monitor.identification.window_fit import window_fit
from ema_monitor.node.publish.log import Log
from ema_monitor.node.publish.messages import curve_to_message
from ema_monitor.node.publish.outputs import Outputs
from ema_monitor.node.settings import NodeSettings
from ema_monitor.node.work.histories import Histories
from ema_monitor.prognosis.advice import advise
from ema_monitor.prognosis.forecaster import Forecaster
from ema_monitor.reasons import Reason
from ema_monitor.windows.window import Window

_JOIN_S: Final = 5.0
MOST_WAITING: Final = 400
"""Length of the queue beyond which the oldest follow-ups are dropped: about 100 tests."""


class FollowUps:
    """Publishes forecasts, advice and window fits, and writes assessments, in test order.

    Identification never waits for follow-ups. If the thread cannot keep up, it drops the oldest:
    later tests soon replace them, and assessments are written with the next test. A new thread
    first waits for the end of the previous one, so that follow-ups are published one by one.

    Attributes
    ----------
    dropped
        Number of dropped follow-ups.
    """

    def __init__(
        self,
        outputs: Outputs,
        histories: Histories,
        settings: NodeSettings,
        store: CalibrationStore,
        log: Log,
    ) -> None:
        self._outputs = outputs
        self._histories = histories
        self._settings = settings
        self._store = store
        self._log = log
        self._changed = threading.Condition()
        self.dropped = 0
        self._prepare()

    def _prepare(self, previous: SteadyThread | None = None) -> None:
        self._queue = queue = deque[Callable[[], None]]()

        def work() -> None:
            if previous is not None:
                previous.end()
            self._run(queue, thread.ending)

        self.thread = thread = SteadyThread("follow-ups", work, self._log.report_end)

    @property
    def waiting(self) -> int:
        """Number of queued follow-ups."""
        return len(self._queue)

    def start(self) -> None:
        """Start a new thread."""
        self._prepare(self.thread if self.thread.is_alive else None)
        self.thread.start()

    def stop(self) -> None:
        """Publish the queued follow-ups for up to 5 s, drop the rest, and end the thread."""
        self.thread.ending.set()
        with self._changed:
            self._changed.notify_all()
        self.thread.end(_JOIN_S)
        with self._changed:
            self.dropped += len(self._queue)
            self._queue.clear()

    def follow_health(self, description: ActuatorDescription, forecaster: Forecaster) -> None:
        """Queue the forecast, advice and assessment for newly published health."""
        outputs, costs = self._outputs, self._settings.costs.value

        def publish_advice() -> None:
            advice, outlook = advise(forecaster.outlook, costs), forecaster.outlook
            outputs.publish_advice(advice, outlook, costs.unit, description)

        self._add(lambda: outputs.publish_forecast(forecaster, description))
        self._add(publish_advice)
        self._add(lambda: self._histories.write_assessment(description))

    def follow_estimate(self, diagnosed: Diagnosed, window: Window) -> None:
        """Queue the window fit of a published estimate, or the friction curve of a record."""
        calibration = self._store.of(diagnosed.description)
        if isinstance(calibration, JointCalibration):
            if diagnosed.estimate.comparison is not None:
                self._add(lambda: self._publish_curve(diagnosed, window, calibration))
            return
        if isinstance(calibration, Reason):
            return

        def publish_fit() -> None:
            fit = window_fit(window, diagnosed.estimate, calibration)
            self._outputs.publish_fit(fit, diagnosed)

        self._add(publish_fit)

    def _publish_curve(
        self, diagnosed: Diagnosed, window: Window, calibration: JointCalibration
    ) -> None:
        curve = record_curve(window, diagnosed.description, calibration)
        if curve is not None:
            self._outputs.publish_curve(curve_to_message(curve, diagnosed, calibration))

    def _add(self, job: Callable[[], None]) -> None:
        with self._changed:
            if not self.thread.is_alive or self.thread.ending.is_set():
                return
            self._queue.append(job)
            if len(self._queue) > MOST_WAITING:
                self._queue.popleft()
                self.dropped += 1
            self._changed.notify_all()

    def _next(
        self, queue: deque[Callable[[], None]], ending: threading.Event
    ) -> Callable[[], None] | None:
        with self._changed:
            self._changed.wait_for(lambda: queue or ending.is_set())
            return queue.popleft() if queue else None

    def _run(self, queue: deque[Callable[[], None]], ending: threading.Event) -> None:
        while (job := self._next(queue, ending)) is not None:
            # A failure must not prevent the follow-ups of the next test.
            try:
                job()
            except Exception as error:
                self._log.failed("follow-ups", "publishing the results of a test", error)
