# SPDX-License-Identifier: Apache-2.0
"""Topic names of actuator, monitor and player, without a dependency on ROS."""

from typing import Final

TELEMETRY: Final = "telemetry"
DESCRIPTION: Final = "actuator_description"
SIMULATED_FAULTS: Final = "simulated_faults"
JOINT_STATES: Final = "joint_states"
JOINT_COMMANDS: Final = "joint_commands"
ROBOT_DESCRIPTION: Final = "robot_description"
PAYLOAD: Final = "payload"
TRUE_FRICTION: Final = "true_friction"
USAGE: Final = "usage"
MEASURED_CAUSES: Final = "measured_causes"
FAULT_ESTIMATE: Final = "fault_estimate"
HEALTH: Final = "health"
HEALTH_SUMMARY: Final = "health_summary"
HEALTH_FORECAST: Final = "health_forecast"
ADVICE: Final = "advice"
WINDOW_FIT: Final = "window_fit"
BASELINE: Final = "baseline"
FRICTION_CURVE: Final = "friction_curve"
PLAYBACK_STATE: Final = "playback_state"
NODE_STATUS: Final = "node_status"

ROBOT_TOPICS: Final = (JOINT_STATES, JOINT_COMMANDS, PAYLOAD, ROBOT_DESCRIPTION, TRUE_FRICTION)
"""Topics of a simulated robot arm."""

NAMESPACE: Final = "/ema"
