# SPDX-License-Identifier: Apache-2.0
"""Effects that the monitor model does not have, in two sets, and random plants with them.

``DEVELOPMENT`` may be used while the monitor is developed. ``HELD_OUT`` has other functional forms
and ranges; both sets contain ``DRIVE_OFF``. ``HELD_OUT`` is run once, at the end, and the monitor
is not changed after that run.
"""

from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.parameters import ActuatorParameters
from foreign.kernel import MECHANIC_STEP, Filter, Friction, Inverter, Iron
from foreign.plant import POINTS, ForeignPlant, SensorSet


class Effect(StrEnum):
    """Effects of a foreign plant in addition to the equations of docs/model.md."""

    DRIVE_OFF = "gains and limits of the drive 2 to 5 % off"
    DEAD_TIME = "dead time, 0.5 to 1.5 us"
    VOLTAGE_DROP = "voltage drop of switches and diodes"
    SLOW_LOOPS = "loops sampled every 20 to 40 us, from quantised, noisy feedback"
    STRIBECK = "Stribeck friction, smooth in speed"
    FRICTION_BY_TURN = "friction by angle, once a turn"
    COGGING = "cogging, 12 a turn"
    SUPPLY_RIPPLE = "supply ripple, 300 Hz"
    ROUNDED_EMF = "rounded trapezoidal back-EMF"
    SATURATION = "saturation by the square of the current"
    SLOW_SENSOR = "one-pole low-pass of the current sensor"
    HALL_OFFSET = "commutation displaced as a whole"

    LONG_DEAD_TIME = "dead time, 1.5 to 2.5 us"
    CARRIER = "fixed-frequency PWM with PI current loops, 25 to 40 kHz"
    LUGRE = "LuGre friction"
    FRICTION_BY_SCREW = "friction by angle, twice a turn, and by position"
    OTHER_COGGING = "cogging, 18 and 36 a turn"
    SUPPLY_SAG = "source resistance with a link capacitor, rectified 100 Hz ripple"
    HARMONIC_EMF = "back-EMF of three harmonics"
    KNEE = "saturation beyond a knee"
    BENT_SENSOR = "two-pole low-pass and cubic error of the current sensor"
    UNEVEN_HALLS = "commutation displaced phase by phase"
    ENCODER_RUNOUT = "error of the speed once a turn"


_ALL: Final = tuple(Effect)
DEVELOPMENT: Final = frozenset(_ALL[: _ALL.index(Effect.LONG_DEAD_TIME)])
HELD_OUT: Final = frozenset({Effect.DRIVE_OFF, *_ALL[_ALL.index(Effect.LONG_DEAD_TIME) :]})

OFF: Final = (0.02, 0.05)
"""Range of the relative deviation of each parameter of a plant, of either sign [-]."""

_DRIVE: Final = ("G_prop", "GAP", "I_max", "T_max", "k_t")
_OFF_NAMES: Final = (
    *_DRIVE,
    *("V_max", "k_e", "R_s", "L_s", "h_b", "J_m", "J_u", "C_m", "C_u", "f_sm", "f_su", "f_ratio"),
)
# BLK does not deviate. The fault of play is in multiples of BLK, and a healthy play of 5 mrad at
# the motor, 10 urad at the flap, cannot be known to 5 %. The error would measure this definition.
_SCREW: Final = ((0.01, 0.04), (0.0, 1.0), (-4.0, 4.0))
_TURN: Final = np.arange(POINTS + 1) / POINTS


def draw_plant(seed: int, effects: frozenset[Effect]) -> ForeignPlant:
    """Return a random plant with the given effects.

    Parameters of motor, mechanics and supply voltage deviate by 2 to 5 %, each by a separate draw;
    parameters of the drive deviate only with ``DRIVE_OFF``. Backlash does not deviate.

    The random values of an effect do not depend on the other effects, but some effects replace
    others: ``CARRIER`` replaces the loop period of ``SLOW_LOOPS``, ``LUGRE`` replaces
    ``STRIBECK``, ``SUPPLY_SAG`` replaces ``SUPPLY_RIPPLE``, ``HARMONIC_EMF`` replaces
    ``ROUNDED_EMF``, and ``KNEE`` replaces ``SATURATION``.
    """

    def draw(effect: Effect, *bounds: tuple[float, float]) -> NDArray[np.float64]:
        rng = np.random.default_rng((14, seed, *effect.name.encode()))
        low, high = np.array(bounds).T
        values = rng.uniform(low, high)
        return values if effect in effects else np.full(len(bounds), np.nan)

    dead, long_dead = draw(Effect.DEAD_TIME, (0.5, 1.5))[0], draw(Effect.LONG_DEAD_TIME, (1.5, 2.5))
    drop, drop_resistance = _known(draw(Effect.VOLTAGE_DROP, (0.3, 0.9), (0.01, 0.05)), 0.0)
    period, angle_resolution, speed_resolution, noise = draw(
        Effect.SLOW_LOOPS, (10.0, 20.0), (1e-7, 3e-7), (0.01, 0.1), (1e-8, 5e-8)
    )
    carrier_hz, bandwidth_hz = draw(Effect.CARRIER, (25e3, 40e3), (1.5e3, 2.5e3))
    hall = draw(Effect.HALL_OFFSET, (-1.5, 1.5))
    halls = draw(Effect.UNEVEN_HALLS, *((-2.0, 2.0),) * 3)
    sag, link_lag, sag_ripple = draw(Effect.SUPPLY_SAG, (0.03, 0.12), (1e-4, 5e-4), (0.01, 0.03))
    (ripple,) = _known(draw(Effect.SUPPLY_RIPPLE, (0.01, 0.03)), 0.0)
    parameters = _off_nominal(seed, effects)
    has_carrier = Effect.CARRIER in effects
    if has_carrier:
        loop_steps = round(1.0 / carrier_hz / MECHANIC_STEP)
    else:
        loop_steps = round(period) if Effect.SLOW_LOOPS in effects else 1
    offsets = _known(halls, 0.0) + _known(hall, 0.0)
    inductance_gain = 2.0 * np.pi * bandwidth_hz * 0.5 * parameters.L_s if has_carrier else 0.0
    resistance_gain = 2.0 * np.pi * bandwidth_hz * 0.5 * parameters.R_s if has_carrier else 0.0
    inverter = Inverter(
        period=loop_steps,
        carrier=float(has_carrier),
        gain=float(inductance_gain),
        integral_gain=float(resistance_gain),
        dead_steps=round(2.0 * float(np.nansum([dead, *long_dead]))),
        drop=float(drop),
        drop_resistance=float(drop_resistance),
        source_resistance=float(_known(sag, 0.0)),
        link_lag=float(_known(link_lag, 0.0)),
        angle_resolution=float(_known(angle_resolution, 0.0)),
        speed_resolution=float(_known(speed_resolution, 0.0)),
        hall_a=float(offsets[0]) / 360.0,
        hall_b=float(offsets[-2]) / 360.0,
        hall_c=float(offsets[-1]) / 360.0,
        open_a=0.0,
        open_b=0.0,
        open_c=0.0,
        dead_switch=0.0,
    )
    if Effect.SUPPLY_SAG in effects:
        supply, supply_hz = 1.0 - sag_ripple * np.abs(np.sin(np.pi * _TURN)), 100.0
    else:
        supply, supply_hz = 1.0 + ripple * np.sin(2.0 * np.pi * _TURN), 300.0
    return ForeignPlant(
        seed=seed,
        effects=tuple(str(effect) for effect in _ALL if effect in effects),
        parameters=parameters,
        inverter=inverter,
        iron=_iron(draw),
        friction=_friction(draw, effects),
        sensors=_sensors(draw, seed),
        emf=_emf(draw, effects),
        cogging=_cogging(draw),
        friction_by_turn=_friction_by_turn(draw),
        friction_slope=float(_known(draw(Effect.FRICTION_BY_SCREW, *_SCREW), 0.0)[2]),
        supply=supply,
        supply_hz=supply_hz,
        feedback_noise=float(_known(noise, 0.0)),
    )


def _iron(draw) -> Iron:
    square = draw(Effect.SATURATION, (0.02, 0.08), (0.01, 0.03))
    beyond = draw(Effect.KNEE, (0.05, 0.15), (0.02, 0.05), (8.0, 14.0))
    if np.isfinite(beyond[0]):
        return Iron(float(beyond[0]), float(beyond[1]), float(beyond[2]), 1.0)
    inductance_loss, torque_loss = _known(square, 0.0)
    return Iron(float(inductance_loss), float(torque_loss), 22.5, 0.0)


def _friction(draw, effects: frozenset[Effect]) -> Friction:
    omega_0, omega_s = draw(Effect.STRIBECK, (0.01, 0.03), (0.5, 4.0))
    bristle_s, deflection, damping = draw(Effect.LUGRE, (0.5, 6.0), (3e-4, 1.5e-3), (0.3, 0.9))
    if Effect.LUGRE in effects:
        return Friction(1.0, 0.02, float(bristle_s), float(deflection), float(damping))
    return Friction(0.0, float(_known(omega_0, 0.02)), float(_known(omega_s, 0.1)), 1e-3, 0.5)


def _sensors(draw, seed: int) -> SensorSet:
    (lag,) = _known(draw(Effect.SLOW_SENSOR, (1e-5, 6e-5)), 0.0)
    first, second, cubic = _known(
        draw(Effect.BENT_SENSOR, (1e-5, 4e-5), (1e-5, 3e-5), (-0.02, 0.02)), 0.0
    )
    runout, runout_phase = _known(draw(Effect.ENCODER_RUNOUT, (1e-3, 4e-3), (0.0, 1.0)), 0.0)
    rng = np.random.default_rng((14, seed, 99))
    noise, current, position, speed = rng.uniform(
        (0.03, 0.003, 5e-7, 0.02), (0.07, 0.02, 2e-6, 0.1)
    )
    return SensorSet(
        Filter(float(first + lag), float(second)),
        cubic=float(cubic),
        runout=float(runout),
        runout_phase=float(runout_phase),
        current_noise=float(noise),
        resolutions=(float(current), float(position), float(speed)),
    )


def _emf(draw, effects: frozenset[Effect]) -> NDArray[np.float64]:
    (sharpness,) = draw(Effect.ROUNDED_EMF, (4.0, 10.0))
    third, fifth, seventh = draw(Effect.HARMONIC_EMF, (0.2, 0.26), (0.02, 0.05), (-0.012, 0.004))
    angle = 2.0 * np.pi * _TURN
    if Effect.HARMONIC_EMF in effects:
        wave = np.sin(angle) + third * np.sin(3 * angle) + fifth * np.sin(5 * angle)
        wave += seventh * np.sin(7 * angle)
        # Normalised as in data sheets: by the mean over the angles at which the phase is driven.
        return wave / np.mean(wave[(_TURN > 1 / 12) & (_TURN < 5 / 12)])
    # A triangle wave with three times the height of the plateau: it reaches 1 at 30 degrees.
    x = 3.0 * (2.0 / np.pi) * np.arcsin(np.sin(angle))
    if Effect.ROUNDED_EMF in effects:
        wave = (_soft(sharpness * (x + 1.0)) - _soft(sharpness * (x - 1.0))) / (2.0 * sharpness)
        return wave / np.max(wave)
    return np.clip(x, -1.0, 1.0)


def _soft(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return log(cosh(x)) without overflow."""
    return np.logaddexp(x, -x) - np.log(2.0)


def _cogging(draw) -> NDArray[np.float64]:
    twelve, phase = _known(draw(Effect.COGGING, (3e-3, 0.012), (0.0, 1.0)), 0.0)
    eighteen, more, phase_18, phase_36 = _known(
        draw(Effect.OTHER_COGGING, (3e-3, 0.012), (1e-3, 4e-3), (0.0, 1.0), (0.0, 1.0)), 0.0
    )
    rows = ((12, twelve, phase), (18, eighteen, phase_18), (36, more, phase_36))
    return sum(
        (amplitude * np.sin(2.0 * np.pi * (n * _TURN + shift)) for n, amplitude, shift in rows),
        np.zeros_like(_TURN),
    )


def _friction_by_turn(draw) -> NDArray[np.float64]:
    once, phase = _known(draw(Effect.FRICTION_BY_TURN, (0.01, 0.05), (0.0, 1.0)), 0.0)
    twice, phase_2, _ = _known(draw(Effect.FRICTION_BY_SCREW, *_SCREW), 0.0)
    wave = once * np.cos(2.0 * np.pi * (_TURN + phase))
    return 1.0 + wave + twice * np.cos(2.0 * np.pi * (2.0 * _TURN + phase_2))


def _off_nominal(seed: int, effects: frozenset[Effect]) -> ActuatorParameters:
    rng = np.random.default_rng((14, seed))
    nominal = ActuatorParameters()
    size = rng.uniform(*OFF, len(_OFF_NAMES)) * rng.choice([-1.0, 1.0], len(_OFF_NAMES))
    return nominal.replace(
        {
            name: (1.0 + share) * getattr(nominal, name)
            for name, share in zip(_OFF_NAMES, size.tolist(), strict=True)
            if Effect.DRIVE_OFF in effects or name not in _DRIVE
        }
    )


def _known(values, otherwise: float) -> NDArray[np.float64]:
    """Return the values with ``otherwise`` for each NaN, the value of an absent effect."""
    return np.where(np.isnan(values), otherwise, values)
