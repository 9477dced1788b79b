"""Which topics of a bag can be played, and why the others cannot."""

from typing import Final

from sensor_msgs.msg import JointState

from ema_core.wording import unknown_name
from ema_interfaces.msg import (
    ActuatorDescription,
    FaultVectorStamped,
    MeasuredCauses,
    PlaybackState,
    TelemetryBlock,
    Usage,
)
from ema_recording.message_type import message_class, type_name
from ema_recording.reader import Bag, Topic
from ema_recording.schema import to_installed

CLOCK: Final = "/clock"
"""The topic that a player publishes itself."""

_OWN: Final = type_name(PlaybackState)
_ACTUATOR_TYPES: Final = frozenset(
    map(
        type_name,
        (
            TelemetryBlock,
            ActuatorDescription,
            FaultVectorStamped,
            JointState,
            Usage,
            MeasuredCauses,
        ),
    )
)


def playable_topics(
    bag: Bag, *, actuator_only: bool, wanted: set[str] | None = None
) -> tuple[dict[str, Topic], dict[str, str]]:
    """Return the topics to play, and why others are not, by name.

    Parameters
    ----------
    bag
        The bag.
    actuator_only
        Whether only those of the actuator are wanted.
    wanted
        Full names of those that are wanted; all when None.

    Raises
    ------
    ValueError
        When there is none to play, with the reasons, or one that is wanted is not in the bag.
    """
    playable: dict[str, Topic] = {}
    refused: dict[str, str] = {}
    for name in sorted(wanted or ()):
        if name not in bag.topics:
            raise ValueError(f"{bag.path}: {unknown_name('topic', name, bag.topics)}")
    for name, topic in bag.topics.items():
        if wanted is not None and name not in wanted:
            continue
        excluded = actuator_only and topic.type_name not in _ACTUATOR_TYPES
        if not topic.count or name == CLOCK or topic.type_name == _OWN or excluded:
            continue
        try:
            if topic.encoding != "cdr":
                raise ValueError(f"it is encoded as {topic.encoding!r}, expected 'cdr'")
            message_class(topic.type_name)
            to_installed(*topic.identity)
        except ValueError as error:
            refused[name] = str(error)
        else:
            playable[name] = topic
    if not playable:
        reasons = [f"{name}: {why}" for name, why in refused.items()]
        if not bag.topics or bag.start_ns is None:
            reasons = [f"no message in it {bag.damage}".rstrip()]
        elif actuator_only and not reasons:
            reasons = ["no message of an actuator in it, and actuator_only is set"]
        raise ValueError(f"{bag.path}: nothing to play: {'; '.join(reasons)}")
    return playable, refused
