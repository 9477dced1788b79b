# SPDX-License-Identifier: Apache-2.0
"""Topics of actuator and monitor, and the quality of service of their publishers.

Telemetry is reliable with a history of ten seconds: a lost block costs a whole window. Topics that
late subscribers need are latched (transient local). Nodes use the names without the namespace;
recordings made without a node are under ``/ema``.
"""

from typing import Final

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from ema_interfaces.msg import (
    ActuatorDescription,
    Advice,
    BaselineStatus,
    FaultEstimate,
    FaultVectorStamped,
    FrictionCurve,
    Health,
    HealthForecast,
    HealthSummary,
    MeasuredCauses,
    NodeStatus,
    PlaybackState,
    TelemetryBlock,
    Usage,
    WindowFit,
)
from ema_ros.topic_names import (
    ADVICE,
    BASELINE,
    DESCRIPTION,
    FAULT_ESTIMATE,
    FRICTION_CURVE,
    HEALTH,
    HEALTH_FORECAST,
    HEALTH_SUMMARY,
    JOINT_STATES,
    MEASURED_CAUSES,
    NODE_STATUS,
    PLAYBACK_STATE,
    SIMULATED_FAULTS,
    TELEMETRY,
    USAGE,
    WINDOW_FIT,
)
from ema_ros.topic_names import JOINT_COMMANDS as JOINT_COMMANDS
from ema_ros.topic_names import NAMESPACE as NAMESPACE
from ema_ros.topic_names import PAYLOAD as PAYLOAD
from ema_ros.topic_names import ROBOT_DESCRIPTION as ROBOT_DESCRIPTION
from ema_ros.topic_names import ROBOT_TOPICS as ROBOT_TOPICS
from ema_ros.topic_names import TRUE_FRICTION as TRUE_FRICTION

LATCHED: Final = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
LATCHED_BY_MANY: Final = QoSProfile(
    depth=1000, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
"""Quality of service of subscriptions to latched topics with a publisher per actuator."""

LEASE_S: Final = 6.0
"""Liveliness lease of publishers of health [s]. The middleware renews it after two thirds of it."""

ALIVE: Final = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    liveliness=LivelinessPolicy.AUTOMATIC,
    liveliness_lease_duration=Duration(nanoseconds=round(1e9 * LEASE_S)),
)
"""Like ``LATCHED``; subscriptions also detect when a publisher's process ends or hangs."""

ALIVE_BY_MANY: Final = QoSProfile(
    depth=1000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    liveliness=LivelinessPolicy.AUTOMATIC,
    liveliness_lease_duration=ALIVE.liveliness_lease_duration,
)
"""Quality of service of subscriptions to topics with an ``ALIVE`` publisher per actuator."""

STREAM: Final = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
SERVICE: Final = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
"""Quality of service of services. With the default depth, more than ten simultaneous requests would
lose responses."""

STATE: Final = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)

ACTUATOR_TOPICS: Final = {
    DESCRIPTION: (ActuatorDescription, LATCHED),
    SIMULATED_FAULTS: (FaultVectorStamped, LATCHED),
    TELEMETRY: (TelemetryBlock, STREAM),
    JOINT_STATES: (JointState, STATE),
    USAGE: (Usage, LATCHED),
}
"""Message class and quality of service of a simulated actuator's topics, by name."""

SYSTEM_TOPICS: Final = {MEASURED_CAUSES: (MeasuredCauses, STREAM)}
"""Message class and quality of service of topics that external systems publish for a monitor."""

MONITOR_TOPICS: Final = {
    FAULT_ESTIMATE: (FaultEstimate, STATE),
    HEALTH: (Health, ALIVE),
    HEALTH_SUMMARY: (HealthSummary, LATCHED),
    HEALTH_FORECAST: (HealthForecast, LATCHED),
    ADVICE: (Advice, LATCHED),
    WINDOW_FIT: (WindowFit, LATCHED),
    BASELINE: (BaselineStatus, LATCHED),
    FRICTION_CURVE: (FrictionCurve, LATCHED),
}
"""Message class and quality of service of a monitor's topics, by name."""

PLAYER_TOPICS: Final = {PLAYBACK_STATE: (PlaybackState, LATCHED)}
"""Message class and quality of service of a player's own topics, by name."""

NODE_TOPICS: Final = {NODE_STATUS: (NodeStatus, STATE)}
"""Message class and quality of service of topics common to all nodes, by name."""
