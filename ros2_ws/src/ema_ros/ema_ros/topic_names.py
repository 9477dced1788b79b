"""Topic names of actuator, monitor and player, without a dependency on ROS."""

from typing import Final

TELEMETRY: Final = "telemetry"
DESCRIPTION: Final = "actuator_description"
SIMULATED_FAULTS: Final = "simulated_faults"
JOINT_STATES: Final = "joint_states"
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

NAMESPACE: Final = "/ema"
