# SPDX-License-Identifier: Apache-2.0
"""Identity and nominal data of an actuator."""

from dataclasses import dataclass, field
from typing import Final

from ema_core.acquisition import Acquisition
from ema_core.consistency import remarks, standstill
from ema_core.expecting import require_type
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import check_period
from ema_core.wording import unknown_name

UNKNOWN_DRIVE: Final = "unknown"
"""Name of a drive without a model."""

DRIVES: Final = ("six_step", "field_oriented", UNKNOWN_DRIVE)
"""Types of drive: six-step commutation with current hysteresis, field-oriented control of a
sinusoidal motor, or an unknown controller."""

LONGEST_NAME: Final = 100
"""Largest number of characters in an id, a serial number or a model."""

SAMPLE_PERIOD = 1e-4
"""Default period of the telemetry [s]."""

UnitKey = tuple[str, str]
"""``actuator_id`` and ``serial_number`` of a unit."""


@dataclass(frozen=True)
class ActuatorDescription:
    """Identity and nominal data of an actuator; the default is the built-in example.

    Raises
    ------
    ValueError
        If the id, serial number or model is not a valid name, ``parameters`` or ``acquisition`` has
        a wrong type, the period is outside ``ema_core.telemetry.PERIODS``, the drive is not one of
        ``DRIVES`` or needs a command that is missing, or the motor is too weak for its friction.
    """

    actuator_id: str = "flap"
    """Name of the actuator in its system."""
    serial_number: str = "SIM-0001"
    """Serial number of the installed unit."""
    model: str = "bldc-flap-actuator"
    """Manufacturer's type designation."""
    sample_period: float = SAMPLE_PERIOD
    """Sample period of the telemetry [s]."""
    parameters: ActuatorParameters = field(default_factory=ActuatorParameters)
    drive: str = "six_step"
    """One of ``DRIVES``."""
    acquisition: Acquisition = field(default_factory=Acquisition)
    """Acquisition of the telemetry."""

    @property
    def unit_key(self) -> UnitKey:
        """Actuator id and serial number, the key of the unit's stored data."""
        return self.actuator_id, self.serial_number

    @property
    def is_modelled(self) -> bool:
        """Whether a model of the drive exists.

        Without a model, records are only compared with healthy records.
        """
        return self.drive != UNKNOWN_DRIVE

    def __post_init__(self) -> None:
        for name in ("actuator_id", "serial_number", "model"):
            value = getattr(self, name)
            if value or name != "model":
                check_name(name, value)
        require_type("parameters", self.parameters, ActuatorParameters)
        require_type("acquisition", self.acquisition, Acquisition)
        if self.drive not in DRIVES:
            raise ValueError(unknown_name("drive", self.drive, DRIVES))
        check_period(self.sample_period)
        object.__setattr__(self, "sample_period", float(self.sample_period))
        if self.is_modelled and not self.acquisition.command:
            raise ValueError(
                f"no position command with drive = {self.drive}: expected a command, or drive = "
                f"{UNKNOWN_DRIVE}"
            )
        if reason := standstill(self.parameters, self.drive):
            raise ValueError(reason)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about coupled parameters that contradict each other."""
        return remarks(self.parameters, self.drive)


def check_name(what: str, name: object) -> None:
    """Raise ``ValueError`` unless ``name`` is a valid id, serial number or model.

    A valid name has 1 to 100 printable characters and no leading or trailing blanks. ``what`` names
    the value in the error message.
    """
    if not isinstance(name, str) or not name:
        raise ValueError(f"{what} = {name!r}: expected a name (string)")
    if len(name) > LONGEST_NAME:
        raise ValueError(
            f"{what} = {name[:20]!r}...: {len(name)} characters, expected at most {LONGEST_NAME}"
        )
    if not name.isprintable() or name != name.strip():
        raise ValueError(
            f"{what} = {name!r}: expected printable characters, without blanks at the ends"
        )
