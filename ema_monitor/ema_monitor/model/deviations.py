# SPDX-License-Identifier: Apache-2.0
"""Deviations of a unit or a window from the nominal model, other than faults.

A calibration fits the deviations of a unit to healthy windows. Deviations that may change between
windows are hidden causes, which compete with faults as explanations of a window.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from ema_core.arrays import Array
from ema_core.causes import CAUSE_BY_NAME, COPPER, Cause, SystemPart
from ema_core.faults import eccentricity_vector, with_eccentricity
from ema_core.parameters import ActuatorParameters, PlantConstants


class Deviations(NamedTuple):
    """Deviations of a unit or window from the nominal model, for which each deviation is 0.

    The first seven and the last six are hidden causes (`ema_core.causes`). ``lift`` is the lift of
    the idle phase [A] and ``loop_delay`` the delay of the current loop [s] (M12);
    ``stribeck_speed`` [rad/s] belongs to the friction (M12a). ``friction``, ``backlash``,
    ``loop_gain`` and ``speed_loop`` are relative to the dry friction, the play, ``G_prop`` and
    ``GAP``; ``turns_a`` to ``turns_c`` are relative to the turns of the phases. The eccentricity is
    a vector.
    """

    load_torque: float = 0.0
    load_stiffness: float = 0.0
    torque_constant: float = 0.0
    winding_temperature: float = 0.0
    supply_voltage: float = 0.0
    viscous_friction: float = 0.0
    inertia: float = 0.0
    lift: float = 0.0
    loop_delay: float = 0.0
    friction: float = 0.0
    stribeck_speed: float = 0.0
    backlash: float = 0.0
    loop_gain: float = 0.0
    speed_loop: float = 0.0
    turns_a: float = 0.0
    turns_b: float = 0.0
    turns_c: float = 0.0
    eccentricity_cos: float = 0.0
    eccentricity_sin: float = 0.0
    current_offset: float = 0.0
    current_gain: float = 0.0
    speed_offset: float = 0.0
    speed_gain: float = 0.0
    current_delay: float = 0.0
    speed_delay: float = 0.0

    @classmethod
    def of(cls, values: ArrayLike) -> Self:
        """Return the deviations from an array, ``(25,)``."""
        return cls(*np.asarray(values, dtype=np.float64).tolist())


NAMES: Final = Deviations._fields
N_DEVIATIONS: Final = len(NAMES)
N_SENSOR: Final = 6
"""Number of sensor errors, which are the last deviations and do not affect the motion."""

READINGS: Final = ("command_delay", "position_offset", "position_gain")
"""Hidden causes that affect the inputs of the model: command and initial position."""

COLUMNS: Final = (*NAMES, *READINGS)
"""Names of the deviations of a window: deviations of the unit, then errors of the readings."""

HIDDEN_CAUSES: Final = (*NAMES[:7], *NAMES[-N_SENSOR:], *READINGS)
"""Names of the deviations that may change between two windows."""


USUAL_SIGMA: Final = {
    "torque_constant": 0.05,
    "inertia": 0.1,
    "current_gain": 0.02,
    "speed_gain": 0.01,
    "position_gain": 0.01,
}
"""Typical change between two tests, for causes that hardly vary in a healthy unit [-]."""

_NEVER_NEGATIVE: Final = ("loop_delay", "stribeck_speed")
# Sensor errors have heavy tails, because a failed sensor may have any reading. If the tails began
# closer to the centre, sensor offsets would explain loads.
_TAIL: Final = 2.5


class Prior(NamedTuple):
    """Prior of a deviation, in the unit of the deviation.

    The density is normal up to ``tail`` standard deviations. Beyond, it decreases as a power of the
    distance, so that outliers are possible.
    """

    name: str
    expected: float
    """Expected value."""
    sigma: float
    """Standard deviation."""
    reach: float
    """Upper bound; for a measured cause, largest distance from ``expected``."""
    lowest: float
    """Lower bound."""
    tail: float = math.inf
    """Number of standard deviations at which the tail begins [-]."""

    @property
    def cause(self) -> Cause:
        """Hidden cause with the name of the deviation."""
        return CAUSE_BY_NAME[self.name]

    @property
    def column(self) -> str:
        """Published column that the deviation changes; empty if it changes the motion."""
        cause = CAUSE_BY_NAME.get(self.name)
        return cause.column if cause else ""


def hidden_causes(parameters: ActuatorParameters, travel: float) -> tuple[Prior, ...]:
    """Return the priors of all hidden causes.

    Parameters
    ----------
    parameters
        Nominal parameters. Priors of loads and offsets are proportional to the actuator's limits.
    travel
        Travel of the command, from end to end [rad], to which the prior of the load stiffness is
        inversely proportional.

    Notes
    -----
    The priors cover the changes of a healthy unit between two tests: loads up to a third of the
    torque limit, magnets and inertia within about 5 %, a winding 100 K warmer, viscous friction
    doubled by cold, sensors within their data sheets, a command published one bus cycle late (about
    0.5 ms), and a position within 0.02 % of the full stroke.
    """
    T, I, omega = parameters.T_max, parameters.I_max, parameters.omega_max
    stroke = parameters.theta_stop
    priors = {
        "load_torque": (0.2 * T, 0.8 * T),
        "load_stiffness": (0.2 * T / travel, 0.8 * T / travel),
        "torque_constant": (USUAL_SIGMA["torque_constant"], 0.3),
        "winding_temperature": (50.0, 200.0),
        "supply_voltage": (0.1, 0.5),
        "viscous_friction": (1.0, 10.0),
        "inertia": (USUAL_SIGMA["inertia"], 0.6),
        "current_offset": (0.005 * I, 0.4 * I),
        "current_gain": (USUAL_SIGMA["current_gain"], 0.45),
        "speed_offset": (0.005 * omega, 0.4 * omega),
        "speed_gain": (USUAL_SIGMA["speed_gain"], 0.3),
        "current_delay": (1e-4, 4e-3),
        "speed_delay": (1e-4, 4e-3),
        "command_delay": (5e-4, 5e-3),
        "position_offset": (2e-4 * stroke, 8e-3 * stroke),
        "position_gain": (USUAL_SIGMA["position_gain"], 0.3),
    }
    normal = (_prior(name, *priors[name]) for name in HIDDEN_CAUSES)
    return tuple(
        prior._replace(tail=_TAIL) if prior.cause.place == SystemPart.SENSOR else prior
        for prior in normal
    )


def unit_priors(
    parameters: ActuatorParameters, travel: float, form: str = "fast"
) -> tuple[Prior, ...]:
    """Return the priors of the deviations that a calibration fits.

    Parameters
    ----------
    parameters
        Nominal parameters of the actuator.
    travel
        Travel of the command, from end to end [rad].
    form
        Form of the model. Only the fast form has idle phases, whose ripple is the lift.

    Notes
    -----
    Only ratios of torque constant, friction, inertia and current sensor gain are observable.
    Therefore torque constant and gain are not fitted. Resistance and supply voltage only have an
    effect if the voltage limits the current, which does not occur in healthy tests.
    """
    T, I, omega = parameters.T_max, parameters.I_max, parameters.omega_max
    lift = parameters.h_b / 4.0
    priors = {
        "load_torque": (0.01 * T, 0.8 * T),
        "load_stiffness": (0.01 * T / travel, 0.8 * T / travel),
        "viscous_friction": (0.5, 20.0),
        "inertia": (0.1, 0.5),
        "lift": (lift / 3.0, 4.0 * lift),
        "loop_delay": (1e-5, 1e-4),
        "friction": (0.1, 1.0),
        "stribeck_speed": (2.0, 50.0),
        "backlash": (0.03, 0.9),
        "loop_gain": (0.05, 0.5),
        "speed_loop": (0.05, 0.5),
        "turns_a": (0.02, 0.2),
        "turns_b": (0.02, 0.2),
        "turns_c": (0.02, 0.2),
        "eccentricity_cos": (0.02, 0.3),
        "eccentricity_sin": (0.02, 0.3),
        "current_offset": (0.005 * I, 0.1 * I),
        "speed_offset": (0.005 * omega, 0.1 * omega),
        "speed_gain": (0.005, 0.2),
        "current_delay": (5e-5, 3e-3),
        "speed_delay": (5e-5, 3e-3),
    }
    if form != "fast":
        del priors["lift"]
    return tuple(_prior(name, *priors[name]) for name in NAMES if name in priors)


def _prior(name: str, sigma: float, reach: float) -> Prior:
    cause = CAUSE_BY_NAME.get(name)
    lowest = max(-reach, cause.lowest) if cause and cause.unit == "-" else -reach
    if name in _NEVER_NEGATIVE:
        lowest = 0.0
    # The ripple of the idle phase fills the hysteresis band. Its mean magnitude is half of the
    # band, and half of the magnitude is part of the equivalent current.
    return Prior(name, 3.0 * sigma if name == "lift" else 0.0, sigma, reach, lowest)


def deviating(plant: PlantConstants, deviations: Array) -> PlantConstants:
    """Return plant constants changed by the deviations of individuals, ``(m, 25)``.

    Load, lift, loop delay, Stribeck speed, eccentricity and sensor errors are applied elsewhere.
    """
    factors = Deviations(*(1.0 + deviations.T))  # pyright: ignore[reportArgumentType]
    warmer = deviations[:, NAMES.index("winding_temperature")]
    control, motor, mechanics = plant
    return PlantConstants(
        control._replace(
            G_prop=control.G_prop * factors.loop_gain, GAP=control.GAP * factors.speed_loop
        ),
        motor._replace(
            k_e=motor.k_e * factors.torque_constant,
            G_M=motor.G_M * factors.torque_constant,
            R_s=motor.R_s * (1.0 + COPPER * warmer),
            V_max=motor.V_max * factors.supply_voltage,
            N_a=motor.N_a * factors.turns_a,
            N_b=motor.N_b * factors.turns_b,
            N_c=motor.N_c * factors.turns_c,
        ),
        mechanics._replace(
            C=mechanics.C * factors.viscous_friction,
            J=mechanics.J * factors.inertia,
            f_s=mechanics.f_s * factors.friction,
            f_d=mechanics.f_d * factors.friction,
            half_backlash=mechanics.half_backlash * factors.backlash,
        ),
    )


def with_unit_eccentricity(faults: Array, deviations: Array) -> Array:
    """Return fault vectors, ``(m, 8)``, with the eccentricity of the healthy units added."""
    d = Deviations(*deviations.T)  # pyright: ignore[reportArgumentType]
    healthy = np.stack([d.eccentricity_cos, d.eccentricity_sin])
    if not np.any(healthy):
        return faults
    return with_eccentricity(faults, eccentricity_vector(faults) + healthy)


def sensed(rows: Sequence[Array], deviations: Array, h: float) -> list[Array]:
    """Return current and speed with sensor errors, ``(m, n)`` each.

    Parameters
    ----------
    rows
        Current and speed, ``(m, n)`` each.
    deviations
        Sensor errors, ``(m, 6)``.
    h
        Sample period [s].
    """
    offsets, gains, delays = deviations[:, 0:4:2], deviations[:, 1:4:2], deviations[:, 4:]
    result = []
    for number, row in enumerate(rows):
        offset, gain, delay = (part[:, number, None] for part in (offsets, gains, delays))
        readings = row * (1.0 + gain) + offset
        # Shift only rows with a delay, because shifting is slow and most rows have none.
        for number in np.flatnonzero(delay):
            shifted = _shifted(row[number], float(delay[number, 0]) / h)
            readings[number] = shifted * (1.0 + gain[number]) + offset[number]
        result.append(readings)
    return result


def _shifted(row: Array, samples: float) -> Array:
    """Return a row, ``(n,)``, delayed by a number of samples, with linear interpolation.

    The row is constant before its start, and extrapolated after its end.
    """
    at = np.maximum(np.arange(len(row)) - samples, 0.0)
    below = np.minimum(at.astype(int), len(row) - 2)
    return row[below] + (at - below) * (row[below + 1] - row[below])
