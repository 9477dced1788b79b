"""Conversion of actuator descriptions to and from ema_interfaces/ActuatorDescription."""

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from ema_core.acquisition import CURRENT_SAMPLINGS, Acquisition
from ema_core.description import DRIVES, ActuatorDescription
from ema_core.parameters import ActuatorParameters
from ema_ros.stamps import stamp_to_message

if TYPE_CHECKING:
    from ema_interfaces.msg import ActuatorDescription as DescriptionMessage

IDENTITY: Final = ("actuator_id", "serial_number", "model", "sample_period")
"""Fields with the same name in the description and its message."""

PARAMETER_FIELDS: Final = MappingProxyType(
    {
        "G_prop": "position_gain",
        "GAP": "speed_p",
        "GAI": "speed_i",
        "GAD": "speed_d",
        "omega_max": "speed_reference_limit",
        "V_max": "supply_voltage",
        "I_max": "current_limit",
        "T_max": "torque_limit",
        "k_t": "torque_constant",
        "k_e": "back_emf_constant",
        "G_M": "monitor_torque_gain",
        "R_s": "resistance",
        "L_s": "inductance",
        "P": "pole_pairs",
        "h_b": "current_hysteresis",
        "J_m": "motor_inertia",
        "J_u": "user_inertia",
        "C_m": "motor_viscous_damping",
        "C_u": "user_viscous_damping",
        "f_sm": "motor_static_friction",
        "f_su": "user_static_friction",
        "f_ratio": "dynamic_friction_ratio",
        "BLK": "backlash",
        "tau": "gear_ratio",
        "theta_stop": "end_stop",
        "omega_c": "current_bandwidth",
    }
)
"""Field of the message for each parameter."""


def description_to_message(
    description: ActuatorDescription, stamp_ns: int = 0
) -> "DescriptionMessage":
    """Return a description as a message.

    Parameters
    ----------
    stamp_ns
        When the description was made [ns]; 0 when unknown.

    Raises
    ------
    ValueError
        When the stamp is out of range.
    """
    from ema_interfaces.msg import ActuatorDescription as DescriptionMessage  # as in stamps

    message = DescriptionMessage()
    message.header.stamp = stamp_to_message(stamp_ns)
    for name in IDENTITY:
        setattr(message, name, getattr(description, name))
    message.sample_period = float(description.sample_period)
    message.drive = DRIVES.index(description.drive)
    acquisition = description.acquisition
    message.current_sampling = CURRENT_SAMPLINGS.index(acquisition.current)
    message.current_filter_time = acquisition.current_filter
    message.speed_measured = acquisition.speed
    for name, field in PARAMETER_FIELDS.items():
        setattr(message, field, getattr(description.parameters, name))
    return message


def description_from_message(message: "DescriptionMessage") -> ActuatorDescription:
    """Return the description in a message, of an older definition as well (read without ROS).

    Raises
    ------
    ValueError
        When a parameter is impossible, the id or serial number is empty, the period is not
        positive or a constant is unknown.
    """
    parameters = {name: getattr(message, field) for name, field in PARAMETER_FIELDS.items()}
    return ActuatorDescription(
        **{name: getattr(message, name) for name in IDENTITY},
        drive=_named("drive", getattr(message, "drive", 0), DRIVES),
        acquisition=Acquisition(
            _named("current_sampling", getattr(message, "current_sampling", 0), CURRENT_SAMPLINGS),
            getattr(message, "current_filter_time", 0.0),
            bool(getattr(message, "speed_measured", True)),
        ),
        parameters=ActuatorParameters(**parameters),
    )


def _named(field: str, value: int, names: tuple[str, ...]) -> str:
    """Return what a constant of the message stands for."""
    if value >= len(names):
        raise ValueError(f"{field} = {value}: expected a constant of 0 to {len(names) - 1}")
    return names[value]
