"""What follows from a test beside estimate and health, in a thread of its own."""

import threading
import traceback
from collections import Counter, deque
from collections.abc import Callable
from typing import Any, Final

from rclpy.lifecycle.publisher import LifecyclePublisher

from ema_core.description import ActuatorDescription
from ema_core.steady_thread import SteadyThread
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibrations import AnyCalibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.window_fit import window_fit
from ema_monitor.node.messages import advice_to_message, forecast_to_message, window_fit_to_message
from ema_monitor.prognosis.advice import Costs, advise
from ema_monitor.prognosis.forecaster import Forecaster
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.window import Window
from ema_ros import topics

_JOIN_S: Final = 5.0
MOST_WAITING: Final = 400
"""Number of messages to come beyond which some are dropped: a hundred tests'."""

_TOPICS: Final = (topics.HEALTH_FORECAST, topics.WINDOW_FIT, topics.ADVICE)

Job = Callable[[], None]


class FollowUps:
    """Publishes what follows from tests, in their order; no window waits for it.

    Where it does not keep up, the oldest of the actuator that has most are dropped: each is soon
    replaced by that of a later test, and what is written to a history is written with the next.

    Parameters
    ----------
    add_publisher
        Gives a new publisher of a topic of the monitor.
    calibration_of
        Gives the calibration of an actuator, or why there is none.
    write_assessment
        Keeps in the history of a unit what was found after its latest test.
    log_error
        Called with the traceback of a failure.

    Attributes
    ----------
    dropped
        Number that were dropped.
    """

    def __init__(
        self,
        add_publisher: Callable[[str], LifecyclePublisher],
        calibration_of: Callable[[ActuatorDescription], AnyCalibration | str],
        write_assessment: Callable[[ActuatorDescription], None],
        log_error: Callable[[str], object],
    ) -> None:
        self._add_publisher = add_publisher
        self._calibration_of = calibration_of
        self._write_assessment = write_assessment
        self._log_error = log_error
        self._publishers: dict[tuple[str, str], LifecyclePublisher] = {}
        self._queue: deque[tuple[str, Job]] = deque()
        # How many wait, by actuator.
        self._waiting: Counter[str] = Counter()
        self._changed = threading.Condition()
        self._is_ending = False
        self.dropped = 0
        self._thread: SteadyThread | None = None

    @property
    def failure(self) -> str:
        """Why the thread has ended by itself; empty when it did not lately."""
        return self._thread.failure if self._thread is not None else ""

    @property
    def ends(self) -> int:
        """Number of times that the thread has ended by itself since the start."""
        return self._thread.ends if self._thread is not None else 0

    @property
    def publishers(self) -> list[LifecyclePublisher]:
        """The publishers, one of each topic for each actuator, so that each is latched."""
        return list(self._publishers.values())

    def add_actuator(self, actuator_id: str) -> None:
        """Add the publishers of an actuator."""
        for topic in _TOPICS:
            self._publishers[topic, actuator_id] = self._add_publisher(topic)

    def remove_actuator(self, actuator_id: str) -> list[LifecyclePublisher]:
        """Publish no more of an actuator; return the publishers that it had."""
        return [self._publishers.pop((topic, actuator_id)) for topic in _TOPICS]

    def clear(self) -> None:
        """Forget the publishers, and what was dropped."""
        self._publishers.clear()
        self.dropped = 0

    @property
    def waiting(self) -> int:
        """Number that wait to be published."""
        return len(self._queue)

    def start(self) -> None:
        """Begin, with a new thread."""
        self._is_ending = False
        self._thread = SteadyThread(
            "follow-ups", self._run, lambda failure, trace: self._log_error(f"{failure}\n{trace}")
        )
        self._thread.start()

    def stop(self) -> None:
        """Publish what waits, and end the thread."""
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.ending.set()
            with self._changed:
                self._is_ending = True
                self._changed.notify()
            thread.end(_JOIN_S)

    def follow_health(
        self, description: ActuatorDescription, forecaster: Forecaster, costs: Costs
    ) -> None:
        """Publish what follows from a health that has been published; an advice rests on costs."""
        actuator_id = description.actuator_id
        self._add(actuator_id, lambda: self._publish_forecast(description, forecaster))
        self._add(actuator_id, lambda: self._publish_advice(description, forecaster, costs))
        self._add(actuator_id, lambda: self._write_assessment(description))

    def follow_estimate(self, segment: Segment, estimate: Estimate) -> None:
        """Publish the fit of an estimate that has been published, if it is of one window."""
        if isinstance(segment.window, Window) and not estimate.stretches:
            window, calibration = segment.window, self._calibration_of(segment.description)
            if isinstance(calibration, Calibration):
                self._add(
                    segment.description.actuator_id,
                    lambda: self._publish_fit(segment, window, estimate, calibration),
                )

    def _publish_forecast(self, description: ActuatorDescription, forecaster: Forecaster) -> None:
        message = forecast_to_message(forecaster, description)
        self._publish(topics.HEALTH_FORECAST, message)

    def _publish_advice(
        self, description: ActuatorDescription, forecaster: Forecaster, costs: Costs
    ) -> None:
        advice, outlook = advise(forecaster.outlook, costs), forecaster.outlook
        message = advice_to_message(advice, outlook, costs.unit, description)
        self._publish(topics.ADVICE, message)

    def _publish_fit(
        self, segment: Segment, window: Window, estimate: Estimate, calibration: Calibration
    ) -> None:
        fit = window_fit(window, estimate, calibration)
        message = window_fit_to_message(fit, estimate, segment.number, segment.description)
        self._publish(topics.WINDOW_FIT, message)

    def _publish(self, topic: str, message: Any) -> None:
        publisher = self._publishers.get((topic, message.actuator_id))
        if publisher is not None:  # else the actuator is forgotten
            publisher.publish(message)

    def _add(self, actuator_id: str, job: Job) -> None:
        if self._thread is None:
            return
        with self._changed:
            self._queue.append((actuator_id, job))
            self._waiting[actuator_id] += 1
            if len(self._queue) > MOST_WAITING:
                self._drop_one()
            self._changed.notify()

    def _drop_one(self) -> None:
        """Drop the oldest of the actuator that has most: one that is busy costs the others none."""
        busiest = max(self._waiting, key=self._waiting.__getitem__)
        place = next(i for i, (name, _) in enumerate(self._queue) if name == busiest)
        self._note_gone(busiest)
        del self._queue[place]
        self.dropped += 1

    def _note_gone(self, actuator_id: str) -> None:
        """Note that one less waits of an actuator."""
        self._waiting[actuator_id] -= 1
        if not self._waiting[actuator_id]:
            del self._waiting[actuator_id]

    def _next(self) -> Job | None:
        with self._changed:
            self._changed.wait_for(lambda: self._queue or self._is_ending)
            if not self._queue:
                return None
            actuator_id, job = self._queue.popleft()
            self._note_gone(actuator_id)
            return job

    def _run(self) -> None:
        while (job := self._next()) is not None:
            # A failure must not end what follows from the next test.
            try:
                job()
            except Exception as error:
                self._log_error(
                    f"what follows from a test failed: {error!r}\n{traceback.format_exc()}"
                )
