"""A recording of a simulated actuator, made without any node."""

from types import TracebackType
from typing import Any, Self

from numpy.typing import ArrayLike

from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_core.telemetry import Telemetry
from ema_recording.writer import BagWriter
from ema_ros import topics
from ema_ros.description import description_to_message
from ema_ros.faults import StampedFaults, stamped_faults_to_message
from ema_ros.joint_state import joint_state_after
from ema_ros.telemetry import telemetry_to_message
from ema_ros.usage import usage_at_cycle


class SimulatedActuatorBag:
    """Records what a simulated actuator node would publish, in simulated time.

    Parameters
    ----------
    bag
        Recording to write to; it is closed at the end of the context.
    description
        The actuator.
    start_ns
        When it begins [ns].
    """

    def __init__(self, bag: BagWriter, description: ActuatorDescription, start_ns: int = 0) -> None:
        self._bag = bag
        self._description = description
        self._end_ns = start_ns
        for name, (message_class, qos) in topics.ACTUATOR_TOPICS.items():
            bag.add_topic(f"{topics.NAMESPACE}/{name}", message_class, qos)
        self._write(topics.DESCRIPTION, description_to_message(description, start_ns), start_ns)

    def begin_cycle(self, cycle: int, faults: ArrayLike, hours: float) -> None:
        """Record service life and true faults at the start of a test cycle.

        Parameters
        ----------
        cycle
            Running number, from 0.
        faults
            Fault vector, ``(8,)``.
        hours
            Service hours since new [h].
        """
        usage = usage_at_cycle(self._description, self._end_ns, hours, cycle)
        self._write(topics.USAGE, usage, self._end_ns)
        truth = StampedFaults(
            self._end_ns, self._description.actuator_id, cycle, fault_vector(faults)
        )
        self._write(topics.SIMULATED_FAULTS, stamped_faults_to_message(truth), self._end_ns)

    def write_block(self, block: Telemetry, motor_torque: float | None = None) -> None:
        """Record a block of telemetry and, where the torque is known, the joint state at its end.

        Parameters
        ----------
        block
            Telemetry as it is measured.
        motor_torque
            Torque of the motor at the block's end [N.m]; None when it is not known.
        """
        self._end_ns = block.stamp_at(len(block) - 1)
        telemetry = telemetry_to_message(block, self._description.actuator_id)
        self._write(topics.TELEMETRY, telemetry, block.stamp_ns)
        if motor_torque is not None:
            joint = joint_state_after(block, motor_torque, self._description)
            self._write(topics.JOINT_STATES, joint, self._end_ns)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._bag.close()

    def _write(self, name: str, message: Any, stamp_ns: int) -> None:
        """Write a message that is received when the block with it is complete."""
        self._bag.write(f"{topics.NAMESPACE}/{name}", message, self._end_ns, stamp_ns)
