"""Samples that no motor of a description can produce: the telemetry is wrong, not the actuator."""

from typing import Final

import numpy as np

from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_core.wording import counted

_TOP_SPEEDS: Final = 2.0
_TORQUES: Final = 1.5
_USUAL_STEPS: Final = 10.0
_USUAL_SHARE: Final = 98.0


def impossible_motion(telemetry: Telemetry, parameters: ActuatorParameters) -> str:
    """Return the samples that no motor of the description can produce; empty without any.

    These are a position that steps by more than twice the top speed allows and ten times its usual
    step, and a speed that for one sample is off by more than 1.5 times what the largest torque
    gives the inertia of the motor.
    """
    h, top = telemetry.sample_period, parameters.top_speed
    parts: list[str] = []
    steps = np.abs(np.diff(telemetry.position))
    if len(steps):
        usual = float(np.percentile(steps, _USUAL_SHARE))
        far = max(_TOP_SPEEDS * top * parameters.tau * h, _USUAL_STEPS * usual)
        if count := int(np.count_nonzero(steps > far)):
            parts.append(
                f"the position jumps {counted(count, 'time')}, at most by {steps.max():.4g} rad in "
                f"{h:g} s, and the motor turns it by {top * parameters.tau * h:.4g} rad"
            )
    if len(telemetry.speed) > 2:
        changes = np.diff(telemetry.speed)
        off = np.minimum(np.abs(changes[:-1]), np.abs(changes[1:]))
        limit = _TORQUES * parameters.T_max / parameters.J_m * h
        if count := int(np.count_nonzero((off > limit) & (changes[:-1] * changes[1:] < 0.0))):
            parts.append(
                f"the speed is off for one sample {counted(count, 'time')}, by {off.max():.4g} "
                f"rad/s at most, and the motor changes it by {limit / _TORQUES:.4g} rad/s"
            )
    return f"impossible samples: {'; '.join(parts)}: repair the telemetry" if parts else ""
