"""``ema watch``: show the health of all actuators in the terminal."""

import os
import threading
import time
from collections.abc import Iterable
from typing import Any, Final

import click
from rclpy.exceptions import InvalidNamespaceException
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.validate_namespace import validate_namespace
from rosgraph_msgs.msg import Clock

from ema_cli.options import network_option
from ema_cli.processes.listener import Listener
from ema_cli.processes.reach import set_reach
from ema_cli.processes.stop_request import ENDING, deferred_signals
from ema_cli.show.health_table import HealthTable, LatestHealths, Row
from ema_interfaces.msg import FaultEstimate, Health, NodeStatus, PlaybackState, TelemetryStatus
from ema_ros.stamps import stamp_from_message
from ema_ros.topics import (
    FAULT_ESTIMATE,
    HEALTH,
    LATCHED_BY_MANY,
    NAMESPACE,
    NODE_STATUS,
    PLAYBACK_STATE,
    STREAM,
)

_CLOCK: Final = "/clock"
_BEST_EFFORT: Final = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_REFRESH_S: Final = 0.25
_DISCOVERY_S: Final = 3.0


@click.command()
@click.option(
    "--namespace",
    "namespaces",
    multiple=True,
    default=(NAMESPACE,),
    help="Namespace of a monitor; may be repeated.",
)
@click.option(
    "--until-played",
    is_flag=True,
    help="End after a player has ended and the monitor has identified the played data.",
)
@network_option
def watch(namespaces: tuple[str, ...], until_played: bool, network: bool) -> None:
    """Show the health of all actuators, the worst first, until Ctrl-C.

    On a terminal it is a table that is renewed; else there is a line for each change. An actuator
    whose monitor is silent is STALE. ROS_DOMAIN_ID says in which domain to listen.
    """
    set_reach(network)
    places = list(dict.fromkeys(_normalised(namespace) for namespace in namespaces))
    with (
        deferred_signals(*ENDING) as stop,
        HealthTable(f"on {', '.join(places)} in {_domain()}") as table,
        _HealthListener(places) as hearing,
    ):
        began_s = time.monotonic()
        player_seen = False
        while not stop and not (until_played and hearing.completion.is_complete):
            if until_played:
                is_there = any(hearing.sees("player", place) for place in places)
                if player_seen and not is_there:
                    hearing.completion.end()
                player_seen |= is_there
            rows = hearing.rows()
            waits = time.monotonic() - began_s < _DISCOVERY_S
            table.show(rows, "" if rows or waits else _no_health(places, hearing))
            hearing.changed.wait(_REFRESH_S)
            hearing.changed.clear()
        table.show(hearing.rows(), "")


class _HealthListener(Listener):
    """Collects messages from some namespaces; a context manager.

    Attributes
    ----------
    changed
        Event that is set when new data arrived.
    completion
        Tracks whether all played data are diagnosed.
    """

    def __init__(self, places: list[str]) -> None:
        topics: dict[str, tuple[type, QoSProfile]] = {_CLOCK: (Clock, _BEST_EFFORT)}
        self._places: dict[str, str] = {}
        self._monitors: set[str] = set()
        self.completion = Completion()
        for place in places:
            topics[f"{place.rstrip('/')}/{PLAYBACK_STATE}"] = PlaybackState, LATCHED_BY_MANY
            for name, kind, qos in (
                (HEALTH, Health, LATCHED_BY_MANY),
                (FAULT_ESTIMATE, FaultEstimate, STREAM),
                (NODE_STATUS, NodeStatus, STREAM),
            ):
                topic = f"{place.rstrip('/')}/{name}"
                topics[topic] = kind, qos
                self._places[topic] = place
        self.changed = threading.Event()
        self._lock = threading.Lock()
        self._healths = LatestHealths()
        self._simulated_ns: int | None = None
        super().__init__("watch", topics, self._note)

    def _note(self, topic: str, message: Any) -> None:
        """Process a received message."""
        now_s = time.monotonic()
        with self._lock:
            if topic == _CLOCK:
                self._simulated_ns = stamp_from_message(message.clock)
                return
            if isinstance(message, PlaybackState):
                if message.status == PlaybackState.ENDED:
                    self.completion.end()
                return
            place = self._places[topic]
            if isinstance(message, NodeStatus):
                self._monitors |= {place} if message.kind == NodeStatus.MONITOR else set()
                self._healths.add_status(place, message, now_s)
                self.completion.add_report(place, message.telemetry)
                return
            if isinstance(message, Health):
                self._healths.add_health(place, message, now_s, self._clock_ns())
            else:
                self._healths.add_estimate(place, message, now_s)
        self.changed.set()

    def has_monitor(self) -> bool:
        """Return whether a monitor has published its status."""
        with self._lock:
            return bool(self._monitors)

    def rows(self) -> list[Row]:
        """Return a row per actuator, worst first."""
        with self._lock:
            is_real = self._simulated_ns is None
            return self._healths.rows(time.monotonic(), self._clock_ns(), is_real=is_real)

    def _clock_ns(self) -> int:
        return time.time_ns() if self._simulated_ns is None else self._simulated_ns


def _normalised(namespace: str) -> str:
    """Return a namespace as used in the ROS graph."""
    full = "/" + namespace.strip("/")
    try:
        validate_namespace(full)
    except InvalidNamespaceException as error:
        raise click.UsageError(
            f"--namespace {namespace!r}: expected a name of letters, digits and _, such as /ema"
        ) from error
    return full


def _domain() -> str:
    return f"domain {os.environ.get('ROS_DOMAIN_ID') or 0}"


def _no_health(places: list[str], listener: _HealthListener) -> str:
    """Return a message that no health is published, listing the nodes found instead."""
    words = f"no health is published on {', '.join(places)} in {_domain()}"
    elsewhere = [
        topic.removesuffix(f"/{HEALTH}") or "/"
        for topic in listener.topics_of(Health)
        if topic.endswith(f"/{HEALTH}")
    ]
    rest = [place for place in elsewhere if place not in places]
    if rest:
        return f"{words}, but on {', '.join(rest)}: choose it with --namespace"
    if listener.has_monitor():
        return f"{words}: its monitor waits for a first valid test"
    return (
        f"{words}: is a monitor running there? ROS_DOMAIN_ID and --namespace choose another, "
        "--network listens to other machines"
    )


class Completion:
    """Detects that a player has ended and monitors have identified all played data.

    One or several monitors report once a second and on change. An actuator is complete when, after
    the end, two successive reports have the same counts and every window has an estimate.

    Attributes
    ----------
    is_complete
        Whether all played data are identified.
    """

    def __init__(self) -> None:
        self.is_complete = False
        self._has_ended = False
        self._last: dict[tuple[str, str], TelemetryStatus] = {}
        # Reported actuators, and the actuators among them without pending data.
        self._reported: set[tuple[str, str]] = set()
        self._settled: set[tuple[str, str]] = set()

    def end(self) -> None:
        """Record the end of the player."""
        if not self._has_ended:
            self._has_ended = True
            self._last.clear()

    def add_report(self, place: str, telemetry: Iterable[TelemetryStatus]) -> None:
        """Add a monitor's counts for the actuators of a namespace."""
        actuators = {(place, item.actuator_id): item for item in telemetry}
        self._reported |= actuators.keys()
        if not self._has_ended or not actuators:
            return
        for key, counts in actuators.items():
            is_still, self._last[key] = _counts(counts) == _counts(self._last.get(key)), counts
            answered = counts.estimates_valid + counts.estimates_invalid
            if is_still and counts.windows == answered:
                self._settled.add(key)
            else:
                self._settled.discard(key)
        self.is_complete |= self._settled >= self._reported


def _counts(status: TelemetryStatus | None) -> tuple[int, ...]:
    """Return the counts that stay constant once no data are pending; empty without a status."""
    if status is None:
        return ()
    return status.blocks, status.windows, status.estimates_valid, status.estimates_invalid
