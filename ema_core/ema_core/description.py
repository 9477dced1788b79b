"""Identity and nominal data of an actuator."""

from dataclasses import dataclass, field

from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import check_period

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
        The manufacturer's type designation.
    sample_period
        Period of its telemetry [s].

    Raises
    ------
    ValueError
        When the id or serial number is empty or the period is outside
        ``ema_core.telemetry.PERIODS``.
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
        check_period(self.sample_period)
        object.__setattr__(self, "sample_period", float(self.sample_period))
