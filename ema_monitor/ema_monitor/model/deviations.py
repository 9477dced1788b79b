"""Deviations of a unit, or of a single window, from the nominal model that are not faults.

A calibration fits the deviations of a unit on healthy windows. Some may come and go between two
windows: these are the hidden causes that compete with faults to explain a window.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from ema_core.arrays import Array
from ema_core.causes import CAUSE_BY_NAME, COPPER, Cause, Place
from ema_core.faults import eccentricity_vector, with_eccentricity
from ema_core.parameters import ActuatorParameters, PlantConstants


class Deviations(NamedTuple):
    """Deviations by name; each is 0 for the nominal model.

    The first seven, and the last six, are hidden causes (`ema_core.causes`). ``lift`` is the lift
    of the idle phase [A] and ``loop_delay`` the delay of the current loop [s] (M12);
    ``stribeck_speed`` [rad/s] belongs to the friction (M12a); ``friction``, ``backlash``,
    ``loop_gain`` and ``speed_loop`` are relative to the dry friction, the play, ``G_prop`` and
    ``GAP``, and ``turns`` to the phases' turns; the eccentricity is a vector.
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
        """Return the deviations of an array, ``(25,)``."""
        return cls(*np.asarray(values, dtype=np.float64).tolist())


NAMES: Final = Deviations._fields
N_DEVIATIONS: Final = len(NAMES)
N_SENSOR: Final = 6
"""Number of sensor deviations, which come last: they do not change the motion."""

SENSOR_ERRORS: Final = ("offset", "gain", "delay")
"""What the sensor of a column may have, after the name of the column."""

READINGS: Final = ("command_delay", "position_offset", "position_gain")
"""Hidden causes of the model's input columns: the command and the initial position."""

COLUMNS: Final = (*NAMES, *READINGS)
"""Deviations of a window: the deviations of a unit, and the readings."""

HIDDEN_CAUSES: Final = (*NAMES[:7], *NAMES[-N_SENSOR:], *READINGS)
"""Deviations that may come and go between two windows."""


USUAL_SIGMA: Final = {
    "torque_constant": 0.05,
    "inertia": 0.1,
    "current_gain": 0.02,
    "speed_gain": 0.01,
    "position_gain": 0.01,
}
"""Usual change between two tests of causes that a healthy unit has within narrow bounds [-]."""

_NEVER_NEGATIVE: Final = ("loop_delay", "stribeck_speed")
# Of sensors: one that has failed may read anything. Narrower, offsets take the place of loads.
_TAIL: Final = 2.5


class Prior(NamedTuple):
    """A deviation as a parameter of a fit.

    What is ``expected`` of it, with which standard deviation ``sigma``, and the bounds ``lowest``
    and ``reach``, in its unit. It is normal up to ``tail`` sigma. Beyond, its density falls as a
    power of the distance: a value that is far from the expected one may occur.
    """

    name: str
    expected: float
    sigma: float
    reach: float
    lowest: float
    tail: float = math.inf

    @property
    def cause(self) -> Cause:
        """The hidden cause that it is."""
        return CAUSE_BY_NAME[self.name]


def hidden_causes(parameters: ActuatorParameters, travel: float) -> tuple[Prior, ...]:
    """Return all hidden causes that the model knows, with their priors.

    Load and current scale with the limits of the actuator. A load that follows the position is
    judged by the torque that it reaches in the travel of the command [rad].

    Notes
    -----
    The priors cover healthy units between two tests: loads up to a third of the
    torque limit, magnets and inertia within some 5 %, a winding 100 K warmer, a viscous friction
    that doubles in the cold, sensors within their data sheets; a command that is published a cycle
    of its bus late, some 0.5 ms; a position within 0.02 % of the full stroke.
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
    expected = (_prior(name, *priors[name]) for name in HIDDEN_CAUSES)
    return tuple(
        one._replace(tail=_TAIL) if one.cause.place == Place.SENSOR else one for one in expected
    )


def unit_priors(
    parameters: ActuatorParameters, travel: float, form: str = "fast"
) -> tuple[Prior, ...]:
    """Return the deviations that a calibration fits, with their priors.

    Only the fast form of the model has idle phases, whose ripple is the lift.

    Notes
    -----
    Of torque constant, friction, inertia and current sensor only the ratios show in the motion; the
    first and the last are kept. Resistance and supply show where the voltage limits the current,
    which no healthy test does.
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
    # The ripple of the idle phase fills the hysteresis band, its mean magnitude is half of that,
    # and the equivalent current counts the half of it.
    return Prior(name, 3.0 * sigma if name == "lift" else 0.0, sigma, reach, lowest)


def deviating(plant: PlantConstants, deviations: Array) -> PlantConstants:
    """Return the constants of plants that deviate, but for load, drive and Stribeck friction."""
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


def with_own_eccentricity(faults: Array, deviations: Array) -> Array:
    """Return fault vectors, ``(m, 8)``, with the eccentricity of healthy units added."""
    d = Deviations(*deviations.T)  # pyright: ignore[reportArgumentType]
    own = np.stack([d.eccentricity_cos, d.eccentricity_sin])
    if not np.any(own):
        return faults
    return with_eccentricity(faults, eccentricity_vector(faults) + own)


def sensed(rows: Sequence[Array], deviations: Array, h: float) -> list[Array]:
    """Return current and speed as deviating sensors show them, ``(m, n)`` each.

    ``deviations`` are the sensor deviations, ``(m, 6)``; ``h`` is the sample period [s].
    """
    offsets, gains, delays = deviations[:, 0:4:2], deviations[:, 1:4:2], deviations[:, 4:]
    result = []
    for number, row in enumerate(rows):
        offset, gain, delay = (part[:, number, None] for part in (offsets, gains, delays))
        seen = row * (1.0 + gain) + offset
        # Most rows of a linearisation have none, and it takes long.
        for number in np.flatnonzero(delay):
            moved = _moved(row[number], float(delay[number, 0]) / h)
            seen[number] = moved * (1.0 + gain[number]) + offset[number]
        result.append(seen)
    return result


def _moved(row: Array, samples: float) -> Array:
    """Return a row, ``(n,)``, so many samples late, interpolated; before its start it is constant.

    Of a row that is early, the last values continue as it ends.
    """
    at = np.maximum(np.arange(len(row)) - samples, 0.0)
    below = np.minimum(at.astype(int), len(row) - 2)
    return row[below] + (at - below) * (row[below + 1] - row[below])
