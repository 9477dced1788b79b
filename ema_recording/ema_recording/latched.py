"""What is latched at a time of a recording."""

from collections.abc import Iterable

from rclpy.serialization import deserialize_message

from ema_recording.message_type import message_class
from ema_recording.reader import Bag, Recorded


def latched_before(bag: Bag, topics: Iterable[str], time_ns: int) -> list[Recorded]:
    """Return the latest messages of latched topics before a time, in their order.

    Parameters
    ----------
    topics
        The topics; of those that say which actuator they are about, the latest of each actuator is
        returned.
    time_ns
        Log time [ns].
    """
    latest: dict[tuple[str, str], Recorded] = {}
    chosen = list(topics)
    for item in bag.raw_messages(chosen) if chosen else ():
        if item.log_time_ns >= time_ns:
            break
        message = deserialize_message(item.message, message_class(item.type_name))
        key = (item.topic, getattr(message, "actuator_id", ""))
        latest.pop(key, None)
        latest[key] = item
    return list(latest.values())
