"""Topics of actuator and monitor, and what their publishers offer.

Telemetry is reliable with ten seconds of history: a lost block costs a whole window, and a reader
may be busy, or a replay fast. Descriptions, true faults, service life and health are latched, so
that whoever comes late knows how things stand. Nodes use the names without the namespace;
recordings made without a node are under ``/ema``.
"""

from typing import Final

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from ema_interfaces.msg import (
    ActuatorDescription,
    FaultEstimate,
    FaultVectorStamped,
    Health,
    TelemetryBlock,
    Usage,
)

TELEMETRY: Final = "telemetry"
DESCRIPTION: Final = "actuator_description"
SIMULATED_FAULTS: Final = "simulated_faults"
JOINT_STATES: Final = "joint_states"
USAGE: Final = "usage"
FAULT_ESTIMATE: Final = "fault_estimate"
HEALTH: Final = "health"

NAMESPACE: Final = "/ema"

LATCHED: Final = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
LATCHED_BY_MANY: Final = QoSProfile(
    depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
"""For who subscribes to what is latched: a publisher for each actuator may be there."""

STREAM: Final = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
STATE: Final = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)

ACTUATOR_TOPICS: Final = {
    DESCRIPTION: (ActuatorDescription, LATCHED),
    SIMULATED_FAULTS: (FaultVectorStamped, LATCHED),
    TELEMETRY: (TelemetryBlock, STREAM),
    JOINT_STATES: (JointState, STATE),
    USAGE: (Usage, LATCHED),
}
"""What a simulated actuator publishes: message class and quality of service by topic."""

MONITOR_TOPICS: Final = {
    FAULT_ESTIMATE: (FaultEstimate, STATE),
    HEALTH: (Health, LATCHED),
}
"""What a monitor publishes: message class and quality of service by topic."""
