# SPDX-License-Identifier: Apache-2.0
"""Detection of monitors that have ended, by the liveliness of their publishers of health."""

from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node

from ema_ros.peers import UNKNOWN_NODE, nodes_publishing
from ema_ros.topics import HEALTH, PLAYBACK_STATE


class MonitorLiveliness:
    """Liveliness of the monitors of a namespace, as observed by a subscription to ``health``.

    The middleware of a process asserts the liveliness of its publishers. A subscription that
    requests a lease (``topics.ALIVE_BY_MANY``) counts the publishers whose lease has expired, but
    does not name them. If one of several monitors ends, it disappears from the graph when the DDS
    lease of its process expires.

    A player publishes the health of any monitor: while it plays, all monitors count as alive.

    Parameters
    ----------
    namespace
        Full namespace of the monitors.

    Attributes
    ----------
    events
        Event callbacks of the subscription to ``health``.
    """

    def __init__(self, namespace: str) -> None:
        prefix = namespace.rstrip("/")
        self._health, self._playback_state = f"{prefix}/{HEALTH}", f"{prefix}/{PLAYBACK_STATE}"
        # Whether the leases of all publishers have expired. A new publisher is alive only after
        # its middleware has asserted its liveliness, up to two thirds of the lease later.
        self._is_lost = False
        self._present: set[str] = set()
        self._seen: set[str] = set()
        self._names_monitors = False
        self.events = SubscriptionEventCallbacks(liveliness=self._note)

    def update(self, node: Node) -> None:
        """Read from the graph which nodes publish health; call it before ``is_silent``."""
        present = nodes_publishing(node, self._health)
        is_named = not any(name.endswith(UNKNOWN_NODE) for name in present)
        is_played = bool(present & nodes_publishing(node, self._playback_state))
        self._names_monitors = is_named and not is_played
        self._present = present
        self._seen |= present

    def is_silent(self, monitor: str) -> bool:
        """Return whether a monitor whose health was received has ended or stands still.

        Parameters
        ----------
        monitor
            Full node name of the monitor, which is ``author`` of its messages.
        """
        if self._is_lost or not self._present:
            return True
        is_gone = monitor in self._seen and monitor not in self._present
        return is_gone and self._names_monitors

    def _note(self, event: Any) -> None:
        self._is_lost = not event.alive_count and event.not_alive_count > 0
