# SPDX-License-Identifier: Apache-2.0
"""Conversion of source values to telemetry columns in SI units."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.mapping import (
    ENCODINGS,
    TEMPERATURES,
    AngleSource,
    ColumnMapping,
    CurrentSource,
    PayloadSource,
    SpeedSource,
    TemperatureSource,
)
from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters
from ema_core.units import CURRENTS, LINEAR, UNITS

_PEAK: Final = {"": 1.0, "peak": 1.0, "rms": math.sqrt(2.0), "power": math.sqrt(2.0 / 3.0)}
"""Phase current amplitude divided by i_q, for each i_q convention [-]."""

_PHASE_TO_PHASE: Final = math.sqrt(3.0) / 2.0
"""Equivalent current for a phase-to-phase torque constant, per phase current amplitude [-].

The torque is equal: T = 3/2 (k_t / sqrt(3)) i_q (M33).
"""

_NEUTRAL_LEAD: Final = 1.0
"""Nominal lead of a linear axis without a screw; it does not affect results in m and N [m]."""

_SMOOTHED: Final = 3
_NOISES: Final = 5.0
_SLOWEST: Final = 0.02
_SLOW: Final = 0.3


def with_lead(description: ActuatorDescription, mapping: ColumnMapping) -> ActuatorDescription:
    """Return the description with a lead for converting lengths, if its drive is unknown.

    The lead is taken from the description, else from the mapping. Linear motors and prismatic
    joints have no screw; for them an arbitrary lead is used.
    """
    parameters, position = description.parameters, mapping.position
    if description.is_modelled or parameters.lead or position.unit not in LINEAR:
        return description
    lead = position.lead or _NEUTRAL_LEAD
    return replace(description, parameters=replace(parameters, lead=lead))


def convert(
    raw: Mapping[str, NDArray[np.float64]],
    mapping: ColumnMapping,
    description: ActuatorDescription,
    breaks: Sequence[int] = (),
) -> dict[str, NDArray[np.float64]]:
    """Convert source values to telemetry columns, ``(n,)`` each; unmeasured columns are empty.

    Parameters
    ----------
    raw
        Source values by the keys of ``ColumnMapping.wanted``, ``(n,)`` each. The temperature is
        ignored because it is not a telemetry column.
    mapping
        Sources of the columns.
    description
        Actuator description with torque constant, gear ratio, lead and drive.
    breaks
        Indices of samples that follow an interruption; motion directions are not interpolated
        across interruptions.

    Raises
    ------
    ValueError
        If a unit does not fit the drive, or the lead is missing or contradicts the description.
    """
    p = description.parameters
    raw = {
        key: decoded(raw[key], source.encoding)
        for key, _, source in mapping.wanted()
        if source is not mapping.temperature
    }
    position = _turned(raw["position"], mapping.position, p)
    command, speed, current = np.empty(0), np.empty(0), np.empty(0)
    if mapping.command is not None:
        command = _turned(raw["command"], mapping.command, p)
    elif mapping.error is not None:
        command = position + _turned(raw["error"], mapping.error, p)
    if mapping.speed is not None:
        speed = _turned(raw["speed"], mapping.speed, p)
    source = mapping.measured_current
    if source is not None:
        is_phases = source.kind == "phase_currents"
        values = _of_phases(raw, description.drive != "six_step") if is_phases else raw["current"]
        factor = _current_factor(source, description, mapping.position.lead)
        current = _scaled(values, factor, source.offset)
        if source.kind == "magnitude":
            has_speed = bool(len(speed))
            pieces = np.split(speed if has_speed else position, breaks)
            directions = [_direction(piece, is_speed=has_speed) for piece in pieces]
            current = current * np.concatenate(directions)
    columns = {"command": command, "current": current, "position": position, "speed": speed}
    payload = mapping.payload
    return columns | {"payload": np.empty(0) if payload is None else _held(raw, payload)}


def _held(raw: Mapping[str, NDArray[np.float64]], source: PayloadSource) -> NDArray[np.float64]:
    """Return the payload, ``(n,)`` [kg].

    It is the amount by which the scaled value exceeds ``source.above``, and 0 below. For a flag or
    the position of a gripper, this amount only shows whether there is a payload. An unknown value
    counts as 1.
    """
    values = _scaled(raw["payload"], source.sign * source.scale, source.offset) - source.above
    return np.where(np.isfinite(values), np.maximum(values, 0.0), 1.0)


def degrees_celsius(raw: NDArray[np.float64], source: TemperatureSource) -> NDArray[np.float64]:
    """Convert source values to temperatures, ``(n,)`` [degC]."""
    factor, addition = TEMPERATURES[source.unit]
    values = _scaled(decoded(raw, source.encoding), source.sign * source.scale, 0.0)
    return _scaled(values, factor, addition + source.offset)


def _turned(
    raw: NDArray[np.float64], source: AngleSource | SpeedSource, p: ActuatorParameters
) -> NDArray[np.float64]:
    """Convert source values to user-shaft angle [rad] or motor-shaft speed [rad/s]."""
    to_user = p.tau if source.shaft == "motor" else 1.0
    shaft = to_user if isinstance(source, AngleSource) else to_user / p.tau
    turn = 1.0
    if source.unit in LINEAR:
        lead = source.lead or p.lead
        if not lead or not math.isclose(lead, p.lead or lead):
            raise ValueError(
                f"{source.source}: unit = {source.unit} with lead = {lead:g}: expected the "
                f"travel per shaft turn [m], as in the actuator file (lead = {p.lead:g})"
            )
        turn = 2.0 * math.pi / lead
    factor = source.sign * source.scale * UNITS[source.unit] * turn * shaft
    return _scaled(raw, factor, source.offset)


def _current_factor(source: CurrentSource, description: ActuatorDescription, lead: float) -> float:
    """Return the factor from source values or phase magnitudes to equivalent current [A]."""
    p = description.parameters
    is_effort = source.kind in ("equivalent", "magnitude") and source.unit not in CURRENTS
    if is_effort and description.is_modelled:
        raise ValueError(
            f"current: unit = {source.unit} with kind = {source.kind} and drive = "
            f"{description.drive}: expected {' or '.join(CURRENTS)}, or kind = motor_torque, "
            "joint_torque or force"
        )
    factor = source.sign * source.scale * UNITS[source.unit]
    kind = source.kind
    if is_effort:  # of a joint, as in JointState
        kind = "joint_torque" if source.unit.endswith("N.m") else "force"
    if kind == "motor_torque":
        return factor / p.k_t
    if kind == "joint_torque":
        return factor * p.tau / p.k_t
    if kind == "force":
        if lead := p.lead or lead:
            return factor * lead / (2.0 * math.pi) * p.tau / p.k_t
        if description.is_modelled:
            raise ValueError(
                "current: kind = force with lead = 0: expected the travel per shaft turn in the "
                "actuator file (lead [m])"
            )
    if kind == "i_q":
        constant = _PHASE_TO_PHASE if description.drive == "six_step" else 1.0
        return factor * _PEAK[source.amplitude] * constant
    return factor


def _of_phases(raw: Mapping[str, NDArray[np.float64]], is_sinusoidal: bool) -> NDArray[np.float64]:
    """Return the equivalent current of two or three phase currents, which sum to zero."""
    a, b = raw["phase_a"], raw["phase_b"]
    c = raw["phase_c"] if "phase_c" in raw else -a - b
    if is_sinusoidal:
        # As i_d is zero, the magnitude of the space vector is the peak value of i_q.
        magnitude = np.sqrt((a * a + b * b + c * c) * (2.0 / 3.0))
    else:
        magnitude = (np.abs(a) + np.abs(b) + np.abs(c)) / 2.0
    return np.sign(raw["torque_sign"]) * magnitude


def decoded(raw: NDArray[np.float64], encoding: str) -> NDArray[np.float64]:
    """Convert unsigned register values to signed numbers; see ``ENCODINGS``."""
    bit, times = ENCODINGS[encoding]
    if not bit:
        return raw
    return np.where(raw < bit, raw, bit - raw if times == 1 else raw - 2.0 * bit)


def _direction(motion: NDArray[np.float64], *, is_speed: bool) -> NDArray[np.float64]:
    """Return the direction of motion, ``(n,)``: 1 or -1.

    Samples at rest take it from the nearest motion. It is 1 if nothing moves.
    """
    if len(motion) < 2:
        return np.where(motion < 0.0, -1.0, 1.0) if is_speed else np.ones(len(motion))
    speed = motion if is_speed else np.gradient(motion)
    smooth = np.convolve(speed, np.ones(_SMOOTHED) / _SMOOTHED, mode="same")
    rms = np.sqrt(np.mean(smooth**2))
    noise = np.median(np.abs(np.diff(smooth, 2))) if len(smooth) > 2 else 0.0
    moving = np.flatnonzero(np.abs(smooth) > np.clip(_NOISES * noise, _SLOWEST * rms, _SLOW * rms))
    if not len(moving):
        return np.ones(len(motion))
    halfway = (moving[1:] + moving[:-1]) / 2.0
    return np.sign(smooth[moving[np.searchsorted(halfway, np.arange(len(motion)))]])


def _scaled(raw: NDArray[np.float64], factor: float, offset: float) -> NDArray[np.float64]:
    # Skip neutral operations so that unconverted values stay bit-identical.
    values = raw if factor == 1.0 else raw * factor
    return values if offset == 0.0 else values + offset
