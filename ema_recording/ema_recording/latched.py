"""What is latched at a time of a recording."""

from bisect import bisect_left
from collections.abc import Iterable
from typing import NamedTuple

from rclpy.serialization import deserialize_message

from ema_recording.message_type import message_class
from ema_recording.reader import Bag, Place, Recorded


class _Entry(NamedTuple):
    """Where a message is, and what it is about."""

    place: Place
    topic: str
    actuator_id: str


class LatchedIndex:
    """Finds the latest messages of latched topics at any time of a bag.

    Each part of the bag is read once, when a time beyond it is first asked for. What is kept of a
    message is where it is; the few that are latched are read again from there.

    Parameters
    ----------
    topics
        The topics; of those that say which actuator they are about, the latest of each actuator is
        found.
    """

    def __init__(self, bag: Bag, topics: Iterable[str]) -> None:
        self._bag = bag
        self._topics = list(topics)
        self._entries: list[_Entry] = []
        self._until_ns = 0

    def before(self, time_ns: int) -> list[Recorded]:
        """Return the messages that are latched before a log time [ns], in their order."""
        self._extend(time_ns)
        latest: dict[tuple[str, str], _Entry] = {}
        end = bisect_left(self._entries, time_ns, key=lambda entry: entry.place.log_time_ns)
        for entry in self._entries[:end]:
            latest[entry.topic, entry.actuator_id] = entry
        chosen = sorted(latest.values())
        return [item for entry in chosen for item in self._bag.raw_at(self._topics, entry.place)]

    def _extend(self, time_ns: int) -> None:
        """Read what comes before a log time [ns] and is not known yet."""
        if not self._topics or time_ns <= self._until_ns:
            return
        found = []
        for place, item in self._bag.placed_raw_messages(self._topics, self._until_ns, time_ns - 1):
            try:
                message = deserialize_message(item.message, message_class(item.type_name))
            except Exception as error:  # whatever the middleware makes of what is no message
                reason = f"no {item.type_name}: {error}"
                self._bag.note_malformed(item.topic, place, reason)
                continue
            found.append(_Entry(place, item.topic, getattr(message, "actuator_id", "")))
        self._entries += found
        self._until_ns = time_ns
