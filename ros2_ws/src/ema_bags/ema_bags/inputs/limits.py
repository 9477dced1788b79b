# SPDX-License-Identifier: Apache-2.0
"""Physical limits on position steps, speeds and currents, in source units."""

import math
from typing import Final

from ema_bags.inputs.mapping import AngleSource, ColumnMapping, SpeedSource
from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters
from ema_core.units import CURRENTS, LINEAR, UNITS

_TOP_SPEEDS: Final = 2.0
_LIMITS: Final = 3.0


def limits_of(
    mapping: ColumnMapping, description: ActuatorDescription, period: float
) -> dict[str, float]:
    """Return the largest possible position step, speed and current, for ``ImpossibleSamples``.

    The limits are in source units. Quantities without a known limit are omitted.

    Parameters
    ----------
    period
        Sample period [s].
    """
    if not description.is_modelled:
        return {}
    parameters = description.parameters
    top = parameters.top_speed
    limits: dict[str, float] = {}
    angle = _size(mapping.position, parameters)
    if angle:
        limits["position"] = _TOP_SPEEDS * top * period / angle
    if mapping.speed and not mapping.speed.encoding and (size := _size(mapping.speed, parameters)):
        limits["speed"] = _LIMITS * top / size
    current = mapping.measured_current
    if current and not current.encoding and current.unit in CURRENTS:
        limits["current"] = _LIMITS * parameters.I_max / (abs(current.scale) * UNITS[current.unit])
    return limits


def _size(source: AngleSource | SpeedSource, parameters: ActuatorParameters) -> float:
    """Return motor angle [rad] or speed [rad/s] per source unit; 0 if unknown."""
    size = abs(source.scale) * UNITS[source.unit]
    if source.unit in LINEAR:
        size *= 2.0 * math.pi / lead if (lead := source.lead or parameters.lead) else 0.0
    return size if source.shaft == "motor" else size / parameters.tau
