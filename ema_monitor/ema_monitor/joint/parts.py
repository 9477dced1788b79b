# SPDX-License-Identifier: Apache-2.0
"""Figures of each part of a record and each direction: features to classify labelled states.

Each part has strokes in both directions. Because the parts show the scatter of the figures within a
record, a few labelled records are enough.
"""

import math
from itertools import pairwise
from typing import Final

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.telemetry import Telemetry
from ema_monitor.joint.signals import Preparation
from ema_monitor.joint.smoothing import smoothed

MOST_PARTS: Final = 5
"""Largest number of parts of a record."""

DIRECTIONS: Final = {"forward": 1.0, "backward": -1.0}
"""Sign of the speed by direction."""

LEVELS: Final = tuple(f"effort_{direction}" for direction in DIRECTIONS)
"""Names of the figures that are levels: mean effort in each direction [A]."""

LOGARITHMS: Final = tuple(
    f"{name}_{direction}"
    for direction in DIRECTIONS
    for name in (
        *("effort_scatter", "effort_roughness", "effort_ripple_1", "effort_ripple_2"),
        *("error_scatter", "error_roughness"),
    )
)
"""Names of the figures that are logarithms: scatter, roughness and ripple of effort [A] and
tracking error [rad]."""

_RIPPLES: Final = (1, 2)
_FEWEST: Final = 20
_FAST: Final = 0.7
_SMOOTH: Final = 2.0
_SMOOTH_OF_CUTOFF: Final = 0.044
_DEGREE: Final = 3
_FEWEST_TURNS: Final = 2.0
_RIPPLE_FLOOR: Final = 0.01
_TINY: Final = 1e-12


def parts_of(telemetry: Telemetry, preparation: Preparation) -> tuple[dict[str, float], ...]:
    """Return the figures by name for each part of a record.

    Parts without steady motion in both directions are omitted. Figures of the tracking error
    require a command; ripple figures require two turns in one direction.

    Parameters
    ----------
    telemetry
        Samples of the record.
    preparation
        Preparation of the record.
    """
    h = telemetry.sample_period
    width = max(_SMOOTH, _SMOOTH_OF_CUTOFF / (preparation.cutoff_hz * h))
    speed = np.gradient(smoothed(telemetry.position, width), h)
    direction = np.sign(speed) * (np.abs(speed) > _FAST * preparation.usual_speed)
    measured = direction
    if len(telemetry.interpolated):
        measured = np.where(telemetry.interpolated, 0.0, direction)
    parts = []
    for begin, end in _bounds(direction):
        chosen = slice(begin, end)
        part = _figures(
            telemetry.position[chosen],
            telemetry.current[chosen],
            (telemetry.command - telemetry.position)[chosen] if telemetry.has_command else None,
            measured[chosen],
        )
        if part:
            parts.append(part)
    return tuple(parts)


def mean_of(parts: tuple[dict[str, float], ...]) -> dict[str, float]:
    """Return the mean of each figure that all parts have."""
    if not parts:
        return {}
    shared = [name for name in parts[0] if all(name in part for part in parts)]
    return {name: float(np.mean([part[name] for part in parts])) for name in shared}


def _bounds(direction: Array) -> list[tuple[int, int]]:
    """Return the start and end sample of each part; each part has a whole number of cycles.

    Parameters
    ----------
    direction
        Direction of steady motion, ``(n,)``: 1, -1, or 0 without steady motion.
    """
    moving = np.flatnonzero(direction)
    if not len(moving):
        return []
    signs = direction[moving]
    turns = np.concatenate([[True], signs[1:] != signs[:-1]])
    begins, signs = moving[turns], signs[turns]
    cycles = begins[signs == signs[0]]
    count = min(MOST_PARTS, len(cycles), int(np.sum(signs != signs[0])))
    if not count:
        return []
    starts = [0, *(int(cycles[i * len(cycles) // count]) for i in range(1, count)), len(direction)]
    return list(pairwise(starts))


def _figures(
    position: Array, effort: Array, error: Array | None, direction: Array
) -> dict[str, float]:
    """Return the figures of a part; empty without steady motion in both directions."""
    figures: dict[str, float] = {}
    for name, sign in DIRECTIONS.items():
        moving = direction == sign
        if np.sum(moving) < _FEWEST:
            return {}
        place = position[moving]
        directed = sign * effort[moving]
        figures[f"effort_{name}"] = float(np.mean(directed))
        figures[f"effort_scatter_{name}"] = log_rms(directed - np.mean(directed))
        figures[f"effort_roughness_{name}"] = log_rms(steps_within(effort, moving))
        if np.ptp(place) > 2.0 * math.pi * _FEWEST_TURNS:
            for order in _RIPPLES:
                figures[f"effort_ripple_{order}_{name}"] = _log_ripple(directed, place, order)
        if error is not None:
            chosen = error[moving]
            figures[f"error_scatter_{name}"] = log_rms(chosen - np.mean(chosen))
            figures[f"error_roughness_{name}"] = log_rms(steps_within(error, moving))
    return figures


def _log_ripple(values: Array, position: Array, order: int) -> float:
    """Return the logarithm of the amplitude of a ripple with ``order`` periods per turn.

    The trend over the travel is removed first. 1 % of the remaining scatter is added to the
    amplitude, so that the logarithm is finite.
    """
    middle, half = np.mean(position), 0.5 * np.ptp(position)
    trend = np.polynomial.legendre.legvander((position - middle) / half, _DEGREE)
    rest = values - trend @ np.linalg.lstsq(trend, values, rcond=None)[0]
    ripple = abs(np.mean(rest * np.exp(-1j * order * position)))
    return math.log(ripple + _RIPPLE_FLOOR * math.exp(log_rms(rest)))


def steps_within(values: Array, chosen: Flags) -> Array:
    """Return the differences between neighbouring samples that are both chosen.

    Without such neighbours, the result is a single 0.
    """
    steps = np.diff(values)[chosen[1:] & chosen[:-1]]
    return steps if len(steps) else np.zeros(1)


def log_rms(values: Array) -> float:
    """Return the logarithm of the root mean square of values, which counts as at least 1e-12."""
    return 0.5 * math.log(max(float(np.mean(values**2)), _TINY**2))
