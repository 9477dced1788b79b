"""Topics of an actuator and what their publishers offer.

Telemetry is reliable with a second of history: a lost block costs a whole window. The description
is latched, so that whoever comes late knows the actuator. Nodes use the names without the
namespace; recordings made without a node are under ``/ema``.
"""

from typing import Final

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from ema_interfaces.msg import ActuatorDescription, FaultVectorStamped, TelemetryBlock

TELEMETRY: Final = "telemetry"
DESCRIPTION: Final = "actuator_description"
SIMULATED_FAULTS: Final = "simulated_faults"
JOINT_STATES: Final = "joint_states"

NAMESPACE: Final = "/ema"

LATCHED: Final = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
STREAM: Final = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
STATE: Final = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)

ACTUATOR_TOPICS: Final = {
    DESCRIPTION: (ActuatorDescription, LATCHED),
    SIMULATED_FAULTS: (FaultVectorStamped, LATCHED),
    TELEMETRY: (TelemetryBlock, STREAM),
    JOINT_STATES: (JointState, STATE),
}
"""What a simulated actuator publishes: message class and quality of service by topic."""
