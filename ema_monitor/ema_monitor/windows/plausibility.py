# SPDX-License-Identifier: Apache-2.0
"""Detection of implausible telemetry: samples that the described motor cannot produce."""

from typing import Final

import numpy as np

from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.reasons import ImpossibleSamples

_TOP_SPEEDS: Final = 2.0
_TORQUES: Final = 1.5
_USUAL_STEPS: Final = 10.0
_USUAL_SHARE: Final = 98.0


def impossible_motion(
    telemetry: Telemetry, parameters: ActuatorParameters
) -> ImpossibleSamples | None:
    """Return number and size of the samples that the described motor cannot produce, or None.

    A position step is impossible if it exceeds both ten times the usual step and twice the step at
    top speed. A speed peak of a single sample is impossible if it exceeds 1.5 times the speed
    change that the largest torque causes.
    """
    h, top = telemetry.sample_period, parameters.top_speed
    steps = np.abs(np.diff(telemetry.position))
    jumps = spikes = 0
    largest_jump = largest_spike = 0.0
    if len(steps):
        usual = float(np.percentile(steps, _USUAL_SHARE))
        far = max(_TOP_SPEEDS * top * parameters.tau * h, _USUAL_STEPS * usual)
        jumps, largest_jump = int(np.count_nonzero(steps > far)), float(steps.max())
    limit = _TORQUES * parameters.T_max / parameters.J_m * h
    if len(telemetry.speed) > 2:
        changes = np.diff(telemetry.speed)
        off = np.minimum(np.abs(changes[:-1]), np.abs(changes[1:]))
        spikes = int(np.count_nonzero((off > limit) & (changes[:-1] * changes[1:] < 0.0)))
        largest_spike = float(off.max())
    if not (jumps or spikes):
        return None
    possible = top * parameters.tau * h, limit / _TORQUES
    return ImpossibleSamples(
        jumps, largest_jump, possible[0], h, spikes, largest_spike, possible[1]
    )
