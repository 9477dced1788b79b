"""The messages that say how things stand, with which each file of a recording begins."""

from collections.abc import Iterator
from typing import Any, Final, NamedTuple

from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message

from ema_interfaces.msg import ActuatorDescription, Usage

_DESCRIBING: Final = (ActuatorDescription, Usage)
_MOST: Final = 4096


class StateMessage(NamedTuple):
    """A serialised message, and when it was sent [ns]."""

    topic: str
    data: bytes
    publish_time_ns: int


def says_state(message_class: type, qos: QoSProfile) -> bool:
    """Return whether the latest message of a topic holds until the next one.

    Those of latched topics do, and descriptions and service lives also where they are not latched.
    """
    is_latched = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
    return is_latched or issubclass(message_class, _DESCRIBING)


def actuator_of(message: Any) -> str:
    """Return which actuator a message is about; empty where it does not say."""
    return str(getattr(message, "actuator_id", ""))


class StateMessages:
    """The latest message of each topic, of each actuator that it is about: 4,096 at most."""

    def __init__(self) -> None:
        self._latest: dict[tuple[str, str], StateMessage] = {}

    def __iter__(self) -> Iterator[StateMessage]:
        """Give them in the order in which they came."""
        return iter(list(self._latest.values()))

    def note(self, topic: str, message_class: Any, data: bytes, publish_time_ns: int) -> None:
        """Take a message for the latest of its topic and actuator."""
        actuator = ""
        if "actuator_id" in message_class.get_fields_and_field_types():
            try:
                actuator = actuator_of(deserialize_message(data, message_class))
            except Exception:  # whatever the middleware makes of what is no message
                return
        self._latest.pop((topic, actuator), None)  # it becomes the last one
        self._latest[topic, actuator] = StateMessage(topic, data, publish_time_ns)
        if len(self._latest) > _MOST:
            del self._latest[next(iter(self._latest))]
