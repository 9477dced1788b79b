# SPDX-License-Identifier: Apache-2.0
"""A server of synthetic messages in the protocol of the dashboard node, for tests of the page.

It reads orders as lines of JSON from standard input, and answers each with a line of JSON:

    {"do": "start", "port": 0}            {"port": 40123}
    {"do": "set", "actuator": "rudder", "level": 2, "share": 1.2, "costs": false}
    {"do": "test", "actuator": "rudder"}  a further test; "refused": "reason" makes it invalid, with
                                          "verdict": 5 departed
    {"do": "move", "actuator": "rudder", "stretches": 7}   an estimate of ordinary motion
    {"do": "run", "period": 5.0, "telemetry": 1.0, "open": "rudder"}
    {"do": "messages", "actuator": "rudder"}
    {"do": "playback", "status": 0, "rate": 1.0, "position": 12.5, "jumped": false}
    {"do": "requests"}                    requests of playback controls and changes of baselines
    {"do": "halt"}, {"do": "stop"}
"""

import argparse
import json
import math
import struct
import sys
import threading
import time
from array import array
from typing import Any
from unittest.mock import AsyncMock

import numpy as np
import synthetic_fleet as made
import synthetic_joints as joints
from rclpy.serialization import serialize_message

from ema_dashboard.access import Access
from ema_dashboard.hub import Hub
from ema_dashboard.known_topics import known_topics
from ema_dashboard.monitor_requests import read_baseline_change
from ema_dashboard.settings import bound_socket
from ema_dashboard.web_server import WebServer
from ema_interfaces.msg import FaultEstimate, PlaybackState
from ema_ros.stamps import stamp_to_message

REFUSED = FaultEstimate.REFUSED

TEST_S = 0.7
BAG_S = 600.0

_TOPICS = (
    *("actuator_description", "health", "fault_estimate", "health_forecast", "advice"),
    *("unit_history", "window_fit", "telemetry", "playback_state", "/diagnostics"),
    *("baseline", "friction_curve"),
)
_STREAMS = {"telemetry", "/diagnostics"}


class Server:
    """The server, its fleet, and the latest message of each actuator on each latched topic."""

    def __init__(self, count: int, joint_count: int, period_s: float, channels: list[str]) -> None:
        units: list[made.Unit] = [*made.fleet(count), *joints.robots(joint_count)]
        self.units = {unit.actuator_id: unit for unit in units}
        self.period_s = period_s
        self.tested_ns: dict[str, int] = {}
        self.latest: dict[tuple[str, str], Any] = {}
        self.requests: list[dict[str, Any]] = []
        self.names = channels
        self.lock = threading.RLock()
        self.hub: Hub | None = None
        self.server: WebServer | None = None
        self.running: threading.Event | None = None
        now = time.time_ns()
        for number, unit in enumerate(self.units.values()):
            self.describe(unit, now - int(period_s * made.NS * number / len(units)))

    def describe(self, unit: made.Unit, now_ns: int) -> None:
        if isinstance(unit, joints.Joint):
            description = joints.description(unit, now_ns)
        else:
            description = made.description(unit, now_ns)
        self.keep("actuator_description", unit, description)
        self.tested_ns[unit.actuator_id] = now_ns
        self.judge(unit, now_ns)

    def judge(
        self, unit: made.Unit, now_ns: int, refused: str = "", verdict: int = REFUSED
    ) -> None:
        """Publish estimate, health, forecast and advice for a window of a unit."""
        if isinstance(unit, joints.Joint):
            self.compare(unit, now_ns)
            return
        self.keep("fault_estimate", unit, made.estimate(unit, now_ns, refused, verdict))
        if not refused:
            self.keep("health", unit, made.health(unit, now_ns))
            self.keep("health_forecast", unit, made.forecast(unit, now_ns))
            self.keep("advice", unit, made.advice(unit, now_ns))
        self.keep("window_fit", unit, made.window_fit(unit, now_ns))

    def compare(self, joint: joints.Joint, now_ns: int) -> None:
        """Publish baseline, estimate, health and friction curve for a record of a joint."""
        self.keep("baseline", joint, joints.baseline(joint, now_ns))
        self.keep("fault_estimate", joint, joints.estimate(joint, now_ns))
        self.keep("health", joint, joints.health(joint, now_ns))
        if not joint.is_learning:
            self.keep("friction_curve", joint, joints.curve(joint, now_ns))

    async def change_baseline(self, content: Any) -> None:
        _, request = read_baseline_change(content)
        joint = self.units[request.actuator_id]
        assert isinstance(joint, joints.Joint)
        self.requests.append(plain(request))
        joints.change_baseline(joint, request)
        self.compare(joint, time.time_ns())

    def keep(self, topic: str, unit: made.Unit, message: Any) -> None:
        with self.lock:
            self.latest[topic, unit.actuator_id] = message
            self.send(topic, message, kept_as=unit.actuator_id)

    def send(self, topic: str, message: Any, kept_as: str | None = None) -> None:
        data = message if isinstance(message, bytes) else serialize_message(message)
        with self.lock:
            if self.hub is not None and full_name(topic) in self.hub:
                if kept_as is not None:
                    self.hub.keep(full_name(topic), kept_as, data, time.time_ns())
                self.hub.publish(full_name(topic), data, time.time_ns())

    def start(self, port: int) -> int:
        hub = Hub()
        channels = {topic.name: topic for topic in known_topics([made.NAMESPACE])}
        for name in self.names:
            hub.add(channels[full_name(name)])
        hub.offer_playback((0, int(BAG_S * made.NS)))
        for unit in self.units.values():
            topic = full_name("unit_history")
            hub.keep(topic, unit.actuator_id, lambda unit=unit: self.history(unit), 0)
        for (name, actuator_id), message in self.latest.items():
            if full_name(name) in hub and name not in _STREAMS:
                hub.keep(full_name(name), actuator_id, serialize_message(message), 0)
        listener = bound_socket("127.0.0.1", port, 1)
        access = Access([], [], "")
        posts = {"/note": AsyncMock(), "/baseline": self.change_baseline}
        self.server = WebServer(listener, None, access, hub, self.ask, posts, 16, 2**27, {}, print)
        self.server.start()
        self.hub = hub
        return listener.getsockname()[1]

    def stop(self) -> None:
        if self.running:
            self.running.set()
            self.running = None
        with self.lock:
            self.hub = None
        if self.server:
            self.server.stop()
            self.server = None

    def history(self, unit: made.Unit) -> bytes:
        tested_ns = self.tested_ns[unit.actuator_id]
        return serialize_message(self.tests_of(unit, tested_ns))

    def tests_of(self, unit: made.Unit, now_ns: int, first: int = 1) -> Any:
        if isinstance(unit, joints.Joint):
            return joints.history(unit, now_ns, self.period_s, first)
        return made.history(unit, now_ns, self.period_s, first)

    def ask(self, data: bytes) -> None:
        """Record a request to the playback."""
        _, command, speed, seeks, seek_ns, _ = struct.unpack_from("<BBfBQI", data)
        asked = {"command": ("play", "pause")[command], "speed": speed}
        self.requests.append(asked | {"seek": seek_ns if seeks else None})

    def run(self, period_s: float, telemetry: float, opened: str) -> None:
        """Test all units in turn in each period; ``opened`` streams all the time.

        Parameters
        ----------
        telemetry
            Share of the units that stream during their tests.
        """
        self.running = threading.Event()
        for target in (self._tests, self._telemetry):
            args = (self.running, period_s, telemetry, opened)
            threading.Thread(target=target, args=args, daemon=True).start()

    def _tests(self, ended: threading.Event, period_s: float, _: float, __: str) -> None:
        units = list(self.units.values())
        start, number, reported = time.monotonic(), 0, 0.0
        while not ended.wait(0.02):
            now = time.monotonic() - start
            while number < now / period_s * len(units):
                self.test(units[number % len(units)])
                number += 1
            if now >= reported:
                self.send("/diagnostics", made.diagnostics(units, time.time_ns()))
                reported = now + 1.0

    def _telemetry(
        self, ended: threading.Event, period_s: float, share: float, opened: str
    ) -> None:
        if not share and not opened:
            return
        units = list(self.units.values())
        streaming = set(range(int(share * len(units))))
        start, number = time.monotonic(), 0
        first_ns = time.time_ns()
        # Serialised once: for a fleet, creating these messages would take all time.
        kept = {}
        while not ended.wait(0.002):
            while number < (time.monotonic() - start) * 100.0:
                stamp_ns = first_ns + number * made.NS // 100
                for i, unit in enumerate(units):
                    phase = (number / 100.0 - i * period_s / len(units)) % period_s
                    if unit.actuator_id == opened:
                        self.send("telemetry", made.block(unit, number, stamp_ns))
                    elif i in streaming and phase < TEST_S:
                        if i not in kept:
                            kept[i] = serialize_message(made.block(unit, 0, stamp_ns))
                        self.send("telemetry", kept[i])
                number += 1

    def move(self, unit: made.Unit, stretches: int) -> None:
        """Publish an estimate from stretches of ordinary motion, which has no fit."""
        unit.window += 1
        estimate = made.estimate(unit, time.time_ns())
        estimate.stretches = stretches
        self.keep("fault_estimate", unit, estimate)

    def test(self, unit: made.Unit, refused: str = "", verdict: int = REFUSED) -> None:
        unit.window += 1
        now_ns = time.time_ns()
        if not refused:
            unit.tests += 1
            self.tested_ns[unit.actuator_id] = now_ns
        self.judge(unit, now_ns, refused, verdict)
        if refused:
            kind = "calibration" if verdict == REFUSED else "fault"
            addition = made.addition(unit, now_ns, kind, refused)
        else:
            addition = self.tests_of(unit, now_ns, first=unit.tests)
            addition.is_addition, addition.events = True, []
        self.send("unit_history", addition)

    def obey(self, order: dict[str, Any]) -> dict[str, Any]:
        """Carry out an order and return the answer."""
        unit = self.units.get(order.get("actuator", ""))
        match order["do"]:
            case "start":
                return {"port": self.start(order.get("port", 0))}
            case "stop":
                self.stop()
            case "set" if unit:
                unit.share = order.get("share", unit.share)
                unit.level = order.get("level", unit.level)
                unit.costs = order.get("costs", unit.costs)
                if isinstance(unit, joints.Joint):
                    unit.records = order.get("records", unit.records)
                    self.compare(unit, time.time_ns())
                    return {}
                self.keep("health", unit, made.health(unit, time.time_ns()))
                self.keep("advice", unit, made.advice(unit, time.time_ns()))
            case "test" if unit:
                self.test(unit, order.get("refused", ""), order.get("verdict", REFUSED))
            case "move" if unit:
                self.move(unit, order["stretches"])
            case "run":
                self.run(order["period"], order.get("telemetry", 0.0), order.get("open", ""))
            case "halt" if self.running:
                self.running.set()
            case "messages" if unit:
                return {
                    topic: plain(message)
                    for (topic, name), message in self.latest.items()
                    if name == unit.actuator_id
                }
            case "playback":
                self.play(order)
            case "requests":
                return {"requests": self.requests}
            case other:
                raise ValueError(f"order {other!r} is unknown, or its actuator is")
        return {}

    def play(self, order: dict[str, Any]) -> None:
        message = PlaybackState(
            bag="bags/wear_of_a_flap", status=order["status"], rate=float(order["rate"]),
            start=stamp_to_message(1_700_000_000 * made.NS),
            end=stamp_to_message(int((1_700_000_000 + BAG_S) * made.NS)),
            position=stamp_to_message(int((1_700_000_000 + order["position"]) * made.NS)),
            jumped=order.get("jumped", False),
        )  # fmt: skip
        message.header.stamp = message.position
        with self.lock:
            self.latest["playback_state", ""] = message
            self.send("playback_state", message, kept_as="")


def full_name(topic: str) -> str:
    return topic if topic.startswith("/") else f"{made.NAMESPACE}/{topic}"


def plain(message: Any) -> Any:
    """Return a message as plain values; numbers that are not finite become None."""
    if hasattr(message, "get_fields_and_field_types"):
        return {
            name: plain(getattr(message, name)) for name in message.get_fields_and_field_types()
        }
    if isinstance(message, np.ndarray | np.generic | array):
        message = message.tolist()
    if isinstance(message, list | tuple):
        return [plain(item) for item in message]
    if isinstance(message, float):
        return message if math.isfinite(message) else None
    return message.hex() if isinstance(message, bytes) else message


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--actuators", type=int, default=9)
    parser.add_argument("--joints", type=int, default=0)
    parser.add_argument("--period", type=float, default=60.0, help="between tests of a unit [s]")
    parser.add_argument("--without", nargs="*", default=["playback_state"], help="topics")
    options = parser.parse_args()
    names = [name for name in _TOPICS if name not in options.without]
    server = Server(options.actuators, options.joints, options.period, names)
    for line in sys.stdin:
        print(json.dumps(server.obey(json.loads(line))), flush=True)
    server.stop()


if __name__ == "__main__":
    main()
