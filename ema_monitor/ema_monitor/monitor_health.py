"""The topic ``health`` of a monitor: who is told of, when, and by which publisher."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Final

from rclpy.lifecycle.publisher import LifecyclePublisher

from ema_core.description import ActuatorDescription
from ema_interfaces.msg import Health
from ema_messages import topics
from ema_monitor.estimate import Estimate
from ema_monitor.monitor_units import Units
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.watch import Found

if TYPE_CHECKING:
    from ema_monitor.monitor_node import MonitorNode

_STALE_CHECK_S: Final = 1.0


class MonitorHealth:
    """Publishes the health of each actuator after its tests, from its history, and when stale.

    Parameters
    ----------
    node
        The monitor.
    units
        Its actuators.
    lock
        Held while they are looked at, and while health is published: nothing older may follow
        the health after a test.
    """

    def __init__(self, node: MonitorNode, units: Units, lock: threading.RLock) -> None:
        self._node = node
        self._units = units
        self._lock = lock
        self._publishers: dict[str, LifecyclePublisher] = {}

    def begin(self) -> None:
        """Begin to look whether health has become stale."""
        self._timer = self._node.create_timer(_STALE_CHECK_S, self._check_freshness)

    def end(self) -> None:
        """Withdraw what was published."""
        self._node.destroy_timer(self._timer)
        for publisher in self._publishers.values():
            self._node.destroy_lifecycle_publisher(publisher)
        self._publishers.clear()

    def add(self, actuator_id: str) -> None:
        """Offer the health of an actuator: one publisher for each, so that each is latched.

        Parameters
        ----------
        actuator_id
            Which actuator.
        """
        message_class, qos = topics.MONITOR_TOPICS[topics.HEALTH]
        self._publishers[actuator_id] = self._node.add_publisher(
            message_class, topics.HEALTH, qos, quiet=bool(self._publishers)
        )

    def conclude(
        self, found: Found, estimate: Estimate, outlook: Outlook | None, now_ns: int
    ) -> None:
        """Tell the health after a test.

        Parameters
        ----------
        found
            Its window.
        estimate
            What was found in it.
        outlook
            What there is to say after it; None when the estimate is not valid.
        now_ns
            When the estimate was there, by the node's clock [ns].
        """
        with self._lock:
            unit = self._units[found.description.actuator_id]
            self._publish(unit.conclude(found, estimate, outlook, now_ns))

    def resume(self, description: ActuatorDescription, outlook: Outlook) -> None:
        """Tell the health of a unit as its history has it, until its next test.

        Parameters
        ----------
        description
            The unit.
        outlook
            What there is to say after the latest test in the history.
        """
        with self._lock:
            unit = self._units.get(description.actuator_id)
            if unit is None or self._node.idle:
                return
            self._publish(
                unit.resume(
                    description,
                    outlook,
                    self._node.operation.value.expected_period_s,
                    self._node.get_clock().now().nanoseconds,
                )
            )
        self._node.report()

    def _check_freshness(self) -> None:
        if self._node.idle:
            return
        with self._lock:
            now_ns = self._node.get_clock().now().nanoseconds
            period_s = self._node.operation.value.expected_period_s
            grown = (unit.grow_stale(period_s, now_ns) for unit in self._units.values())
            stale = [health for health in grown if health is not None]
            for health in stale:
                self._publish(health)
        for health in stale:
            self._node.get_logger().warning(f"{health.actuator_id}: {health.reason}")
        if stale:
            self._node.report()

    def _publish(self, health: Health | None) -> None:
        if health is not None:
            self._publishers[health.actuator_id].publish(health)
