"""Who an actuator is, and what its maker says of it."""

from dataclasses import dataclass, field

from ema_core.parameters import ActuatorParameters
from ema_core.quantity import is_finite_number
from ema_core.telemetry import PERIODS

SAMPLE_PERIOD = 1e-4
"""Default period of the telemetry [s]."""


@dataclass(frozen=True)
class ActuatorDescription:
    """Identity and nominal data of an actuator; the default is the built-in example.

    Attributes
    ----------
    actuator_id
        Name of the actuator in its system.
    serial_number
        Serial number of the unit fitted.
    model
        The maker's type designation.
    sample_period
        Period of its telemetry [s].
    parameters
        Nominal parameters.

    Raises
    ------
    ValueError
        When the id or serial number is empty or the period is outside ``PERIODS``.
    """

    actuator_id: str = "flap"
    serial_number: str = "SIM-0001"
    model: str = "bldc-flap-actuator"
    sample_period: float = SAMPLE_PERIOD
    parameters: ActuatorParameters = field(default_factory=ActuatorParameters)

    def __post_init__(self) -> None:
        for name in ("actuator_id", "serial_number", "model"):
            value = getattr(self, name)
            if not isinstance(value, str) or (not value and name != "model"):
                raise ValueError(f"{name} = {value!r}: expected a name (text)")
        shortest, longest = PERIODS
        is_number = is_finite_number(self.sample_period)
        if not is_number or not shortest <= self.sample_period <= longest:
            raise ValueError(
                f"sample_period = {self.sample_period!r} s is outside [{shortest:g}, {longest:g}] s"
            )
        object.__setattr__(self, "sample_period", float(self.sample_period))
