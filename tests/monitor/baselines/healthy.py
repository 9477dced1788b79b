# SPDX-License-Identifier: Apache-2.0
"""Records of a joint at 100 Hz, healthy or with more friction."""

import numpy as np

from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_monitor.joint.record import NS_A_DAY
from ema_monitor.windows.window import Window

JOINT = ActuatorDescription("elbow/1", "7", sample_period=1e-2, drive="unknown")
START_NS = 1_700_000_000_000_000_000
MINUTE_NS = 60_000_000_000


def record(
    number: int,
    day: int = 0,
    friction: float = 1.0,
    offset: float = 0.0,
    description: ActuatorDescription = JOINT,
) -> Window:
    """Return 30 s of motion, a minute after the previous record.

    Friction scatters by 1 %, as for a healthy joint.
    """
    rng = np.random.default_rng(number)
    period = description.sample_period
    time = np.arange(0.0, 30.0, period)
    pace = 2.0 * np.pi * (0.2 + 0.01 * rng.standard_normal())
    position = 0.5 * np.sin(pace * time) + 0.25 * np.sin(2.3 * pace * time)
    speed = np.gradient(position, period)
    dry = 0.8 * friction * (1.0 + 0.01 * rng.standard_normal())
    effort = dry * np.tanh(speed / 0.02) + 0.3 * speed + 0.1 * np.gradient(speed, period)
    effort += 0.05 + 0.02 * rng.standard_normal(len(time))
    stamp_ns = START_NS + day * NS_A_DAY + number * MINUTE_NS
    motor_speed = speed / description.parameters.tau
    place = position + offset
    return Window(Telemetry(stamp_ns, period, 0, place, effort, place, motor_speed))
