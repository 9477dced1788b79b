# SPDX-License-Identifier: Apache-2.0
"""Detection of implausible telemetry: samples that the described motor cannot produce."""

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
    """Return a message about samples that the described motor cannot produce, or "".

    A position step is impossible if it exceeds both ten times the usual step and twice the step at
    top speed. A speed peak of a single sample is impossible if it exceeds 1.5 times the speed
    change that the largest torque causes.
    """
    h, top = telemetry.sample_period, parameters.top_speed
    parts: list[str] = []
    steps = np.abs(np.diff(telemetry.position))
    if len(steps):
        usual = float(np.percentile(steps, _USUAL_SHARE))
        far = max(_TOP_SPEEDS * top * parameters.tau * h, _USUAL_STEPS * usual)
        if count := int(np.count_nonzero(steps > far)):
            parts.append(
                f"the position jumps {counted(count, 'time')}, by up to {steps.max():.4g} rad in "
                f"{h:g} s, and the motor can turn it by {top * parameters.tau * h:.4g} rad"
            )
    if len(telemetry.speed) > 2:
        changes = np.diff(telemetry.speed)
        off = np.minimum(np.abs(changes[:-1]), np.abs(changes[1:]))
        limit = _TORQUES * parameters.T_max / parameters.J_m * h
        if count := int(np.count_nonzero((off > limit) & (changes[:-1] * changes[1:] < 0.0))):
            parts.append(
                f"the speed is wrong for one sample {counted(count, 'time')}, by up to "
                f"{off.max():.4g} rad/s, and the motor can change it by "
                f"{limit / _TORQUES:.4g} rad/s"
            )
    return f"impossible samples: {'; '.join(parts)}: repair the telemetry" if parts else ""
