"""The topics of a monitor: estimates of all actuators, and latched ones of each actuator."""

from collections.abc import Callable
from typing import Any

from rclpy.lifecycle.publisher import LifecyclePublisher

from ema_core.description import ActuatorDescription
from ema_interfaces.msg import Health
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


class Outputs:
    """Publishes what follows from tests.

    Parameters
    ----------
    add_publisher
        Returns a new publisher of a class of messages on a topic with a quality of service.
    remove_publisher
        Removes one.

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
        # One of each topic for each actuator, so that each is latched.
        self._latched: dict[tuple[str, str], LifecyclePublisher] = {}
        message_class, qos = topics.MONITOR_TOPICS[topics.FAULT_ESTIMATE]
        self.estimates = add_publisher(message_class, topics.FAULT_ESTIMATE, qos)

    def add(self, actuator_id: str) -> None:
        """Create the publishers of an actuator."""
        # Listening for what others want takes long where there are many publishers.
        quiet = bool(self._latched)
        for topic, (message_class, qos) in topics.MONITOR_TOPICS.items():
            if qos is topics.LATCHED:
                publisher = self._add_publisher(message_class, topic, qos, quiet=quiet)
                self._latched[topic, actuator_id] = publisher

    def remove(self, actuator_id: str) -> None:
        """Remove the publishers of an actuator."""
        for key in [key for key in self._latched if key[1] == actuator_id]:
            self._remove_publisher(self._latched.pop(key))

    def clear(self) -> None:
        """Publish nothing of any actuator any more; the publishers are removed with the node's."""
        self._latched.clear()

    def publish_estimate(self, found: Diagnosed) -> None:
        """Publish an estimate."""
        message = estimate_to_message(found.estimate, found.number, found.description)
        self.estimates.publish(message)

    def publish_health(self, health: Health) -> None:
        """Publish the health of an actuator, whole and in a few lines."""
        self._publish(topics.HEALTH, health)
        self._publish(topics.HEALTH_SUMMARY, summary_of(health))

    def publish_fit(self, fit: WindowFit, found: Diagnosed) -> None:
        """Publish a window beside the response of the model."""
        self._publish(topics.WINDOW_FIT, window_fit_to_message(fit, found))

    def publish_forecast(self, forecaster: Forecaster, description: ActuatorDescription) -> None:
        """Publish how the faults of a unit are expected to grow."""
        self._publish(topics.HEALTH_FORECAST, forecast_to_message(forecaster, description))

    def publish_advice(
        self, advice: Advice, outlook: Outlook, cost_unit: str, description: ActuatorDescription
    ) -> None:
        """Publish when to remove a unit; ``outlook`` is what that rests on."""
        message = advice_to_message(advice, outlook, cost_unit, description)
        self._publish(topics.ADVICE, message)

    def _publish(self, topic: str, message: Any) -> None:
        """Publish what is latched of an actuator, unless that is forgotten."""
        publisher = self._latched.get((topic, message.actuator_id))
        if publisher is not None:
            publisher.publish(message)
