"""The player: messages of a bag to the running system."""

import threading
import traceback
from dataclasses import dataclass, replace
from typing import Any, Final

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock as SteadyClock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from ema_core.quantity import check_quantities, flag, quantity, text
from ema_core.wording import counted
from ema_interfaces.msg import (
    PlaybackState,
    TelemetryBlock,
)
from ema_interfaces.srv import SeekPlayback, SetPlaybackRate
from ema_recording.latched import LatchedIndex
from ema_recording.message_type import message_class, type_name
from ema_recording.playable import CLOCK, playable_topics
from ema_recording.playback import Playback
from ema_recording.qos import recorded_qos, replay_qos
from ema_recording.reader import Bag, Recorded, Topic
from ema_recording.schema import to_installed
from ema_recording.steering import Steering
from ema_ros.managed_node import ManagedNode
from ema_ros.run import run
from ema_ros.settings import declare, read
from ema_ros.stamps import stamp_from_message, stamp_to_message
from ema_ros.status import ERROR, OK, WARN, Task

_TELEMETRY: Final = type_name(TelemetryBlock)
_SHARED_TOPICS: Final = frozenset(("/diagnostics", "/rosout", "/parameter_events", "/tf"))
_POLL_S: Final = 0.05
_STATE_S: Final = 0.5
_LATCHED_S: Final = 0.2
_SETTLE_S: Final = 1.0  # a subscription learns of its match after the publisher
_ACKNOWLEDGE_S: Final = 5.0


@dataclass(frozen=True)
class PlayerSettings:
    """What to play, and how fast."""

    bag: str = text("", "bag to play: a file or a folder")
    rate: float = quantity(1.0, "-", 0.01, 100.0, "playback rate")
    actuator_only: bool = flag(
        False, "play the topics of the actuator only, for a monitor to diagnose"
    )
    wait_s: float = quantity(
        5.0, "s", 0.0, 3600.0, "timeout for a subscriber of each telemetry topic"
    )
    clock_rate_hz: float = quantity(100.0, "Hz", 1.0, 1000.0, "rate of /clock")
    stay: bool = flag(False, "stay at the end of the bag, for a seek, instead of ending")

    def __post_init__(self) -> None:
        check_quantities(self)


class PlayerNode(ManagedNode):
    """Plays a bag, message by message in its order, and the time on ``/clock``.

    Parameters of the node are the fields of ``PlayerSettings``.

    While it is inactive the recorded time stands still. It has done its work at the end of the
    bag, when all reliable subscriptions have acknowledged every message, unless it is to stay.

    While it is active it can be paused, resumed, moved and played at another rate by services; a
    seek publishes what is latched at the new time first. ``playback_state`` tells how it stands.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("player", **kwargs)
        declare(self, PlayerSettings)
        self._stop = threading.Event()
        self._worker: threading.Thread | None = None
        self._steered = threading.RLock()  # over start and stop of the worker
        self._state_timer = self.create_timer(
            _STATE_S,
            self._publish_progress,
            callback_group=MutuallyExclusiveCallbackGroup(),
            clock=SteadyClock(clock_type=ClockType.STEADY_TIME),
            autostart=False,
        )

    def configure(self) -> None:
        """Open the bag and create the publishers of what is in it."""
        self._settings = read(self, PlayerSettings)
        if not self._settings.bag:
            raise ValueError("parameter bag is empty: expected the path of a recording")
        self._bag = Bag(self._settings.bag)
        topics, self._not_played = playable_topics(
            self._bag, actuator_only=self._settings.actuator_only
        )
        for name, reason in self._not_played.items():
            self.get_logger().warning(f"{name} is not played: {reason}")
        self._upgrades = {name: to_installed(*topic.identity) for name, topic in topics.items()}
        self._total = sum(topic.count for topic in topics.values())
        self._outputs: dict[str, Publisher] = {}
        try:
            self._playback = Playback(
                self._bag.raw_messages(topics),
                self._settings.rate,
                1.0 / self._settings.clock_rate_hz,
                self._publish,
                self._publish_clock,
            )
        except ValueError as error:
            raise ValueError(f"{self._bag.path}: {error}; {self._bag.damage}") from error
        self._warn_of_damage("")
        latched = []
        for name, topic in topics.items():
            offer = self._offer(name, topic)
            self._outputs[name] = self.create_publisher(message_class(topic.type_name), name, offer)
            if offer.durability == DurabilityPolicy.TRANSIENT_LOCAL:
                latched.append(name)
        self._latched = LatchedIndex(self._bag, latched)
        clock_qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._clock_output = self.create_publisher(Clock, CLOCK, clock_qos)
        telemetry = [name for name, topic in topics.items() if topic.type_name == _TELEMETRY]
        self._awaited = telemetry
        self._is_awaited = True
        self._failure = ""
        self._phase = "ready"
        self._status = PlaybackState.PLAYING
        acts = {
            "pause": self._pause,
            "resume": self._resume,
            "set_rate": self._set_rate,
            "seek": self._seek,
        }
        self._steering = Steering(self, acts)

    def activate(self) -> None:
        """Play on, unless it is paused."""
        with self._steered:
            self._go_on()
        self._state_timer.reset()

    def deactivate(self) -> None:
        """Stop before the next message."""
        self._state_timer.cancel()
        self._halt()

    def clean_up(self) -> None:
        """Destroy the publishers and services."""
        self._steering.close()
        for publisher in (*self._outputs.values(), self._clock_output):
            self.destroy_publisher(publisher)

    def tasks(self) -> list[Task]:
        """Return how far the bag is played, and what is wrong."""
        playback, bag = self._playback, self._bag
        remarks = [f"{bag.path.name} is damaged: {bag.damage}"] if bag.damage else []
        remarks += [f"{name}: not played, {why}" for name, why in self._not_played.items()]
        for name in (*self._outputs, CLOCK):
            others = self._other_publishers(name)
            if others and name not in _SHARED_TOPICS:
                remarks.append(f"{name}: also published by {', '.join(others)}")
        values = {
            "bag": bag.path,
            "rate [-]": playback.rate,
            "played": playback.played,
            "messages": self._total,
            "position [s]": (playback.reached_ns - playback.start_ns) / 1e9,
            "topics": ", ".join(sorted(self._outputs)),
            "not played": ", ".join(self._not_played),
        }
        level = ERROR if self._failure else WARN if remarks else OK
        message = self._failure or "; ".join([self._phase, *remarks])
        return [Task("playback", level, message, self.hardware_id, values)]

    def _offer(self, name: str, topic: Topic) -> QoSProfile:
        try:
            return replay_qos(recorded_qos(topic.qos))
        except ValueError as error:
            self.get_logger().warning(f"{name} is played as a reliable stream: {error}")
            return replay_qos(())

    def _start(self) -> None:
        """Play in a thread of its own."""
        self._stop = threading.Event()
        self._worker = threading.Thread(target=self._work, args=(self._stop,), name="player")
        self._worker.start()

    def _go_on(self) -> None:
        """Play where it is to play, and tell."""
        if self._status == PlaybackState.PLAYING:
            self._start()
        self._publish_state()

    def _halt(self) -> None:
        """Stop before the next message."""
        with self._steered:
            self._stop.set()
            if self._worker is not None:
                self._worker.join()

    def _pause(self, _: Any) -> None:
        with self._steered:
            self._check_active()
            self._halt()
            if self._status == PlaybackState.PLAYING:
                self._status = PlaybackState.PAUSED
            self._publish_state()

    def _resume(self, _: Any) -> None:
        with self._steered:
            self._check_active()
            if self._status == PlaybackState.ENDED:
                raise ValueError(f"{self._bag.path} is at its end: seek first")
            if self._status == PlaybackState.PAUSED:
                self._status = PlaybackState.PLAYING
                self._go_on()

    def _set_rate(self, request: SetPlaybackRate.Request) -> None:
        settings = replace(self._settings, rate=request.rate)  # checks it
        with self._steered:
            self._check_active()
            self._halt()
            self._playback.rate = settings.rate
            self._go_on()

    def _seek(self, request: SeekPlayback.Request) -> None:
        time_ns, (start_ns, end_ns) = stamp_from_message(request.time), self._bounds()
        if not start_ns <= time_ns <= end_ns:
            raise ValueError(
                f"time = {time_ns / 1e9:.3f} s is outside {self._bag.path}, "
                f"[{start_ns / 1e9:.3f}, {end_ns / 1e9:.3f}] s"
            )
        with self._steered:
            self._check_active()
            self._halt()
            try:
                latched = self._latched.before(time_ns)
                self._playback.go_to(time_ns, self._bag.raw_messages(self._outputs, time_ns))
            except (OSError, ValueError):
                self._go_on()  # from where it was
                raise
            if self._status == PlaybackState.ENDED:
                self._status = PlaybackState.PAUSED
            self._publish_state(jumped=True)
            for item in latched:
                # The publisher keeps one message: that of one actuator at a time.
                self._outputs[item.topic].wait_for_all_acked(Duration(seconds=_LATCHED_S))
                self._publish(item)
            if self._status == PlaybackState.PLAYING:
                self._start()

    def _check_active(self) -> None:
        if self.state != "active":
            raise ValueError(f"the player is {self.state}: expected active")
        if self.finished.is_set():
            raise ValueError("the player has ended")

    def _bounds(self) -> tuple[int, int]:
        """Return log times of the first and last message [ns]."""
        start_ns = self._playback.start_ns
        return start_ns, max(start_ns, self._bag.end_ns or 0)

    def _publish_progress(self) -> None:
        if self._status == PlaybackState.PLAYING:
            self._publish_state()

    def _publish_state(self, *, jumped: bool = False) -> None:
        start_ns, end_ns = self._bounds()
        self._steering.publish(
            PlaybackState(
                bag=str(self._bag.path),
                status=self._status,
                rate=self._playback.rate,
                start=stamp_to_message(start_ns),
                end=stamp_to_message(end_ns),
                position=stamp_to_message(self._playback.reached_ns),
                jumped=jumped,
            )
        )

    def _publish(self, item: Recorded) -> None:
        upgrade = self._upgrades[item.topic]
        self._outputs[item.topic].publish(upgrade(item.message) if upgrade else item.message)

    def _publish_clock(self, stamp_ns: int) -> None:
        self._clock_output.publish(Clock(clock=Time(nanoseconds=stamp_ns).to_msg()))

    def _work(self, stop: threading.Event) -> None:
        damage = self._bag.damage
        try:
            if self._is_awaited:
                self._wait_for_subscribers(stop)
            if stop.is_set():
                return
            self._set_phase(f"playing at rate {self._playback.rate:g}")
            if self._playback.run(stop):
                self._finish(stop)
            else:
                self._set_phase(f"paused after {counted(self._playback.played, 'message')}")
        except Exception as error:
            self.get_logger().error(traceback.format_exc())
            self._failure = f"cannot play on: {error!r}"
            self.exit_code = 1
            self.report()
            self.finished.set()
        self._warn_of_damage(damage)

    def _wait_for_subscribers(self, stop: threading.Event) -> None:
        """Wait for subscriptions, at most as long as the settings say."""
        waits = round(self._settings.wait_s / _POLL_S)
        if self._missing() and waits:
            self._set_phase(f"waiting for a subscriber of {self._missing()}")
        while waits and self._missing() and not stop.wait(_POLL_S):
            waits -= 1
        if stop.is_set():
            return
        if missing := self._missing():
            self.get_logger().warning(
                f"no subscriber of {missing} after {self._settings.wait_s:g} s: starting"
            )
        else:
            stop.wait(_SETTLE_S)
        self._is_awaited = False

    def _missing(self) -> str:
        """Return the topics without a subscription that is waited for, in words."""
        subscribed = {
            name for name, publisher in self._outputs.items() if publisher.get_subscription_count()
        }
        if self._awaited:
            return ", ".join(name for name in self._awaited if name not in subscribed)
        return "" if subscribed else f"any of {', '.join(self._outputs)}"

    def _finish(self, stop: threading.Event) -> None:
        played = f"played {counted(self._playback.played, 'message')} of {self._bag.path}"
        waits = round(_ACKNOWLEDGE_S / _POLL_S)
        pending = list(self._outputs.items())
        while pending and waits and not stop.is_set():
            publisher = pending[-1][1]
            if publisher.wait_for_all_acked(Duration(seconds=_POLL_S)):
                pending.pop()
            else:
                waits -= 1
        if pending:
            names = ", ".join(name for name, _ in pending)
            self.get_logger().warning(f"not all messages on {names} are acknowledged")
        if stop.is_set():
            return
        self._status = PlaybackState.ENDED
        self._set_phase(played)
        self._publish_state()
        if not self._settings.stay:
            self.finished.set()

    def _warn_of_damage(self, known: str) -> None:
        if self._bag.damage != known:
            self.get_logger().warning(f"{self._bag.path.name} is damaged: {self._bag.damage}")

    def _set_phase(self, phase: str) -> None:
        self._phase = phase
        self.get_logger().info(phase)
        self.report()

    def _other_publishers(self, name: str) -> list[str]:
        """Return the other nodes that publish a topic."""
        sources = [item.node_name for item in self.get_publishers_info_by_topic(name)]
        if self.get_name() in sources:
            sources.remove(self.get_name())
        return sorted(set(sources))


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(PlayerNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
