# SPDX-License-Identifier: Apache-2.0
"""Publishers of a monitor: one topic for estimates, latched topics per actuator."""

import threading
from collections.abc import Callable
from typing import Any, Final

from rclpy.duration import Duration
from rclpy.lifecycle.publisher import LifecyclePublisher
from rclpy.qos import DurabilityPolicy

from ema_core.description import ActuatorDescription
from ema_interfaces.msg import BaselineStatus, FrictionCurve, Health
from ema_monitor.diagnosis import Diagnosed
from ema_monitor.identification.window_fit import WindowFit
from ema_monitor.node.publish.messages import (
    advice_to_message,
    estimate_to_message,
    forecast_to_message,
    summary_of,
    window_fit_to_message,
)
from ema_monitor.prognosis.advice import Advice
from ema_monitor.prognosis.forecaster import Forecaster
from ema_monitor.prognosis.outlook import Outlook
from ema_ros import topics

_ACKNOWLEDGE: Final = Duration(nanoseconds=200_000_000)
_OF_UNKNOWN_DRIVES: Final = (topics.BASELINE, topics.FRICTION_CURVE)
"""Topics whose publishers are created when an actuator first needs them."""


class Outputs:
    """Publishes the results of tests.

    Parameters
    ----------
    add_publisher
        Creates a publisher from message class, topic and quality of service.
    remove_publisher
        Removes a publisher.

    Attributes
    ----------
    estimates
        Publisher of the estimates.
    """

    def __init__(
        self,
        add_publisher: Callable[..., LifecyclePublisher],
        remove_publisher: Callable[[LifecyclePublisher], object],
    ) -> None:
        self._add_publisher, self._remove_publisher = add_publisher, remove_publisher
        # Each actuator has a publisher for each topic, so that its latest message stays latched.
        self._latched: dict[tuple[str, str], LifecyclePublisher] = {}
        self._lock = threading.Lock()
        message_class, qos = topics.MONITOR_TOPICS[topics.FAULT_ESTIMATE]
        self.estimates = add_publisher(message_class, topics.FAULT_ESTIMATE, qos)

    def add(self, actuator_id: str) -> None:
        """Create the publishers that every actuator needs."""
        with self._lock:
            for topic, (_, qos) in topics.MONITOR_TOPICS.items():
                is_latched = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
                if is_latched and topic not in _OF_UNKNOWN_DRIVES:
                    self._add(topic, actuator_id)

    def _add(self, topic: str, actuator_id: str) -> LifecyclePublisher:
        message_class, qos = topics.MONITOR_TOPICS[topic]
        # Events on incompatible subscriptions are slow with many publishers.
        quiet = bool(self._latched)
        publisher = self._add_publisher(message_class, topic, qos, quiet=quiet)
        self._latched[topic, actuator_id] = publisher
        return publisher

    def remove(self, actuator_id: str) -> None:
        """Remove the publishers of an actuator.

        Each waits at most 0.2 s until subscribers have received its latest message.
        """
        with self._lock:
            for key in [key for key in self._latched if key[1] == actuator_id]:
                publisher = self._latched.pop(key)
                publisher.wait_for_all_acked(_ACKNOWLEDGE)
                self._remove_publisher(publisher)

    def clear(self) -> None:
        """Stop publishing for all actuators; the node removes the publishers."""
        with self._lock:
            self._latched.clear()

    def publish_estimate(self, diagnosed: Diagnosed) -> None:
        """Publish an estimate."""
        message = estimate_to_message(diagnosed.estimate, diagnosed.number, diagnosed.description)
        self.estimates.publish(message)

    def publish_health(self, health: Health) -> None:
        """Publish the health of an actuator, and its summary."""
        self._publish(topics.HEALTH, health)
        self._publish(topics.HEALTH_SUMMARY, summary_of(health))

    def publish_fit(self, fit: WindowFit, diagnosed: Diagnosed) -> None:
        """Publish the signals of a window, measured and modelled."""
        self._publish(topics.WINDOW_FIT, window_fit_to_message(fit, diagnosed))

    def publish_baseline(self, status: BaselineStatus) -> None:
        """Publish the status of a learned baseline."""
        self._publish(topics.BASELINE, status)

    def publish_curve(self, curve: FrictionCurve) -> None:
        """Publish the friction curve (friction over speed) of the latest record."""
        self._publish(topics.FRICTION_CURVE, curve)

    def publish_forecast(self, forecaster: Forecaster, description: ActuatorDescription) -> None:
        """Publish the fault forecast of a unit."""
        self._publish(topics.HEALTH_FORECAST, forecast_to_message(forecaster, description))

    def publish_advice(
        self, advice: Advice, outlook: Outlook, cost_unit: str, description: ActuatorDescription
    ) -> None:
        """Publish the removal advice for a unit, computed from ``outlook``."""
        message = advice_to_message(advice, outlook, cost_unit, description)
        self._publish(topics.ADVICE, message)

    def _publish(self, topic: str, message: Any) -> None:
        """Publish on a latched topic of an actuator, unless the actuator was forgotten."""
        name = message.actuator_id
        with self._lock:
            publisher = self._latched.get((topic, name))
            if publisher is None and (topics.HEALTH, name) in self._latched:
                publisher = self._add(topic, name)
        if publisher is not None:
            publisher.publish(message)
