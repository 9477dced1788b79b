"""Units of what other makes publish, in SI units."""

import math
from typing import Final

ANGLES: Final = {
    "rad": 1.0,
    "deg": math.pi / 180.0,
    "mrad": 1e-3,
    "turn": 2.0 * math.pi,
    "arcmin": math.pi / 10800.0,
}
"""Units of an angle [rad]."""

SPEEDS: Final = {
    "rad/s": 1.0,
    "deg/s": math.pi / 180.0,
    "rpm": 2.0 * math.pi / 60.0,
    "turn/s": 2.0 * math.pi,
    "mrad/s": 1e-3,
}
"""Units of a speed [rad/s]."""

LENGTHS: Final = {"mm": 1e-3, "m": 1.0, "um": 1e-6, "in": 25.4e-3}
"""Units of the way of a linear actuator [m]; its lead makes an angle of it."""

LINEAR_SPEEDS: Final = {"mm/s": 1e-3, "m/s": 1.0}
"""Units of the speed of a linear actuator [m/s]."""

CURRENTS: Final = {"A": 1.0, "mA": 1e-3}
"""Units of a current [A]."""

TORQUES: Final = {"N.m": 1.0, "mN.m": 1e-3, "N.cm": 1e-2}
"""Units of a torque [N.m]."""

TIMES_NS: Final = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
"""Units of a time [ns]."""
