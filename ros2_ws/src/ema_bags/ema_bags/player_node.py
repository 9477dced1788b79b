# SPDX-License-Identifier: Apache-2.0
"""The player node: publishes the messages of a bag."""

import sys
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final

from ema_bags.playback import Playback
from ema_bags.playback_services import PLAYBACK_SERVICES
from ema_bags.played_bag import PlayedBag, PlayerSettings
from ema_bags.player_outputs import PlayerOutputs
from ema_bags.recording import Recorded
from ema_core.wording import counted
from ema_interfaces.msg import PlaybackState
from ema_ros.executor import WaitingCallbackGroup
from ema_ros.managed_node import ManagedNode
from ema_ros.node_parameters import declare, read
from ema_ros.run import run
from ema_ros.stamps import stamp_from_message, stamp_to_message
from ema_ros.status import ERROR, OK, WARN, Task
from ema_ros.topics import LATCHED, PLAYBACK_STATE

_STATE_S: Final = 0.5
_BETWEEN_PASSES_S: Final = 0.05


class PlayerNode(ManagedNode):
    """Plays the messages of a bag in order, and publishes the playback time on ``/clock``.

    Parameters of the node are the fields of ``PlayerSettings``; topics are full names, or names
    relative to the namespace.

    While the node is inactive, the playback time stands still. The node ends at the end of the
    bag, when all reliable subscriptions have acknowledged every message, unless ``stay`` or
    ``loop`` is set. A new pass is a jump back in time, published on ``/clock`` and in the state
    like a seek.

    Services pause, step, seek and change the rate of an active player. A seek first publishes the
    messages latched at the new time. ``playback_state`` reports the state.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("player", **kwargs)
        declare(self, PlayerSettings)
        self._stop = threading.Event()
        self._worker: threading.Thread | None = None
        self._steered = threading.RLock()  # guards start and stop of the worker

    def configure(self) -> None:
        """Open the bag and create the publishers of its topics."""
        self._settings = read(self, PlayerSettings)
        self._played = PlayedBag(self._settings, self.full_topic_names(self._settings.topics))
        self._outputs = PlayerOutputs(self, self._played)
        for name, reason in self._played.remarks.items():
            self.get_logger().warning(f"{name}: {reason}")
        self._warn_of_damage("")
        self._playback = Playback(
            self._played.messages(self._played.start_ns),
            self._settings.rate,
            1.0 / self._settings.clock_rate_hz,
            self._outputs.publish,
            self._outputs.publish_clock,
        )
        self._is_begun, self._pass = False, 1
        self._failure = ""
        self._phase = "ready"
        paused, playing = PlaybackState.PAUSED, PlaybackState.PLAYING
        self._status = paused if self._settings.start_paused else playing
        group = WaitingCallbackGroup()  # a seek reads the bag
        for name, kind in PLAYBACK_SERVICES.items():
            self.create_service(kind, f"~/{name}", self._answerer(name), callback_group=group)
        self._state_output = self.create_publisher(PlaybackState, PLAYBACK_STATE, LATCHED)

    def activate(self) -> None:
        """Continue the playback, unless it is paused."""
        with self._steered:
            self._continue()
        self.add_timer(
            _STATE_S, lambda: self._status == PlaybackState.PLAYING and self._publish_state()
        )

    def deactivate(self) -> None:
        """Pause the playback before the next message."""
        self._halt()

    def tasks(self) -> list[Task]:
        """Return the progress of the playback, and its defects."""
        playback, played = self._playback, self._played
        bag = played.bag
        remarks = [f"{bag.path.name} is damaged: {bag.damage}"] if bag.damage else []
        remarks += [f"{name}: {why}" for name, why in played.remarks.items()]
        remarks += self._outputs.live_monitors()
        values = {
            "bag": bag.path,
            "rate [-]": playback.rate,
            "played": playback.played,
            "messages": played.count,
            "skipped": played.skipped,
            "pass": self._pass,
            "position [s]": (playback.reached_ns - playback.start_ns) / 1e9,
            "topics": ", ".join(sorted(played.topics)),
            "not played": ", ".join(played.remarks.keys() - played.topics.keys()),
        }
        level = ERROR if self._failure else WARN if remarks else OK
        message = self._failure or "; ".join([self._phase, *remarks])
        return [Task("playback", level, message, self.hardware_id, values)]

    def _continue(self, *, jumped: bool = False, latched: Iterable[Recorded] = ()) -> None:
        """Publish the state and latched messages; if playing, play in a thread."""
        self._publish_state(jumped=jumped)
        self._outputs.publish_latched(latched)
        if self._status == PlaybackState.PLAYING:
            self._stop = threading.Event()
            self._worker = threading.Thread(target=self._work, args=(self._stop,), name="player")
            self._worker.start()

    def _halt(self) -> None:
        """Stop the playback before the next message."""
        self._stop.set()  # also stops a burst, which holds the lock
        with self._steered:
            self._stop.set()
            if self._worker is not None:
                self._worker.join()

    def _answerer(self, name: str) -> Callable[[Any, Any], Any]:
        """Return the callback of a service, which answers with the reason if it refuses."""
        act: Callable[[Any], Mapping[str, Any] | None] = getattr(self, f"_{name}")

        def answer(request: Any, response: Any) -> Any:
            try:
                result = {"success": True, **(act(request) or {})}
            except (OSError, ValueError) as error:
                # The types of rosbag2 have no field for the reason.
                self.get_logger().warning(f"{name} refused: {error}")
                result = {"success": False, "message": str(error)}
            for field, value in result.items():
                if hasattr(response, field):
                    setattr(response, field, value)
            return response

        return answer

    @contextmanager
    def _steering(self) -> Iterator[None]:
        """Serialise requests, and refuse them while the node is not active."""
        with self._steered:
            if self.state != "active":
                raise ValueError(f"the player is {self.state}: expected active")
            if self.finished.is_set():
                raise ValueError("the player has ended")
            yield

    def _pause(self, _: Any) -> None:
        with self._steering():
            self._halt()
            if self._status == PlaybackState.PLAYING:
                self._status = PlaybackState.PAUSED
            self._publish_state()

    def _resume(self, _: Any) -> None:
        with self._steering():
            if self._status == PlaybackState.ENDED:
                raise ValueError(f"{self._played.bag.path} is at its end: seek first")
            if self._status == PlaybackState.PAUSED:
                self._status = PlaybackState.PLAYING
                self._continue()

    def _toggle_paused(self, request: Any) -> None:
        with self._steered:
            is_playing = self._status == PlaybackState.PLAYING
            (self._pause if is_playing else self._resume)(request)

    def _is_paused(self, _: Any) -> Mapping[str, Any]:
        plays = self._status == PlaybackState.PLAYING and self.state == "active"
        return {"paused": not plays}

    def _play_next(self, _: Any) -> None:
        self._step(1)

    def _burst(self, request: Any) -> Mapping[str, Any]:
        # As in rosbag2, 0 plays the rest of the bag.
        return {"actually_burst": self._step(request.num_messages or sys.maxsize)}

    def _step(self, count: int) -> int:
        """Play the next messages while paused; return the number played."""
        with self._steering():
            if self._status == PlaybackState.PLAYING:
                raise ValueError("the player is playing: pause it first")
            self._stop = threading.Event()
            self._begin()
            played = self._playback.step(count, self._stop)
            if not played:
                raise ValueError(f"{self._played.bag.path} is at its end: seek first")
            self._set_phase(f"paused after {counted(self._playback.played, 'message')}")
            self._publish_state()
            return played

    def _get_rate(self, _: Any) -> Mapping[str, Any]:
        return {"rate": self._playback.rate}

    def _set_rate(self, request: Any) -> None:
        settings = replace(self._settings, rate=request.rate)  # checks it
        with self._steering():
            self._halt()
            self._playback.rate = settings.rate
            self._continue()

    def _seek(self, request: Any) -> None:
        time_ns = stamp_from_message(request.time)
        self._played.check_time(time_ns)
        with self._steering():
            self._halt()
            try:
                latched = self._played.latched_before(time_ns)
                self._playback.go_to(time_ns, self._played.messages(time_ns))
            except (OSError, ValueError):
                self._continue()  # from the previous position
                raise
            self._is_begun = True
            if self._status == PlaybackState.ENDED:
                self._status = PlaybackState.PAUSED
            self._continue(jumped=True, latched=latched)

    def _publish_state(self, *, jumped: bool = False) -> None:
        state = PlaybackState(
            bag=str(self._played.bag.path),
            status=self._status,
            rate=self._playback.rate,
            start=stamp_to_message(self._played.start_ns),
            end=stamp_to_message(self._played.end_ns),
            position=stamp_to_message(self._playback.reached_ns),
            jumped=jumped,
        )
        state.header.stamp = self.get_clock().now().to_msg()
        self._state_output.publish(state)

    def _work(self, stop: threading.Event) -> None:
        damage = self._played.bag.damage
        try:
            if self._run(stop):
                self._status = PlaybackState.ENDED
                self._publish_state()
                if not self._settings.stay:
                    self.finished.set()
        except Exception as error:
            self.get_logger().error(traceback.format_exc())
            self._failure = f"cannot continue the playback: {error!r}"
            self.exit_code = 1
            self.report()
            self.finished.set()
        self._warn_of_damage(damage)

    def _begin(self) -> None:
        """Publish the messages latched before the first played message, once."""
        if not self._is_begun and self._settings.start_offset:
            self._outputs.publish_latched(self._played.latched_before(self._played.start_ns))
        self._is_begun = True

    def _run(self, stop: threading.Event) -> bool:
        """Wait for subscribers at the start, then play; return whether the end is reached."""
        if not self._is_begun:
            self._wait_for_subscribers(stop)
        if stop.is_set():
            return False
        self._begin()
        while True:
            self._set_phase(f"playing at rate {self._playback.rate:g}")
            is_at_end = self._playback.run(stop)
            played = counted(self._playback.played, "message")
            if not is_at_end:
                self._set_phase(f"paused after {played}")
                return False
            if pending := self._outputs.await_acknowledgement(stop):
                names = ", ".join(pending)
                self.get_logger().warning(f"some messages on {names} were not acknowledged")
            # A bag without duration would otherwise restart at once.
            if stop.is_set() or (self._settings.loop and stop.wait(_BETWEEN_PASSES_S)):
                return False
            self._set_phase(f"played {played} from {self._played.bag.path}")
            if not self._settings.loop:
                return True
            start_ns = self._played.start_ns
            self._pass += 1
            self._playback.go_to(start_ns, self._played.messages(start_ns))
            self._publish_state(jumped=True)
            self._outputs.publish_latched(self._played.latched_before(start_ns))

    def _wait_for_subscribers(self, stop: threading.Event) -> None:
        wait_s = self._settings.wait_s
        if wait_s and (missing := self._outputs.missing()):
            self._set_phase(f"waiting for a subscriber of {missing}")
        self._outputs.await_subscribers(stop, wait_s)
        if not stop.is_set() and (missing := self._outputs.missing()):
            self.get_logger().warning(f"no subscriber of {missing} after {wait_s:g} s: starting")
        for remark in self._outputs.live_monitors():
            self.get_logger().warning(remark)

    def _warn_of_damage(self, reported: str) -> None:
        bag = self._played.bag
        if bag.damage != reported:
            self.get_logger().warning(f"{bag.path.name} is damaged: {bag.damage}")

    def _set_phase(self, phase: str) -> None:
        self._phase = phase
        self.get_logger().info(phase)
        self.report()


def main(args: list[str] | None = None) -> int:
    """Run the player."""
    return run(PlayerNode, args)
