"""The unit whose life is simulated, and its calibration."""

from dataclasses import replace

from ema_core.description import ActuatorDescription
from ema_monitor.calibration.calibration import Calibration


def unit_of_life(seed: int, number: int) -> ActuatorDescription:
    """Return the built-in actuator with a serial number of its own.

    Parameters
    ----------
    seed, number
        Of the life.
    """
    built_in = ActuatorDescription()
    return replace(built_in, serial_number=f"{built_in.serial_number}-{seed}-{number:04d}")


def calibration_of_life(unit: ActuatorDescription) -> Calibration:
    """Return the calibration of a unit that is like the built-in actuator.

    Simulated units do not scatter: calibrated when new, each has the figures of the built-in one.

    Parameters
    ----------
    unit
        As of ``unit_of_life``.
    """
    return replace(Calibration.builtin(), serial_number=unit.serial_number)
