# SPDX-License-Identifier: Apache-2.0
"""Dashboard node: serves topics to Foxglove and to a web page."""

import os
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

from rclpy.clock import Clock as RosClock
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription import Subscription

from ema_core.wording import counted
from ema_dashboard.access import Access
from ema_dashboard.alerts import Alerts
from ema_dashboard.contents import FleetDocument
from ema_dashboard.hub import Hub
from ema_dashboard.known_topics import CLOCK, UNIT_HISTORY, KnownTopic, known_topics
from ema_dashboard.metrics import Metrics
from ema_dashboard.monitor_requests import MonitorRequests, read_baseline_change, read_note
from ema_dashboard.playback_control import PlaybackControl
from ema_dashboard.settings import (
    DashboardSettings,
    bound_socket,
    read_address,
    read_token,
    tls_context,
)
from ema_dashboard.unit_history import NamespaceHistories
from ema_dashboard.web_server import WebServer
from ema_interfaces.msg import Health, NodeStatus
from ema_ros.claims import Claims
from ema_ros.liveliness import MonitorLiveliness
from ema_ros.managed_node import ManagedNode
from ema_ros.node_parameters import declare, read
from ema_ros.peers import UNKNOWN_NODE
from ema_ros.run import run
from ema_ros.stamps import stamp_from_message
from ema_ros.status import ERROR, OK, WARN, Task
from ema_ros.topics import (
    BASELINE,
    DESCRIPTION,
    FAULT_ESTIMATE,
    HEALTH,
    HEALTH_SUMMARY,
    NODE_STATUS,
    PLAYBACK_STATE,
)

_DISCOVERY_S: Final = 0.2
_JUMP_NS: Final = 1_000_000_000
_NICENESS: Final = 5


class DashboardNode(ManagedNode):
    """ROS node that serves the topics of some namespaces and a web page that shows them.

    Parameters of the node are the fields of ``DashboardSettings``.

    Messages are forwarded without decoding. Topics that are neither latched nor needed for the
    history are received only while a client shows them. The node only observes, with two
    exceptions: clients may control a player, and send notes and baseline changes to monitors.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("dashboard", **kwargs)
        declare(self, DashboardSettings)

    def configure(self) -> None:
        """Start the web server."""
        settings = read(self, DashboardSettings)
        namespaces = settings.namespaces or (self.get_namespace(),)
        hosts = (settings.host, *settings.host_names)
        access = Access(hosts, settings.allowed_origins, read_token(settings.token_file))
        alert_address = read_address(settings.alerts)
        tls = tls_context(settings.tls_certificate, settings.tls_key)
        listener = bound_socket(settings.host, settings.port, settings.ports)
        port = listener.getsockname()[1]
        if settings.port not in (0, port):
            self.get_logger().warning(f"port {settings.port} is in use: listening on {port}")
        host = f"[{settings.host}]" if ":" in settings.host else settings.host
        self.address = f"http{'s' if tls else ''}://{host}:{port}/"
        self._topics = {topic.name: topic for topic in known_topics(namespaces)}
        self._inputs: dict[str, Subscription] = {}
        self._clock_ns: int | None = None
        self._hub = Hub()
        self._claims = Claims()
        self._playback = PlaybackControl(self, self._hub)
        self._histories = {
            name: NamespaceHistories(self, name, self._hub, self._time_ns) for name in namespaces
        }
        self._requests = {name: MonitorRequests(self, name, self._hub) for name in namespaces}
        self._metrics = Metrics(self._hub.figures)
        self._web = WebServer(
            listener,
            tls,
            access,
            self._hub,
            self._playback.ask,
            {
                "/note": partial(self._request, read_note),
                "/baseline": partial(self._request, read_baseline_change),
            },
            settings.most_clients,
            round(settings.buffer_mb * 1e6),
            {"/metrics": self._metrics.exposition, "/fleet.json": FleetDocument(settings.archive)},
            self.report_end,
        )
        self._web.start()
        self._alerts = (
            Alerts(self._hub.loop, alert_address, self.address) if alert_address else None
        )
        self.get_logger().info(f"dashboard at {self.address}")

    def activate(self) -> None:
        """Start the discovery of topics."""
        namespaces = {topic.namespace for topic in self._topics.values() if topic.namespace}
        self._liveliness = {namespace: MonitorLiveliness(namespace) for namespace in namespaces}
        self.add_timer(_DISCOVERY_S, self._discover)

    def deactivate(self) -> None:
        """Stop receiving; clients stay connected."""
        self._inputs.clear()

    def clean_up(self) -> None:
        """Disconnect the clients and free the port."""
        if self._alerts:
            self._alerts.close()
        self._web.stop()

    def counts(self) -> NodeStatus:
        """Return the address of the page."""
        return NodeStatus(kind=NodeStatus.DASHBOARD, address=self.address)

    def tasks(self) -> list[Task]:
        """Return the status: address, number of clients and dropped messages."""
        totals = self._hub.figures()
        values = {
            "address": self.address,
            "clients": totals.clients,
            "topics": len(self._hub),
            "sent messages": totals.messages,
            "sent [B]": totals.sent_bytes,
            "waiting [B]": totals.waiting_bytes,
            "dropped messages": totals.dropped,
            "refused requests": totals.refused,
            "ends of threads": self._web.thread.ends,
        }
        message = f"{counted(totals.clients, 'client')} at {self.address}"
        if totals.dropped:
            message += f", {counted(totals.dropped, 'message')} dropped for slow clients"
        level = OK
        if self._alerts:
            values |= {"alerts sent": self._alerts.sent, "alerts lost": self._alerts.lost}
            if self._alerts.failure:
                level, message = WARN, f"the latest alert was not delivered: {self._alerts.failure}"
        if failure := self._web.thread.failure:
            level, message = ERROR, failure
        return [Task("dashboard", level, message, self.hardware_id, values)]

    def _discover(self) -> None:
        """Offer topics that have a publisher, and subscribe to topics that are needed.

        A topic is needed if it is always followed or a client shows it; other subscriptions end.
        """
        for name, topic in self._topics.items():
            if name not in self._hub:
                if topic.request is not None and not self.count_publishers(name):
                    continue
                self._hub.add(topic)
            if topic.request is None:
                continue
            is_needed = topic.followed or self._hub.has_clients(name)
            if is_needed and name not in self._inputs:
                is_health = topic.relative == HEALTH
                self._inputs[name] = self.create_subscription(
                    topic.message_class,
                    name,
                    self._receiver(topic),
                    topic.request,
                    event_callbacks=self._liveliness[topic.namespace].events if is_health else None,
                    raw=True,
                )
            elif not is_needed and name in self._inputs:
                self.destroy_subscription(self._inputs.pop(name))
        if not self.count_publishers(CLOCK):
            self._clock_ns = None
        for histories in self._histories.values():
            histories.update()
        for requests in self._requests.values():
            requests.update()
        self._find_player()
        self._end_claims()

    def _end_claims(self) -> None:
        """Publish STALE when a level expires or its monitor is silent."""
        for liveliness in self._liveliness.values():
            liveliness.update(self)
        now_ns, is_real = self._time_ns(), self._clock_ns is None
        changes = self._claims.changes(now_ns, time.monotonic(), self._is_silent, is_real=is_real)
        for (name, _), health in changes:
            topic = self._topics[name]
            data = serialize_message(health)
            stamp_ns = stamp_from_message(health.header.stamp)
            self._hub.keep(name, health.actuator_id, data, now_ns, stamp_ns)
            self._hub.publish(name, data, now_ns)
            if topic.relative == HEALTH:
                self._note(topic.namespace, health)

    def _is_silent(self, name: str, author: str) -> bool:
        return self._liveliness[self._topics[name].namespace].is_silent(author)

    def _find_player(self) -> None:
        """Let clients control the player in the graph; end the control if there is none.

        There is at most one player at a time.
        """
        topics = self._topics.values()
        states = [topic.name for topic in topics if topic.relative == PLAYBACK_STATE]
        for name in states:
            for item in self.get_publishers_info_by_topic(name):
                if item.node_name != UNKNOWN_NODE:  # else wait for the discovery of its name
                    namespace = item.node_namespace.rstrip("/")
                    self._playback.set_player(f"{namespace}/{item.node_name}")
                return
        self._playback.set_player("")
        if self._hub.playback_range is not None:
            for name in states:
                if name in self._hub:
                    self._hub.forget(name, -1)
            self._hub.offer_playback(None)

    def _receiver(self, topic: KnownTopic) -> Callable[..., None]:
        def receive(data: bytes, information: Mapping[str, Any]) -> None:
            log_time_ns = self._clock_ns or information["received_timestamp"]
            if topic.name == CLOCK:
                self._note_time(
                    stamp_from_message(deserialize_message(data, topic.message_class).clock)
                )
            elif topic.relative == NODE_STATUS:
                status = deserialize_message(data, topic.message_class)
                self._note_node(topic.namespace, status)
            elif topic.kept:
                message = deserialize_message(data, topic.message_class)
                key = getattr(message, "actuator_id", "")
                stamp_ns = stamp_from_message(message.header.stamp)
                self._hub.keep(topic.name, key, data, log_time_ns, stamp_ns)
                self._follow(topic, message)
            self._hub.publish(topic.name, data, log_time_ns)

        return receive

    def _note_node(self, namespace: str, status: NodeStatus) -> None:
        """Store the counts of a node, and the lost samples of each actuator of a monitor."""
        self._metrics.note_node(namespace, status)
        for counted_of in status.telemetry:
            self._histories[namespace].note_lost_samples(
                counted_of.actuator_id, status.header.stamp, counted_of.samples_lost
            )

    def _follow(self, topic: KnownTopic, message: Any) -> None:
        """Update history, metrics, level validity and playback control from a message."""
        if topic.relative in (HEALTH, HEALTH_SUMMARY):
            key = topic.name, message.actuator_id
            self._claims.note(key, message, self._time_ns(), time.monotonic())
        if topic.relative in (DESCRIPTION, FAULT_ESTIMATE, HEALTH):
            self._histories[topic.namespace].note(message)
            self._note(topic.namespace, message)
        elif topic.relative == BASELINE:
            self._metrics.note(topic.namespace, message)
        elif topic.relative == PLAYBACK_STATE:
            bounds = stamp_from_message(message.start), stamp_from_message(message.end)
            if bounds != self._hub.playback_range:
                self._hub.offer_playback(bounds)
            if message.jumped:
                self._note_time(stamp_from_message(message.position))
            self._playback.note_state(message)

    def _note(self, namespace: str, message: Any) -> None:
        """Update metrics and alerts from a message. A playback causes no alerts."""
        self._metrics.note(namespace, message)
        if self._alerts and isinstance(message, Health) and not self._is_playback():
            self._alerts.note(namespace, message)

    def _is_playback(self) -> bool:
        """Return whether a player exists, even before it has published its range."""
        topics = self._topics.values()
        names = (topic.name for topic in topics if topic.relative == PLAYBACK_STATE)
        return self._hub.playback_range is not None or any(map(self.count_publishers, names))

    async def _request(self, read: Callable[[Any], tuple[str, Any]], content: Any) -> None:
        """Send a client's request to the monitors of its namespace."""
        namespace, request = read(content)
        requests = self._requests.get(namespace or "/")
        if requests is None:
            raise ValueError("this namespace is not shown by the dashboard")
        await requests.send(request)

    def _note_time(self, time_ns: int) -> None:
        """Store the ROS time; if it jumps back, discard later messages."""
        before_ns, self._clock_ns = self._clock_ns, time_ns
        if before_ns is None or time_ns >= before_ns - _JUMP_NS:
            return
        for name, topic in self._topics.items():
            if topic.kept and topic.relative != UNIT_HISTORY and name in self._hub:
                self._hub.forget(name, time_ns)
        for histories in self._histories.values():
            histories.rewind(time_ns)
        self._metrics.rewind(time_ns)
        self._claims.rewind(time_ns)

    def _time_ns(self) -> int:
        return self._clock_ns or RosClock().now().nanoseconds


def main(args: list[str] | None = None) -> int:
    """Run the dashboard node."""
    # Nodes of the graph have priority over requests of clients.
    os.nice(_NICENESS)
    return run(DashboardNode, args)
