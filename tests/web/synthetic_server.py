# SPDX-License-Identifier: Apache-2.0
"""A server of synthetic messages in the protocol of the dashboard node, for tests of the page.

It reads commands from standard input, one line of JSON each, and answers each with a line of JSON:

    {"do": "start", "port": 0}            {"port": 40123}
    {"do": "set", "actuator": "rudder", "level": 2, "share": 1.2, "costs": false}
    {"do": "test", "actuator": "rudder"}  one more test; "refused": "reason" makes it invalid, and
                                          "verdict": 5 departed
    {"do": "move", "actuator": "rudder", "stretches": 7}   an estimate of ordinary motion
    {"do": "run", "period": 5.0, "telemetry": 1.0, "open": "rudder"}
    {"do": "messages", "actuator": "rudder"}
    {"do": "playback", "status": 0, "rate": 1.0, "position": 12.5, "jumped": false}
    {"do": "requests"}                    received requests to the player and changes of baselines
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
import synthetic_joints as joints
import synthetic_units as synthetic
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
    """A server with several actuators, and the latest message of each actuator and topic."""

    def __init__(self, count: int, joint_count: int, period_s: float, channels: list[str]) -> None:
        units: list[synthetic.Unit] = [*synthetic.units(count), *joints.robots(joint_count)]
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
            self.add(unit, now - int(period_s * synthetic.NS * number / len(units)))

    def add(self, unit: synthetic.Unit, now_ns: int) -> None:
        if isinstance(unit, joints.Joint):
            description = joints.description(unit, now_ns)
        else:
            description = synthetic.description(unit, now_ns)
        self.publish_latched("actuator_description", unit, description)
        self.tested_ns[unit.actuator_id] = now_ns
        self.publish_window(unit, now_ns)

    def publish_window(
        self, unit: synthetic.Unit, now_ns: int, refused: str = "", verdict: int = REFUSED
    ) -> None:
        """Publish estimate, health, forecast, advice and fit of a window of a unit."""
        if isinstance(unit, joints.Joint):
            self.publish_record(unit, now_ns)
            return
        self.publish_latched(
            "fault_estimate", unit, synthetic.estimate(unit, now_ns, refused, verdict)
        )
        if not refused:
            self.publish_latched("health", unit, synthetic.health(unit, now_ns))
            self.publish_latched("health_forecast", unit, synthetic.forecast(unit, now_ns))
            self.publish_latched("advice", unit, synthetic.advice(unit, now_ns))
        self.publish_latched("window_fit", unit, synthetic.window_fit(unit, now_ns))

    def publish_record(self, joint: joints.Joint, now_ns: int) -> None:
        """Publish baseline, estimate, health and friction curve of a record of a joint."""
        self.publish_latched("baseline", joint, joints.baseline(joint, now_ns))
        self.publish_latched("fault_estimate", joint, joints.estimate(joint, now_ns))
        self.publish_latched("health", joint, joints.health(joint, now_ns))
        if not joint.is_learning:
            self.publish_latched("friction_curve", joint, joints.curve(joint, now_ns))

    async def change_baseline(self, content: Any) -> None:
        _, request = read_baseline_change(content)
        joint = self.units[request.actuator_id]
        assert isinstance(joint, joints.Joint)
        self.requests.append(plain(request))
        joints.change_baseline(joint, request)
        self.publish_record(joint, time.time_ns())

    def publish_latched(self, topic: str, unit: synthetic.Unit, message: Any) -> None:
        with self.lock:
            self.latest[topic, unit.actuator_id] = message
            self.publish(topic, message, latched_by=unit.actuator_id)

    def publish(self, topic: str, message: Any, latched_by: str | None = None) -> None:
        data = message if isinstance(message, bytes) else serialize_message(message)
        with self.lock:
            if self.hub is not None and full_name(topic) in self.hub:
                if latched_by is not None:
                    self.hub.keep(full_name(topic), latched_by, data, time.time_ns())
                self.hub.publish(full_name(topic), data, time.time_ns())

    def start(self, port: int) -> int:
        hub = Hub()
        channels = {topic.name: topic for topic in known_topics([synthetic.NAMESPACE])}
        for name in self.names:
            hub.add(channels[full_name(name)])
        hub.offer_playback((0, int(BAG_S * synthetic.NS)))
        for unit in self.units.values():
            topic = full_name("unit_history")
            hub.keep(topic, unit.actuator_id, lambda unit=unit: self.history(unit), 0)
        for (name, actuator_id), message in self.latest.items():
            if full_name(name) in hub and name not in _STREAMS:
                hub.keep(full_name(name), actuator_id, serialize_message(message), 0)
        listener = bound_socket("127.0.0.1", port, 1)
        access = Access([], [], "")
        posts = {"/note": AsyncMock(), "/baseline": self.change_baseline}
        self.server = WebServer(
            listener, None, access, hub, self.record_request, posts, 16, 2**27, {}, print
        )
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

    def history(self, unit: synthetic.Unit) -> bytes:
        tested_ns = self.tested_ns[unit.actuator_id]
        return serialize_message(self.tests_of(unit, tested_ns))

    def tests_of(self, unit: synthetic.Unit, now_ns: int, first: int = 1) -> Any:
        if isinstance(unit, joints.Joint):
            return joints.history(unit, now_ns, self.period_s, first)
        return synthetic.history(unit, now_ns, self.period_s, first)

    def record_request(self, data: bytes) -> None:
        """Record a request to the player."""
        _, command, speed, seeks, seek_ns, _ = struct.unpack_from("<BBfBQI", data)
        request = {"command": ("play", "pause")[command], "speed": speed}
        self.requests.append(request | {"seek": seek_ns if seeks else None})

    def run(self, period_s: float, telemetry: float, opened: str) -> None:
        """Test each unit once per period, and publish telemetry.

        Parameters
        ----------
        period_s
            Time between two tests of a unit [s].
        telemetry
            Share of the units that publish telemetry during their tests.
        opened
            Name of the unit that publishes telemetry all the time; "": none.
        """
        self.running = threading.Event()
        for target in (self._tests, self._telemetry):
            args = (self.running, period_s, telemetry, opened)
            threading.Thread(target=target, args=args, daemon=True).start()

    def _tests(self, stopped: threading.Event, period_s: float, _: float, __: str) -> None:
        units = list(self.units.values())
        start, number, reported = time.monotonic(), 0, 0.0
        while not stopped.wait(0.02):
            now = time.monotonic() - start
            while number < now / period_s * len(units):
                self.test(units[number % len(units)])
                number += 1
            if now >= reported:
                self.publish("/diagnostics", synthetic.diagnostics(units, time.time_ns()))
                reported = now + 1.0

    def _telemetry(
        self, stopped: threading.Event, period_s: float, share: float, opened: str
    ) -> None:
        if not share and not opened:
            return
        units = list(self.units.values())
        streaming = set(range(int(share * len(units))))
        start, number = time.monotonic(), 0
        first_ns = time.time_ns()
        # Serialised once, because creating these messages for hundreds of actuators takes too long.
        cache = {}
        while not stopped.wait(0.002):
            while number < (time.monotonic() - start) * 100.0:
                stamp_ns = first_ns + number * synthetic.NS // 100
                for i, unit in enumerate(units):
                    phase = (number / 100.0 - i * period_s / len(units)) % period_s
                    if unit.actuator_id == opened:
                        self.publish("telemetry", synthetic.block(unit, number, stamp_ns))
                    elif i in streaming and phase < TEST_S:
                        if i not in cache:
                            cache[i] = serialize_message(synthetic.block(unit, 0, stamp_ns))
                        self.publish("telemetry", cache[i])
                number += 1

    def move(self, unit: synthetic.Unit, stretches: int) -> None:
        """Publish an estimate from stretches of ordinary motion, without a fit."""
        unit.window += 1
        estimate = synthetic.estimate(unit, time.time_ns())
        estimate.stretches = stretches
        self.publish_latched("fault_estimate", unit, estimate)

    def test(self, unit: synthetic.Unit, refused: str = "", verdict: int = REFUSED) -> None:
        unit.window += 1
        now_ns = time.time_ns()
        if not refused:
            unit.tests += 1
            self.tested_ns[unit.actuator_id] = now_ns
        self.publish_window(unit, now_ns, refused, verdict)
        if refused:
            kind = "calibration" if verdict == REFUSED else "fault"
            addition = synthetic.addition(unit, now_ns, kind, refused)
        else:
            addition = self.tests_of(unit, now_ns, first=unit.tests)
            addition.is_addition, addition.events = True, []
        self.publish("unit_history", addition)

    def execute(self, command: dict[str, Any]) -> dict[str, Any]:
        """Execute a command; return the answer."""
        unit = self.units.get(command.get("actuator", ""))
        match command["do"]:
            case "start":
                return {"port": self.start(command.get("port", 0))}
            case "stop":
                self.stop()
            case "set" if unit:
                unit.share = command.get("share", unit.share)
                unit.level = command.get("level", unit.level)
                unit.costs = command.get("costs", unit.costs)
                if isinstance(unit, joints.Joint):
                    unit.records = command.get("records", unit.records)
                    self.publish_record(unit, time.time_ns())
                    return {}
                self.publish_latched("health", unit, synthetic.health(unit, time.time_ns()))
                self.publish_latched("advice", unit, synthetic.advice(unit, time.time_ns()))
            case "test" if unit:
                self.test(unit, command.get("refused", ""), command.get("verdict", REFUSED))
            case "move" if unit:
                self.move(unit, command["stretches"])
            case "run":
                self.run(command["period"], command.get("telemetry", 0.0), command.get("open", ""))
            case "halt" if self.running:
                self.running.set()
            case "messages" if unit:
                return {
                    topic: plain(message)
                    for (topic, name), message in self.latest.items()
                    if name == unit.actuator_id
                }
            case "playback":
                self.publish_playback(command)
            case "requests":
                return {"requests": self.requests}
            case _:
                raise ValueError(f"unknown command or actuator: {command}")
        return {}

    def publish_playback(self, state: dict[str, Any]) -> None:
        message = PlaybackState(
            bag="bags/wear_of_a_flap", status=state["status"], rate=float(state["rate"]),
            start=stamp_to_message(1_700_000_000 * synthetic.NS),
            end=stamp_to_message(int((1_700_000_000 + BAG_S) * synthetic.NS)),
            position=stamp_to_message(int((1_700_000_000 + state["position"]) * synthetic.NS)),
            jumped=state.get("jumped", False),
        )  # fmt: skip
        message.header.stamp = message.position
        with self.lock:
            self.latest["playback_state", ""] = message
            self.publish("playback_state", message, latched_by="")


def full_name(topic: str) -> str:
    return topic if topic.startswith("/") else f"{synthetic.NAMESPACE}/{topic}"


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
        print(json.dumps(server.execute(json.loads(line))), flush=True)
    server.stop()


if __name__ == "__main__":
    main()
