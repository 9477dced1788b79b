"""The part of a bag that is played."""

from collections.abc import Iterable, Iterator

from rclpy.qos import DurabilityPolicy, QoSProfile

from ema_recording.latched import LatchedIndex
from ema_recording.playable import playable_topics
from ema_recording.player_settings import PlayerSettings
from ema_recording.qos import recorded_qos, replay_qos
from ema_recording.reader import Bag, Place, Recorded
from ema_recording.schema import to_installed


class PlayedBag:
    """A bag with the topics and the time that are played of it.

    Parameters
    ----------
    wanted
        Full names of the topics; all that can be played when None.

    Attributes
    ----------
    bag
        The bag itself.
    topics
        The topics to play.
    offers
        What is offered of them, by topic.
    remarks
        Why other topics cannot be played, by topic.
    odd_offers
        Why what was offered is not known, by topic; a reliable stream is offered there.
    start_ns, end_ns
        Log time of the first message that is played, and the one at which playing ends [ns].

    Raises
    ------
    ValueError
        When there is nothing to play.
    """

    def __init__(self, settings: PlayerSettings, wanted: set[str] | None) -> None:
        if not settings.bag:
            raise ValueError("parameter bag is empty: expected the path of a recording")
        self.bag = Bag(settings.bag)
        self.topics, self.remarks = playable_topics(
            self.bag, actuator_only=settings.actuator_only, wanted=wanted
        )
        self.offers: dict[str, QoSProfile] = {}
        self.odd_offers: dict[str, str] = {}
        for name, topic in self.topics.items():
            try:
                self.offers[name] = replay_qos(recorded_qos(topic.qos))
            except ValueError as error:
                self.offers[name] = replay_qos(())
                self.odd_offers[name] = str(error)
        self._upgrades = {
            name: to_installed(*topic.identity) for name, topic in self.topics.items()
        }
        self._latched = LatchedIndex(
            self.bag,
            [
                name
                for name, offer in self.offers.items()
                if offer.durability == DurabilityPolicy.TRANSIENT_LOCAL
            ],
        )
        begin_ns, self.end_ns = self.bag.start_ns or 0, self.bag.end_ns or 0
        length_s = (self.end_ns - begin_ns) / 1e9
        if settings.start_offset > length_s:
            raise ValueError(
                f"start_offset = {settings.start_offset:g} s is beyond the end of {self.bag.path}, "
                f"which lasts {length_s:.3f} s"
            )
        begin_ns += round(settings.start_offset * 1e9)
        if settings.playback_duration:
            self.end_ns = min(self.end_ns, begin_ns + round(settings.playback_duration * 1e9))
        first = next(self.messages(begin_ns), None)
        if first is None:
            damage = f"; {self.bag.damage}" if self.bag.damage else ""
            raise ValueError(
                f"{self.bag.path}: there is no message to play from {settings.start_offset:g} s "
                f"to {(self.end_ns - (self.bag.start_ns or 0)) / 1e9:.3f} s{damage}"
            )
        self.start_ns = first.log_time_ns

    @property
    def count(self) -> int:
        """How many messages the bag has on the topics."""
        return sum(topic.count for topic in self.topics.values())

    def messages(self, start_ns: int) -> Iterator[Recorded]:
        """Read what is played from a log time on [ns], of the installed types."""
        return self._upgraded(self.bag.placed_raw_messages(self.topics, start_ns, self.end_ns))

    def latched_before(self, time_ns: int) -> list[Recorded]:
        """Read what is latched before a log time [ns]."""
        return list(self._upgraded((None, item) for item in self._latched.before(time_ns)))

    def check_time(self, time_ns: int) -> None:
        """Raise ValueError for a log time [ns] that is not played."""
        if not self.start_ns <= time_ns <= self.end_ns:
            raise ValueError(
                f"time = {time_ns / 1e9:.3f} s is outside {self.bag.path}, "
                f"[{self.start_ns / 1e9:.3f}, {self.end_ns / 1e9:.3f}] s"
            )

    def _upgraded(self, items: Iterable[tuple[Place | None, Recorded]]) -> Iterator[Recorded]:
        for place, item in items:
            upgrade = self._upgrades[item.topic]
            try:
                yield item._replace(message=upgrade(item.message)) if upgrade else item
            except ValueError as error:
                if place is not None:
                    self.bag.note_malformed(item.topic, place, str(error))
