# SPDX-License-Identifier: Apache-2.0
"""Telemetry and descriptions of an actuator in a recording."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from ema_bags.recording import MessagePlace, Recorded, Recording
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_ros.messages import description_from_message, telemetry_from_message
from ema_ros.stamps import stamp_from_message

TELEMETRY_TYPE: Final = "ema_interfaces/msg/TelemetryBlock"
DESCRIPTION_TYPE: Final = "ema_interfaces/msg/ActuatorDescription"
TRUE_FAULTS_TYPE: Final = "ema_interfaces/msg/FaultVectorStamped"
USAGE_TYPE: Final = "ema_interfaces/msg/Usage"
MEASURED_TYPE: Final = "ema_interfaces/msg/MeasuredCauses"
ESTIMATE_TYPE: Final = "ema_interfaces/msg/FaultEstimate"
HEALTH_TYPE: Final = "ema_interfaces/msg/Health"


def described_actuators(bag: Recording) -> list[str]:
    """Return the described actuators of a recording, in the order of their descriptions."""
    return list(dict.fromkeys(_actuator_ids(bag, *bag.topics_of(DESCRIPTION_TYPE))))


@dataclass(frozen=True)
class Malformed:
    """A malformed block of telemetry, or an invalid description."""

    stamp_ns: int
    reason: str


@dataclass(frozen=True)
class RecordedTelemetry:
    """Telemetry of one actuator in a recording."""

    bag: Recording
    """The recording."""

    topic: str
    """Topic of the telemetry."""

    actuator_id: str
    """Name of the actuator."""

    skips_others: bool
    """Whether blocks of further actuators on the topic are skipped; else they are an error."""

    descriptions: tuple[ActuatorDescription, ...]
    """Descriptions of the actuator in order, without repetitions."""

    def items(
        self, first: MessagePlace | None = None, last: MessagePlace | None = None
    ) -> Iterator[tuple[MessagePlace, Telemetry | Malformed | ActuatorDescription]]:
        """Yield blocks and descriptions of the actuator in the order of their log times.

        Parameters
        ----------
        first, last
            Places of the first and last item; None for no limit.

        Raises
        ------
        ValueError
            If there is a block of another actuator and no actuator was chosen.
        """
        topics = [self.topic, *self.bag.topics_of(DESCRIPTION_TYPE)]
        for item in self.bag.messages(topics, first, last):
            is_block = item.topic == self.topic
            if item.message.actuator_id == self.actuator_id:
                converted = _converted(self.bag, item)
                if is_block or not isinstance(converted, Malformed):
                    yield item.place, converted
            elif is_block and not self.skips_others:
                present = ", ".join(map(repr, sorted(set(_actuator_ids(self.bag, self.topic)))))
                raise ValueError(
                    f"{self.bag.path}: topic {self.topic} has telemetry of several actuators: "
                    f"{present}: choose one by actuator_id (--actuator-id)"
                )


def read_telemetry(
    bag: Recording, topic: str | None = None, actuator_id: str | None = None
) -> RecordedTelemetry:
    """Return the telemetry and the descriptions of one actuator in a recording.

    Parameters
    ----------
    bag
        The recording.
    topic
        Topic of the telemetry; required if the actuator has several.
    actuator_id
        Name of the actuator; required if the recording has several.

    Raises
    ------
    ValueError
        If the recording has no telemetry of the actuator or on the topic, if the choice is
        ambiguous, or if a type differs from the installed type. The error also reports damage.
    """
    try:
        return _find_telemetry(bag, topic, actuator_id)
    except ValueError as error:
        raise ValueError("; ".join(filter(None, (str(error), bag.damage)))) from error


def _find_telemetry(
    bag: Recording, topic: str | None, actuator_id: str | None
) -> RecordedTelemetry:
    candidates = _telemetry_topics(bag, topic)
    first_ids = {name: next(_actuator_ids(bag, name), "") for name in candidates}
    present = ", ".join(f"{name} (actuator {first!r})" for name, first in first_ids.items())
    if actuator_id is not None:
        # Topics are only searched if an actuator is not the first of any topic.
        candidates = [name for name, first in first_ids.items() if first == actuator_id] or [
            name for name in candidates if actuator_id in _actuator_ids(bag, name)
        ]
    if not candidates:
        raise ValueError(
            f"{bag.path} has no telemetry of actuator {actuator_id!r}; it has {present}"
        )
    if len(candidates) > 1:
        raise ValueError(
            f"{bag.path} has telemetry on several topics: {present}: choose one by topic or "
            "actuator_id (--topic, --actuator-id)"
        )
    [chosen] = candidates
    chosen_id = first_ids[chosen] if actuator_id is None else actuator_id
    descriptions = _descriptions(bag, chosen_id)
    return RecordedTelemetry(bag, chosen, chosen_id, actuator_id is not None, descriptions)


def _telemetry_topics(bag: Recording, topic: str | None) -> list[str]:
    present = ", ".join(f"{name} ({item.type_name})" for name, item in bag.topics.items())
    names = bag.topics_of(TELEMETRY_TYPE)
    if not names:
        raise ValueError(
            f"{bag.path} has no topic of {TELEMETRY_TYPE}; topics: {present or 'none'}; "
            f"`ema check {bag.path}` shows how to import other types"
        )
    if topic is not None and topic not in names:
        raise ValueError(f"{bag.path} has no telemetry on {topic!r}; topics: {present}")
    filled = [name for name in names if bag.topics[name].count and topic in (None, name)]
    if not filled:
        raise ValueError(f"{bag.path} has no messages on {topic or ', '.join(names)}")
    return filled


def _actuator_ids(bag: Recording, *topics: str) -> Iterator[str]:
    return (item.message.actuator_id for item in bag.messages(topics))


def _converted(bag: Recording, item: Recorded) -> Telemetry | Malformed | ActuatorDescription:
    is_block = item.type_name == TELEMETRY_TYPE
    try:
        return (telemetry_from_message if is_block else description_from_message)(item.message)
    except ValueError as error:
        bag.malformed.note(item, f"{'' if is_block else 'invalid description: '}{error}")
        return Malformed(stamp_from_message(item.message.header.stamp), str(error))


def _descriptions(bag: Recording, actuator_id: str) -> tuple[ActuatorDescription, ...]:
    descriptions: list[ActuatorDescription] = []
    for item in bag.messages(bag.topics_of(DESCRIPTION_TYPE)):
        if item.message.actuator_id == actuator_id:
            converted = _converted(bag, item)
            if isinstance(converted, ActuatorDescription) and converted not in descriptions[-1:]:
                descriptions.append(converted)
    return tuple(descriptions)
