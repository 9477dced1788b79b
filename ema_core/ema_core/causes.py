# SPDX-License-Identifier: Apache-2.0
"""Registry of hidden causes: conditions other than faults that change telemetry.

The simulator applies them (equations in docs/model.md). The monitor considers some of them as
competing explanations. An absent cause has the value 0.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NamedTuple

COPPER: Final = 3.93e-3
"""Temperature coefficient of the resistance of copper [1/K]."""


class SystemPart(StrEnum):
    """Part of the system in which a hidden cause acts."""

    PLANT = "plant"
    """Motor, supply, mechanics or load; the cause changes the motion."""
    SENSOR = "sensor"
    """Sensor: the cause changes only a published column; the drive's loops use the true value."""
    DEFECT = "defect"
    """A failed part: faults cannot be estimated while it is present."""


@dataclass(frozen=True)
class Cause:
    """Definition of a hidden cause."""

    name: str
    """Name in code, messages and on the command line."""
    label: str
    """Displayed name."""
    unit: str
    """Unit of the value; "-" for a relative change or a switch."""
    lowest: float
    """Lowest value that can be simulated."""
    highest: float
    """Highest value that can be simulated."""
    place: SystemPart
    """Where the cause acts."""
    meaning: str
    """Meaning of the value."""
    column: str = ""
    """Published column that a cause in a sensor changes; empty for other causes."""


_PLANT = (
    ("load_torque", "load torque", "N.m", -10.0, 10.0, "torque against positive motion"),
    (
        "load_stiffness",
        "load stiffness",
        "N.m/rad",
        -1e3,
        1e3,
        "torque on the motor shaft per angle of the user shaft, against the angle",
    ),
    (
        "torque_constant",
        "torque constant",
        "-",
        -0.5,
        0.5,
        "relative change of torque and back-EMF constant: temperature and age of the magnets",
    ),
    (
        "winding_temperature",
        "winding temperature",
        "K",
        -150.0,
        250.0,
        "rise over the described temperature; the resistance rises by 0.393 %/K",
    ),
    ("supply_voltage", "supply voltage", "-", -0.9, 1.0, "relative change"),
    ("viscous_friction", "viscous friction", "-", -1.0, 1e3, "relative change"),
    ("inertia", "inertia", "-", -0.9, 100.0, "relative change"),
    ("dead_time", "dead time", "s", 0.0, 2e-5, "pause of a leg of the inverter when it switches"),
    ("cogging", "cogging", "N.m", 0.0, 1.0, "amplitude of the cogging torque"),
    (
        "stribeck",
        "Stribeck friction",
        "-",
        0.0,
        10.0,
        "rise of the friction towards standstill over the dynamic friction",
    ),
    (
        "friction_ripple",
        "friction ripple",
        "-",
        -1.0,
        1.0,
        "relative amplitude of the dry friction over a turn of the motor",
    ),
    ("supply_ripple", "supply ripple", "-", 0.0, 0.9, "relative amplitude, at 2400 Hz"),
)
_SENSOR = (
    ("current_offset", "current sensor offset", "A", -1e3, 1e3, "offset of the current", "current"),
    (
        "current_gain",
        "current sensor gain",
        "-",
        -2.0,
        1.0,
        "relative error of the current",
        "current",
    ),
    ("speed_offset", "speed sensor offset", "rad/s", -1e3, 1e3, "offset of the speed", "speed"),
    ("speed_gain", "speed sensor gain", "-", -2.0, 1.0, "relative error of the speed", "speed"),
    (
        "position_offset",
        "position sensor offset",
        "rad",
        -1.0,
        1.0,
        "offset of the position",
        "position",
    ),
    (
        "position_gain",
        "position sensor gain",
        "-",
        -2.0,
        1.0,
        "relative error of the position",
        "position",
    ),
    (
        "current_delay",
        "delay of the current",
        "s",
        0.0,
        0.1,
        "age of the published current",
        "current",
    ),
    ("speed_delay", "delay of the speed", "s", 0.0, 0.1, "age of the published speed", "speed"),
    (
        "command_delay",
        "delay of the command",
        "s",
        0.0,
        0.1,
        "age of the published command",
        "command",
    ),
)
_DEFECT = (
    ("open_phase_a", "open phase A", "-", 0.0, 1.0, "1: the phase carries no current"),
    ("open_phase_b", "open phase B", "-", 0.0, 1.0, "1: the phase carries no current"),
    ("open_phase_c", "open phase C", "-", 0.0, 1.0, "1: the phase carries no current"),
    ("dead_switch", "dead switch", "-", 0.0, 1.0, "1: the upper switch of leg A stays open"),
    ("jam", "jam", "-", 0.0, 1.0, "1: the motor shaft is blocked"),
)

CAUSES: Final = tuple(
    Cause(name, label, unit, lowest, highest, place, meaning, *column)
    for place, rows in (
        (SystemPart.PLANT, _PLANT),
        (SystemPart.SENSOR, _SENSOR),
        (SystemPart.DEFECT, _DEFECT),
    )
    for name, label, unit, lowest, highest, meaning, *column in rows
)
"""All hidden causes."""

CAUSE_BY_NAME: Final = {cause.name: cause for cause in CAUSES}


class CauseEstimate(NamedTuple):
    """Estimated or measured hidden cause.

    ``value`` and its standard deviation ``sigma`` are in the unit of the cause.
    """

    name: str
    value: float
    sigma: float

    def __str__(self) -> str:
        cause = CAUSE_BY_NAME[self.name]
        scale, unit = (100.0, "%") if cause.unit == "-" else (1.0, cause.unit)
        return f"{cause.label} {scale * self.value:+.3g} ± {scale * self.sigma:.2g} {unit}"
