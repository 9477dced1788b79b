"""Linear actuators: conversion of angles, speeds and torques to mm, mm/s and N by the lead."""

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
"""By unit: the parameter's SI unit, the size, and the power of the travel per radian."""

_WITH_UNIT: Final = re.compile(r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(mm/s|mm|N\.s/m|N|kg)")
_NEEDED: Final = {"lead": "the travel [m] for one turn of the user shaft", "tau": "the gear ratio"}


class DisplayUnit(NamedTuple):
    """Unit in which a figure is shown, and its number per SI unit."""

    unit: str
    scale: float

    def text(self, value: float) -> str:
        """Return a value in SI units as a text."""
        return f"{self.scale * value:.4g} {self.unit}"


def travel_shown(parameters: ActuatorParameters) -> DisplayUnit:
    """Return the unit in which an angle of the user shaft is shown: mrad, or mm with a lead."""
    return (
        DisplayUnit("mm", 1e3 * _way(parameters.lead))
        if parameters.lead
        else DisplayUnit("mrad", 1e3)
    )


def angle_shown(parameters: ActuatorParameters) -> DisplayUnit:
    """Return the unit of a large angle of the user shaft: rad, or mm with a lead."""
    return (
        DisplayUnit("mm", 1e3 * _way(parameters.lead))
        if parameters.lead
        else DisplayUnit("rad", 1.0)
    )


def motor_shown(parameters: ActuatorParameters) -> DisplayUnit:
    """Return the unit of an angle of the motor: rad, or mm at the rod with a lead."""
    if not parameters.lead:
        return DisplayUnit("rad", 1.0)
    return DisplayUnit("mm", 1e3 * _way(parameters.lead) * parameters.tau)


def physical(name: str, k: float, description: ActuatorDescription) -> str:
    """Return the physical meaning of a fault, for a linear actuator also its growth in N or mm.

    The friction that grows is the nominal one, as a force at the rod; of an unknown drive nobody
    knows it. Empty for no fault.
    """
    fault, p = FAULT_BY_NAME.get(name), description.parameters
    if fault is None:
        return ""
    words, growth = fault.physical(k), fault.slope * (k - fault.healthy)
    if p.lead and name == "friction" and description.drive != "unknown":
        words += f", {growth * (p.f_sm + p.f_su) / (_way(p.lead) * p.tau):+.3g} N"
    elif p.lead and name == "backlash":
        words += f", {motor_shown(p).scale * growth * p.BLK:+.3g} mm"
    return words


def in_si(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters of a file in SI units: "60 mm" and the like by ``lead`` and ``tau``.

    Raises
    ------
    ValueError
        When a unit is not of the parameter, or lead or gear ratio is missing.
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
        for needed, what in _NEEDED.items():
            given = converted.get(needed, "")
            if not is_finite_number(given) or not given > 0.0:
                raise ValueError(f"{name} = {values[name]} needs {what}: {needed} = {given}")
        wanted, size, power = _IN_SI[unit]
        if unit_of(name) != wanted:
            raise ValueError(f"{name} = {values[name]}: expected a value in {unit_of(name)}")
        way = _way(converted["lead"]) * (1.0 if name == "theta_stop" else converted["tau"])
        converted[name] = float(number) * size * way**power
    return converted


def _way(lead: float) -> float:
    """Return the way for one radian of the user shaft [m]."""
    return lead / (2.0 * math.pi)
