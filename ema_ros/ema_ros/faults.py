"""Conversion of fault vectors to and from ema_interfaces/FaultVector and FaultVectorStamped."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.faults import FAULT_NAMES, fault_vector
from ema_ros.stamps import stamp_from_message

if TYPE_CHECKING:
    from ema_interfaces.msg import FaultVector, FaultVectorStamped


def faults_to_message(faults: ArrayLike) -> "FaultVector":
    """Return a fault vector as a message.

    Parameters
    ----------
    faults
        Normalised faults, ``(8,)``. Their range is not checked, as an estimate may be NaN.

    Raises
    ------
    ValueError
        When there are not eight of them.
    """
    from ema_interfaces.msg import FaultVector  # as in stamps

    k = np.asarray(faults, dtype=np.float64)
    if k.shape != (len(FAULT_NAMES),):
        raise ValueError(f"faults: expected shape ({len(FAULT_NAMES)},), not {k.shape}")
    return FaultVector(**dict(zip(FAULT_NAMES, k.tolist(), strict=True)))


def faults_from_message(message: "FaultVector") -> NDArray[np.float64]:
    """Return the fault vector in a message, ``(8,)``.

    Raises
    ------
    ValueError
        When a fault is not finite or outside its range.
    """
    return fault_vector([getattr(message, name) for name in FAULT_NAMES])


@dataclass(frozen=True, eq=False)
class StampedFaults:
    """The true faults of an actuator in one test cycle.

    Attributes
    ----------
    stamp_ns
        Start of the test cycle from which they hold [ns].
    actuator_id
        Which actuator.
    cycle
        Running number of the test cycle, from 0.
    faults
        Normalised faults, ``(8,)``.
    """

    stamp_ns: int
    actuator_id: str
    cycle: int
    faults: NDArray[np.float64]


def stamped_faults_from_message(message: "FaultVectorStamped") -> StampedFaults:
    """Return the stamped faults in a message.

    Raises
    ------
    ValueError
        When a fault is not finite or outside its range.
    """
    return StampedFaults(
        stamp_from_message(message.header.stamp),
        message.actuator_id,
        message.cycle,
        faults_from_message(message.faults),
    )
