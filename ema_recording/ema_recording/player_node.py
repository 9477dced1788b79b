"""The player: messages of a bag to the running system."""

import threading
import traceback
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock as SteadyClock
from rclpy.clock_type import ClockType

from ema_core.wording import counted
from ema_interfaces.msg import PlaybackState
from ema_interfaces.srv import BurstPlayback, SeekPlayback, SetPlaybackRate
from ema_recording.passes import Passes
from ema_recording.played_bag import PlayedBag
from ema_recording.player_outputs import PlayerOutputs
from ema_recording.player_settings import PlayerSettings
from ema_recording.steering import Steering
from ema_recording.topic_names import topic_names
from ema_ros.managed_node import ManagedNode
from ema_ros.run import run
from ema_ros.settings import declare, read
from ema_ros.stamps import stamp_from_message, stamp_to_message
from ema_ros.status import ERROR, OK, WARN, Task

_STATE_S: Final = 0.5


class PlayerNode(ManagedNode):
    """Plays a bag, message by message in its order, and the time on ``/clock``.

    Parameters of the node are the fields of ``PlayerSettings`` and ``topics``: full names, or names
    relative to the namespace.

    While it is inactive the recorded time stands still. It has done its work at the end of the
    bag, when all reliable subscriptions have acknowledged every message, unless it is to stay or to
    begin again. A new pass is a jump back in time, told on ``/clock`` and in the state like a seek.

    While it is active it can be paused, stepped, moved and played at another rate by services; a
    seek publishes what is latched at the new time first. ``playback_state`` tells how it stands.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("player", **kwargs)
        declare(self, PlayerSettings)
        self.declare_parameter(
            "topics",
            [""],
            ParameterDescriptor(
                description="topics to play; empty: all",
                read_only=True,
                dynamic_typing=True,
            ),
        )
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
        self._played = PlayedBag(self._settings, topic_names(self))
        for name, reason in self._played.remarks.items():
            self._warn(f"{name} is not played: {reason}")
        for name, reason in self._played.odd_offers.items():
            self._warn(f"{name} is played as a reliable stream: {reason}")
        self._warn_of_damage("")
        self._outputs = PlayerOutputs(self, self._played)
        self._passes = Passes(
            self._played,
            self._outputs,
            self._settings,
            self._set_phase,
            self._warn,
            lambda: self._publish_state(jumped=True),
        )
        self._playback = self._passes.playback
        self._failure = ""
        self._phase = "ready"
        paused, playing = PlaybackState.PAUSED, PlaybackState.PLAYING
        self._status = paused if self._settings.start_paused else playing
        acts = {
            "pause": self._pause,
            "resume": self._resume,
            "toggle_paused": self._toggle_paused,
            "is_paused": self._is_paused,
            "play_next": self._play_next,
            "burst": self._burst,
            "get_rate": self._get_rate,
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
        self._outputs.close()

    def tasks(self) -> list[Task]:
        """Return how far the bag is played, and what is wrong."""
        playback, played = self._playback, self._played
        bag = played.bag
        remarks = [f"{bag.path.name} is damaged: {bag.damage}"] if bag.damage else []
        remarks += [f"{name}: not played, {why}" for name, why in played.remarks.items()]
        remarks += self._outputs.remarks()
        values = {
            "bag": bag.path,
            "rate [-]": playback.rate,
            "played": playback.played,
            "messages": played.count,
            "pass": self._passes.number,
            "position [s]": (playback.reached_ns - playback.start_ns) / 1e9,
            "topics": ", ".join(sorted(played.topics)),
            "not played": ", ".join(played.remarks),
        }
        level = ERROR if self._failure else WARN if remarks else OK
        message = self._failure or "; ".join([self._phase, *remarks])
        return [Task("playback", level, message, self.hardware_id, values)]

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
        self._stop.set()  # also of a burst, which holds the lock
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
                raise ValueError(f"{self._played.bag.path} is at its end: seek first")
            if self._status == PlaybackState.PAUSED:
                self._status = PlaybackState.PLAYING
                self._go_on()

    def _toggle_paused(self, request: Any) -> None:
        with self._steered:
            is_playing = self._status == PlaybackState.PLAYING
            (self._pause if is_playing else self._resume)(request)

    def _is_paused(self, _: Any) -> Mapping[str, Any]:
        plays = self._status == PlaybackState.PLAYING and self.state == "active"
        return {"paused": not plays}

    def _play_next(self, _: Any) -> None:
        self._step(1)

    def _burst(self, request: BurstPlayback.Request) -> Mapping[str, Any]:
        if not request.num_messages:
            raise ValueError("num_messages = 0: expected at least 1")
        return {"success": True, "actually_burst": self._step(request.num_messages)}

    def _step(self, count: int) -> int:
        """Play the next messages while it is paused, and return how many there were."""
        with self._steered:
            self._check_active()
            if self._status == PlaybackState.PLAYING:
                raise ValueError("the player plays: pause it first")
            self._stop = threading.Event()
            self._passes.begin()
            played = self._playback.step(count, self._stop)
            if not played:
                raise ValueError(f"{self._played.bag.path} is at its end: seek first")
            self._set_phase(f"paused after {counted(self._playback.played, 'message')}")
            self._publish_state()
            return played

    def _get_rate(self, _: Any) -> Mapping[str, Any]:
        return {"rate": self._playback.rate}

    def _set_rate(self, request: SetPlaybackRate.Request) -> None:
        settings = replace(self._settings, rate=request.rate)  # checks it
        with self._steered:
            self._check_active()
            self._halt()
            self._playback.rate = settings.rate
            self._go_on()

    def _seek(self, request: SeekPlayback.Request) -> None:
        time_ns = stamp_from_message(request.time)
        self._played.check_time(time_ns)
        with self._steered:
            self._check_active()
            self._halt()
            try:
                latched = self._played.latched_before(time_ns)
                self._playback.go_to(time_ns, self._played.messages(time_ns))
            except (OSError, ValueError):
                self._go_on()  # from where it was
                raise
            self._passes.skip_begin()
            if self._status == PlaybackState.ENDED:
                self._status = PlaybackState.PAUSED
            self._publish_state(jumped=True)
            self._outputs.publish_latched(latched)
            if self._status == PlaybackState.PLAYING:
                self._start()

    def _check_active(self) -> None:
        if self.state != "active":
            raise ValueError(f"the player is {self.state}: expected active")
        if self.finished.is_set():
            raise ValueError("the player has ended")

    def _publish_progress(self) -> None:
        if self._status == PlaybackState.PLAYING:
            self._publish_state()

    def _publish_state(self, *, jumped: bool = False) -> None:
        self._steering.publish(
            PlaybackState(
                bag=str(self._played.bag.path),
                status=self._status,
                rate=self._playback.rate,
                start=stamp_to_message(self._played.start_ns),
                end=stamp_to_message(self._played.end_ns),
                position=stamp_to_message(self._playback.reached_ns),
                jumped=jumped,
            )
        )

    def _work(self, stop: threading.Event) -> None:
        damage = self._played.bag.damage
        try:
            if self._passes.run(stop):
                self._status = PlaybackState.ENDED
                self._publish_state()
                if not self._settings.stay:
                    self.finished.set()
        except Exception as error:
            self.get_logger().error(traceback.format_exc())
            self._failure = f"cannot play on: {error!r}"
            self.exit_code = 1
            self.report()
            self.finished.set()
        self._warn_of_damage(damage)

    def _warn_of_damage(self, known: str) -> None:
        bag = self._played.bag
        if bag.damage != known:
            self._warn(f"{bag.path.name} is damaged: {bag.damage}")

    def _warn(self, words: str) -> None:
        self.get_logger().warning(words)

    def _set_phase(self, phase: str) -> None:
        self._phase = phase
        self.get_logger().info(phase)
        self.report()


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(PlayerNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
