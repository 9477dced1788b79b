# SPDX-License-Identifier: Apache-2.0
"""Units of telemetry mappings: size in SI units, keyed by the name of the unit."""

import math
from typing import Final

ANGLES: Final = {
    "rad": 1.0,
    "deg": math.pi / 180.0,
    "mrad": 1e-3,
    "turn": 2.0 * math.pi,
    "arcmin": math.pi / 10800.0,
}
SPEEDS: Final = {
    "rad/s": 1.0,
    "deg/s": math.pi / 180.0,
    "rpm": 2.0 * math.pi / 60.0,
    "turn/s": 2.0 * math.pi,
    "mrad/s": 1e-3,
}
LENGTHS: Final = {"mm": 1e-3, "m": 1.0, "um": 1e-6, "in": 25.4e-3}
LINEAR_SPEEDS: Final = {"mm/s": 1e-3, "m/s": 1.0}
LINEAR: Final = LENGTHS | LINEAR_SPEEDS
CURRENTS: Final = {"A": 1.0, "mA": 1e-3}
TORQUES: Final = {"N.m": 1.0, "mN.m": 1e-3, "N.cm": 1e-2}
FORCES: Final = {"N": 1.0, "kN": 1e3, "mN": 1e-3}
UNITS: Final = ANGLES | SPEEDS | LINEAR | CURRENTS | TORQUES | FORCES
"""Size of all units in SI units, keyed by name."""
