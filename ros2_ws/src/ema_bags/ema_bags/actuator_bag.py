# SPDX-License-Identifier: Apache-2.0
"""Recording of a simulated actuator without ROS nodes."""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Any

from numpy.typing import ArrayLike

from ema_bags.writer import BagWriter
from ema_core.cause_profiles import Profile
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_ros import topics
from ema_ros.actuator_messages import messages_of_block, messages_of_cycle
from ema_ros.messages import description_to_message
from ema_ros.stamps import stamp_from_message


class SimulatedActuatorBag(AbstractContextManager["SimulatedActuatorBag", None]):
    """Records the messages of a simulated actuator node, in simulated time.

    Parameters
    ----------
    bag
        Recording to write to; it is closed at the end of the context.
    start_ns
        Start of the recording [ns].
    """

    def __init__(self, bag: BagWriter, description: ActuatorDescription, start_ns: int = 0) -> None:
        self._bag = bag
        self._description = description
        self._end_ns = start_ns
        for name, (message_class, qos) in topics.ACTUATOR_TOPICS.items():
            bag.add_topic(f"{topics.NAMESPACE}/{name}", message_class, qos)
        self._write({topics.DESCRIPTION: description_to_message(description, start_ns)})

    def begin_cycle(self, cycle: int, faults: ArrayLike, hours: float) -> None:
        """Record the start of a test cycle (see ``messages_of_cycle``)."""
        self._write(messages_of_cycle(self._description, self._end_ns, cycle, hours, faults))

    def note_causes(self, causes: Mapping[str, Profile]) -> None:
        """Record the true hidden causes in the metadata, as ``NAME=VALUE`` separated by spaces."""
        if causes:
            texts = (f"{name}={profile}" for name, profile in causes.items())
            self._bag.custom_data["hidden_causes"] = " ".join(texts)

    def write_block(self, block: Telemetry, motor_torque: float | None = None) -> None:
        """Record a block of telemetry (see ``messages_of_block``)."""
        self._end_ns = block.stamp_at(len(block) - 1)
        self._write(messages_of_block(self._description, block, motor_torque))

    def __exit__(self, *_: object) -> None:
        self._bag.close()

    def _write(self, messages: dict[str, Any]) -> None:
        """Write messages with their stamps; their log time is the end of the latest block."""
        for name, message in messages.items():
            stamp_ns = stamp_from_message(message.header.stamp)
            self._bag.write(f"{topics.NAMESPACE}/{name}", message, self._end_ns, stamp_ns)
