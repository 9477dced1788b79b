"""``ema watch``: the health of a fleet in the terminal."""

import os
import re
import threading
import time
from collections.abc import Mapping
from typing import Any, Final

import click
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.exceptions import InvalidNamespaceException
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.validate_namespace import validate_namespace
from rosgraph_msgs.msg import Clock

from ema_cli.fleet import FleetTable, HeardFleet, Row
from ema_cli.options import network_option
from ema_cli.processes.listener import Listener
from ema_cli.processes.reach import set_reach
from ema_cli.processes.stop_request import ENDING, deferred_signals
from ema_interfaces.msg import FaultEstimate, Health, PlaybackState
from ema_ros.stamps import stamp_from_message
from ema_ros.topics import (
    FAULT_ESTIMATE,
    HEALTH,
    LATCHED_BY_MANY,
    NAMESPACE,
    PLAYBACK_STATE,
    STREAM,
)

_DIAGNOSTICS: Final = "/diagnostics"
_CLOCK: Final = "/clock"
_BEST_EFFORT: Final = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_MONITOR: Final = re.compile(r"monitor(_\d+)?")
_COUNTS: Final = ("blocks", "windows", "estimates valid", "estimates invalid")
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
    help="End when a player there has ended and the monitor has identified what it played.",
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
        FleetTable(f"on {', '.join(places)} in {_domain()}") as table,
        _Hearing(places) as hearing,
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
            table.show(rows, "" if rows or waits else _nothing_heard(places, hearing))
            hearing.changed.wait(_REFRESH_S)
            hearing.changed.clear()
        table.show(hearing.rows(), "")


class _Hearing(Listener):
    """What is heard on some namespaces; to be used under ``with``.

    Attributes
    ----------
    changed
        Set when there is something new.
    completion
        Whether what was played is diagnosed.
    """

    def __init__(self, places: list[str]) -> None:
        topics: dict[str, tuple[type, QoSProfile]] = {
            _DIAGNOSTICS: (DiagnosticArray, STREAM),
            _CLOCK: (Clock, _BEST_EFFORT),
        }
        self._places: dict[str, str] = {}
        self.completion = Completion()
        for place in places:
            topics[f"{place.rstrip('/')}/{PLAYBACK_STATE}"] = PlaybackState, LATCHED_BY_MANY
            for name, kind, qos in (
                (HEALTH, Health, LATCHED_BY_MANY),
                (FAULT_ESTIMATE, FaultEstimate, STREAM),
            ):
                topic = f"{place.rstrip('/')}/{name}"
                topics[topic] = kind, qos
                self._places[topic] = place
        self.changed = threading.Event()
        self._lock = threading.Lock()
        self._fleet = HeardFleet()
        self._simulated_ns: int | None = None
        super().__init__("watch", topics, self._note)

    def _note(self, topic: str, message: Any) -> None:
        """Note a message."""
        now_s = time.monotonic()
        with self._lock:
            if topic == _CLOCK:
                self._simulated_ns = stamp_from_message(message.clock)
                return
            if topic == _DIAGNOSTICS:
                for status in message.status:
                    self._fleet.add_status(status.name, now_s)
                self._note_counts(message)
                return
            if isinstance(message, PlaybackState):
                if message.status == PlaybackState.ENDED:
                    self.completion.end()
                return
            place = self._places[topic]
            if isinstance(message, Health):
                self._fleet.add_health(place, message, now_s, self._clock_ns())
            else:
                self._fleet.add_estimate(place, message, now_s)
        self.changed.set()

    def _note_counts(self, message: DiagnosticArray) -> None:
        """Note how many windows the monitor whose report this is has identified."""
        places = set(self._places.values())
        telemetry = {}
        for status in message.status:
            # Where monitors share the actuators they are ``monitor_0`` and on.
            place, _, name = status.name.partition(": ")[0].rpartition("/")
            is_there = _MONITOR.fullmatch(name) and (place or "/") in places
            if is_there and status.name.endswith(" telemetry"):
                telemetry[status.name] = {pair.key: pair.value for pair in status.values}
        if telemetry:
            self.completion.add_report(telemetry)

    def rows(self) -> list[Row]:
        """Return the actuators, the worst first."""
        with self._lock:
            is_real = self._simulated_ns is None
            return self._fleet.rows(time.monotonic(), self._clock_ns(), is_real=is_real)

    def _clock_ns(self) -> int:
        return time.time_ns() if self._simulated_ns is None else self._simulated_ns


def _normalised(namespace: str) -> str:
    """Return a namespace as the graph has it."""
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


def _nothing_heard(places: list[str], listener: Listener) -> str:
    """Return that there is no health, and what there is instead."""
    words = f"no health is published on {', '.join(places)} in {_domain()}"
    elsewhere = [
        topic.removesuffix(f"/{HEALTH}") or "/"
        for topic in listener.topics_of(Health)
        if topic.endswith(f"/{HEALTH}")
    ]
    others = [place for place in elsewhere if place not in places]
    if others:
        return f"{words}, but on {', '.join(others)}: choose it with --namespace"
    if any(_MONITOR.fullmatch(name) for place in places for name in listener.nodes_in(place)):
        return f"{words}: its monitor waits for a first valid test"
    return (
        f"{words}: is a monitor running there? ROS_DOMAIN_ID and --namespace choose another, "
        "--network listens to other machines"
    )


class Completion:
    """Whether a player has ended, and the monitor has identified what it played.

    Reports come once a second and on change, of one monitor or of several that share the actuators:
    two of the same counts in a row after the end, with an estimate for each window, say of each
    actuator that nothing is on its way.

    Attributes
    ----------
    is_complete
        Whether that is so.
    """

    def __init__(self) -> None:
        self.is_complete = False
        self._has_ended = False
        self._last: dict[str, tuple[str, ...]] = {}
        # Actuators that were reported, and those of them of which nothing is on its way.
        self._known: set[str] = set()
        self._settled: set[str] = set()

    def end(self) -> None:
        """Record that the player has ended."""
        if not self._has_ended:
            self._has_ended = True
            self._last.clear()

    def add_report(self, telemetry: Mapping[str, Mapping[str, str]]) -> None:
        """Add a report of a monitor."""
        self._known.update(telemetry)
        if not self._has_ended or not telemetry:
            return
        for name, values in telemetry.items():
            counts = tuple(values.get(key, "") for key in _COUNTS)
            is_still, self._last[name] = counts == self._last.get(name), counts
            _, windows, valid, invalid = counts
            if is_still and int(windows) == int(valid) + int(invalid):
                self._settled.add(name)
            else:
                self._settled.discard(name)
        self.is_complete |= self._settled >= self._known
