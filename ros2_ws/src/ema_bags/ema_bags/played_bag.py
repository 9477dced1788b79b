# SPDX-License-Identifier: Apache-2.0
"""The played topics and time range of a bag."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message

from ema_bags.message_type import message_class, type_name
from ema_bags.qos import recorded_qos, replay_qos
from ema_bags.reader import Bag
from ema_bags.recording import Recorded, Topic
from ema_core.quantity import Checked, flag, quantity, text, texts
from ema_core.wording import unknown_name
from ema_interfaces.msg import PlaybackState
from ema_ros import topics

CLOCK: Final = "/clock"
"""Topic of the playback time, which the player publishes."""

_STATE_TYPE: Final = type_name(PlaybackState)
_OF_ACTUATORS: Final = frozenset(
    type_name(kind) for kind, _ in (topics.ACTUATOR_TOPICS | topics.SYSTEM_TOPICS).values()
)


@dataclass(frozen=True)
class PlayerSettings(Checked):
    """Settings of a playback. Settings that exist in rosbag2 have the same names."""

    bag: str = text("", "bag to play: a file or a folder")
    rate: float = quantity(1.0, "-", 0.01, 100.0, "playback rate")
    start_offset: float = quantity(
        0.0, "s", 0.0, 1e9, "start of the playback, relative to the start of the bag"
    )
    playback_duration: float = quantity(
        0.0, "s", 0.0, 1e9, "duration of the playback; 0: to the end of the bag"
    )
    loop: bool = flag(False, "restart at the end")
    start_paused: bool = flag(False, "start paused, until the player is resumed")
    actuator_only: bool = flag(False, "play only the actuator's topics, for diagnosis by a monitor")
    wait_s: float = quantity(
        5.0, "s", 0.0, 3600.0, "longest wait for a subscriber of each telemetry topic"
    )
    clock_rate_hz: float = quantity(100.0, "Hz", 1.0, 1000.0, "rate of /clock")
    stay: bool = flag(False, "stay at the end of the bag and allow seeking, instead of ending")
    topics: tuple[str, ...] = texts("topics to play; empty: all")


class PlayedBag:
    """A bag with its played topics and time range.

    Parameters
    ----------
    wanted
        Full names of the topics to play; None for all playable topics.

    Attributes
    ----------
    topics
        The played topics.
    offers
        Offered quality of service by topic.
    remarks
        Reason why a topic is not played, or played with a default quality of service, by topic.
    skipped
        Number of skipped malformed messages.
    start_ns, end_ns
        Log times of the first played message and of the end of the playback [ns].

    Raises
    ------
    ValueError
        If there is nothing to play, with the reasons, or if a wanted topic is missing.
    """

    def __init__(self, settings: PlayerSettings, wanted: set[str] | None) -> None:
        if not settings.bag:
            raise ValueError("parameter bag is empty: expected the path of a recording")
        self.bag = Bag(settings.bag)
        self.remarks: dict[str, str] = {}
        self.skipped = 0
        self._upgrades: dict[str, Callable[[bytes], bytes] | None] = {}
        self.topics = self._playable(settings.actuator_only, wanted)
        self.offers: dict[str, QoSProfile] = {}
        for name, topic in self.topics.items():
            try:
                self.offers[name] = replay_qos(recorded_qos(topic.qos))
            except ValueError as error:
                self.offers[name] = replay_qos(())
                self.remarks[name] = f"played with reliable QoS: {error}"
        # Latched messages before ``_latched_until_ns``, with their actuators.
        self._latched: list[tuple[Recorded, str]] = []
        self._latched_until_ns = 0
        first_ns, self.end_ns = self.bag.start_ns or 0, self.bag.end_ns or 0
        length_s = (self.end_ns - first_ns) / 1e9
        if settings.start_offset > length_s:
            raise ValueError(
                f"start_offset = {settings.start_offset:g} s is after the end of "
                f"{self.bag.path}, which lasts {length_s:.3f} s"
            )
        begin_ns = first_ns + round(settings.start_offset * 1e9)
        if settings.playback_duration:
            self.end_ns = min(self.end_ns, begin_ns + round(settings.playback_duration * 1e9))
        first = next(self.messages(begin_ns), None)
        if first is None:
            damage = f"; {self.bag.damage}" if self.bag.damage else ""
            raise ValueError(
                f"{self.bag.path}: no message to play from {settings.start_offset:g} s "
                f"to {(self.end_ns - first_ns) / 1e9:.3f} s{damage}"
            )
        self.start_ns = first.log_time_ns

    def leave_out(self, name: str, reason: str) -> None:
        """Exclude a topic from playback; ValueError if it is the only one."""
        self.remarks[name] = f"not played, {reason}"
        del self.topics[name]
        if not self.topics:
            raise ValueError(f"{self.bag.path}: nothing to play: {name}: {reason}")

    @property
    def count(self) -> int:
        """Number of messages on the played topics."""
        return sum(topic.count for topic in self.topics.values())

    def messages(self, start_ns: int) -> Iterator[Recorded]:
        """Return an iterator of the played messages from a log time [ns] on.

        They are upgraded to the installed types; malformed messages are skipped.
        """
        return self._upgraded(self.bag.raw_messages(self.topics, start_ns, self.end_ns))

    def latched_before(self, time_ns: int) -> list[Recorded]:
        """Return the last latched message of each topic and actuator before a log time [ns].

        Each message of the bag is read only once.
        """
        if time_ns > self._latched_until_ns:
            latched = DurabilityPolicy.TRANSIENT_LOCAL
            topics = [name for name, offer in self.offers.items() if offer.durability == latched]
            items = self.bag.raw_messages(topics, self._latched_until_ns, time_ns - 1)
            for item in self._upgraded(items):
                message: Any = deserialize_message(item.message, message_class(item.type_name))
                self._latched.append((item, getattr(message, "actuator_id", "")))
            self._latched_until_ns = time_ns
        latest: dict[tuple[str, str], Recorded] = {}
        for item, actuator_id in self._latched:
            if item.log_time_ns < time_ns:
                latest.pop((item.topic, actuator_id), None)  # it becomes the last one
                latest[item.topic, actuator_id] = item
        return list(latest.values())

    def check_time(self, time_ns: int) -> None:
        """Raise ValueError for a log time [ns] outside the playback."""
        if not self.start_ns <= time_ns <= self.end_ns:
            raise ValueError(
                f"time = {time_ns / 1e9:.3f} s is outside {self.bag.path}, "
                f"[{self.start_ns / 1e9:.3f}, {self.end_ns / 1e9:.3f}] s"
            )

    def _playable(self, actuator_only: bool, wanted: set[str] | None) -> dict[str, Topic]:
        bag = self.bag
        for name in sorted(wanted or ()):
            if name not in bag.topics:
                raise ValueError(f"{bag.path}: {unknown_name('topic', name, bag.topics)}")
        playable: dict[str, Topic] = {}
        for name, topic in bag.topics.items():
            excluded = actuator_only and topic.type_name not in _OF_ACTUATORS
            is_of_player = name == CLOCK or topic.type_name == _STATE_TYPE
            if not topic.count or is_of_player or excluded or name not in (wanted or bag.topics):
                continue
            try:
                message_class(topic.type_name)
                self._upgrades[name] = topic.upgrade()
                playable[name] = topic
            except ValueError as error:
                self.remarks[name] = f"not played, {error}"
        if playable:
            return playable
        reasons = [f"{name}: {why}" for name, why in self.remarks.items()]
        if not bag.topics or bag.start_ns is None:
            reasons = [f"it has no messages {bag.damage}".rstrip()]
        elif actuator_only and not reasons:
            reasons = ["it has no actuator messages, and actuator_only is set"]
        raise ValueError(f"{bag.path}: nothing to play: {'; '.join(reasons)}")

    def _upgraded(self, items: Iterable[Recorded]) -> Iterator[Recorded]:
        """Yield messages of the installed types; malformed messages are skipped and reported."""
        for item in items:
            upgrade = self._upgrades[item.topic]
            try:
                message = upgrade(item.message) if upgrade else item.message
                deserialize_message(message, message_class(item.type_name))
            except Exception as error:  # the middleware raises various errors
                self.skipped += 1
                self.bag.malformed.note(item, str(error))
                continue
            yield item._replace(message=message)
