# SPDX-License-Identifier: Apache-2.0
"""Conversion of angle, speed and torque to mm, mm/s and N for linear actuators."""

import math
import re
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from ema_core.description import ActuatorDescription
from ema_core.faults import FAULT_BY_NAME
from ema_core.parameters import ActuatorParameters, unit_of
from ema_core.quantity import is_finite_number

_IN_SI: Final = {
    "mm": ("rad", 1e-3, -1),
    "mm/s": ("rad/s", 1e-3, -1),
    "N": ("N.m", 1.0, 1),
    "N.s/m": ("N.m.s/rad", 1.0, 2),
    "kg": ("kg.m^2", 1.0, 2),
}
"""SI unit, conversion factor, and exponent of the travel per radian, by unit."""

_WITH_UNIT: Final = re.compile(r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(mm/s|mm|N\.s/m|N|kg)")
_NEEDED: Final = {"lead": "the travel [m] for one turn of the user shaft", "tau": "the gear ratio"}


class DisplayUnit(NamedTuple):
    """Unit in which a quantity is displayed, and its scale (displayed units per SI unit)."""

    unit: str
    scale: float

    def text(self, value: float) -> str:
        """Return a value, given in SI units, as a string with the displayed unit."""
        return f"{self.scale * value:.4g} {self.unit}"


def travel_shown(parameters: ActuatorParameters) -> DisplayUnit:
    """Return the unit for small angles of the user shaft: mrad, or mm for a linear actuator."""
    return (
        DisplayUnit("mm", 1e3 * _travel(parameters.lead))
        if parameters.lead
        else DisplayUnit("mrad", 1e3)
    )


def angle_shown(parameters: ActuatorParameters) -> DisplayUnit:
    """Return the unit for large angles of the user shaft: rad, or mm for a linear actuator."""
    return (
        DisplayUnit("mm", 1e3 * _travel(parameters.lead))
        if parameters.lead
        else DisplayUnit("rad", 1.0)
    )


def motor_shown(parameters: ActuatorParameters) -> DisplayUnit:
    """Return the unit for angles of the motor: rad, or mm at the rod for a linear actuator."""
    if not parameters.lead:
        return DisplayUnit("rad", 1.0)
    return DisplayUnit("mm", 1e3 * _travel(parameters.lead) * parameters.tau)


def physical(name: str, k: float, description: ActuatorDescription) -> str:
    """Return a fault's physical value as a string; for a linear actuator, also in N or mm.

    For friction, the string also contains the increase over the nominal friction as a force at the
    rod, except for an unknown drive, which has no nominal friction. The string is empty if ``name``
    is not a fault.
    """
    fault, p = FAULT_BY_NAME.get(name), description.parameters
    if fault is None:
        return ""
    text, growth = fault.physical(k), fault.slope * (k - fault.healthy)
    if p.lead and name == "friction" and description.is_modelled:
        text += f", {growth * (p.f_sm + p.f_su) / (_travel(p.lead) * p.tau):+.3g} N"
    elif p.lead and name == "backlash":
        text += f", {motor_shown(p).scale * growth * p.BLK:+.3g} mm"
    return text


def in_si(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of an actuator file, converted to SI units.

    A string with a unit, such as "60 mm", needs the parameters ``lead`` and ``tau``.

    Raises
    ------
    ValueError
        If a unit does not fit its parameter, or ``lead`` or ``tau`` is missing.
    """
    converted = dict(values)
    texts = {
        name: match.groups()
        for name, value in values.items()
        if isinstance(value, str) and (match := _WITH_UNIT.fullmatch(value.strip()))
    }
    if texts.get("lead", ("", ""))[1] == "mm":
        converted["lead"] = 1e-3 * float(texts.pop("lead")[0])
    for name, (number, unit) in texts.items():
        for needed, meaning in _NEEDED.items():
            present = converted.get(needed, "")
            if not is_finite_number(present) or not present > 0.0:
                raise ValueError(f"{name} = {values[name]} needs {meaning}: {needed} = {present}")
        si_unit, size, power = _IN_SI[unit]
        if unit_of(name) != si_unit:
            raise ValueError(f"{name} = {values[name]}: expected a value in {unit_of(name)}")
        travel = _travel(converted["lead"]) * (1.0 if name == "theta_stop" else converted["tau"])
        converted[name] = float(number) * size * travel**power
    return converted


def _travel(lead: float) -> float:
    """Return the travel per radian of the user shaft [m]."""
    return lead / (2.0 * math.pi)
