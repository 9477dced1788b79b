# SPDX-License-Identifier: Apache-2.0
"""Model-free figures of a test window: levels, scatter and roughness of each stroke.

The method is described in ``docs/real-data.md``, M47.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array, Flags
from ema_core.telemetry import Telemetry
from ema_monitor.joint.departure import JudgedFigure

# Largest relative difference in travel, speed and sample period between similar motions [-].
_TOLERANCE: Final = 0.05
_MOVING: Final = 0.5
_RESTING: Final = 0.02
_FASTEST: Final = 99.0
_SETTLING: Final = 6
_SHORTEST: Final = 4
_TINY: Final = 1e-12
_ERROR_OF_LEVEL: Final = 0.007
_ERROR_OF_RATIO: Final = 0.05


_LEVEL: Final = JudgedFigure(0.01, is_logarithm=False, error=_ERROR_OF_LEVEL)
_RATIO: Final = JudgedFigure(0.024, error=_ERROR_OF_RATIO)

WINDOW_FIGURES: Final = {
    "rest_current": _LEVEL,
    **{
        f"{name}_{direction}": kind
        for direction in ("forward", "backward")
        for name, kind in (
            ("current", _LEVEL),
            ("current_scatter", _RATIO),
            ("current_roughness", _RATIO),
            ("error_scatter", _RATIO),
            ("error_roughness", _RATIO),
        )
    },
    "friction_current": _LEVEL,
}
"""Figures of a window, by name: scatter and roughness are logarithms, currents are levels [A]."""


@dataclass(frozen=True)
class CommandedMotion:
    """Commanded motion of a window; only windows of similar motion are compared."""

    sample_period: float
    """Period of the samples [s]."""
    travel: float
    """Travel of the command at the user shaft, from end to end [rad]."""
    speed: float
    """99 % quantile of the commanded speed [rad/s]."""

    def __str__(self) -> str:
        return f"{self.travel:.3g} rad at {self.speed:.3g} rad/s, {1.0 / self.sample_period:g} Hz"

    def is_like(self, motion: "CommandedMotion") -> bool:
        """Return whether another motion is so similar that windows of both can be compared."""
        ratios = np.divide(astuple(self), np.maximum(astuple(motion), _TINY))
        return bool(np.all(np.abs(np.log(np.maximum(ratios, _TINY))) <= math.log1p(_TOLERANCE)))


class WindowFigures(NamedTuple):
    """Motion of a window, its figures by name, and its number of samples."""

    motion: CommandedMotion
    values: dict[str, float]
    samples: int


def figures_of(window: Telemetry) -> list[WindowFigures]:
    """Return the figures of a window as a list with at most one element.

    The list is empty without a measured current, or without strokes in both directions. The figures
    are rounded to six digits, the precision of files and histories. An unsigned current is not
    inverted in backward strokes, because it is the magnitude of the effort.
    """
    if not len(window.current) or len(window) < 2:
        return []
    speed, fastest = _speeds(window)
    strokes = {
        direction: _strokes(sign * speed > _MOVING * fastest)
        for direction, sign in (("forward", 1.0), ("backward", -1.0))
    }
    if not (fastest > 0.0 and all(strokes.values())):
        return []
    figures = _figures(window, np.abs(speed) < _RESTING * fastest, strokes)
    values = {name: _short(value) for name, value in figures.items()}
    return [WindowFigures(_motion(window, fastest), values, len(window))]


def row_of(window: WindowFigures) -> list[float]:
    """Return window figures as a row: samples, motion, and ``WINDOW_FIGURES`` (NaN if missing)."""
    figures = (window.values.get(name, math.nan) for name in WINDOW_FIGURES)
    return [window.samples, *astuple(window.motion), *figures]


def figures_of_row(
    row: Sequence[float | None], names: Iterable[str] = WINDOW_FIGURES
) -> WindowFigures:
    """Return window figures from a row that ``row_of`` returned; figures that are None are omitted.

    ``names`` are the names of the figures in the row, in their order. Figures that are NaN are
    omitted.

    Raises
    ------
    ValueError
        If the row has no motion or the wrong number of figures.
    """
    samples, period, travel, speed, *values = np.array(row, dtype=np.float64).tolist()
    if not (0.0 < period < math.inf and 0.0 < travel * speed < math.inf):
        raise ValueError("the figures of a window have no motion: calibrate or estimate again")
    named = zip(names, values, strict=True)
    figures = {name: value for name, value in named if math.isfinite(value)}
    return WindowFigures(CommandedMotion(period, travel, speed), figures, int(samples))


def mean_of(windows: Sequence[WindowFigures]) -> dict[str, float]:
    """Return the mean of each figure that all windows have, weighted by their samples."""
    weights = [window.samples for window in windows]
    return {
        name: float(np.average([window.values[name] for window in windows], weights=weights))
        for name in WINDOW_FIGURES
        if all(name in window.values for window in windows)
    }


def _figures(
    window: Telemetry, at_rest: Flags, strokes: dict[str, list[NDArray[np.intp]]]
) -> dict[str, float]:
    error = window.command - window.position
    is_signed = bool(np.min(window.current) < -_RESTING * np.max(np.abs(window.current)))
    values: dict[str, float] = {}
    if np.any(at_rest):
        values["rest_current"] = float(np.median(np.abs(window.current[at_rest])))
    for direction, sign in (("forward", 1.0), ("backward", -1.0)):
        current = sign * window.current if is_signed else window.current
        means = [np.mean(current[stroke]) for stroke in strokes[direction]]
        values[f"current_{direction}"] = float(np.mean(means))
        for name, column in (("current", current), ("error", error)):
            scatter = [_detrended(column[stroke]) for stroke in strokes[direction]]
            rough = [np.diff(column[stroke]) for stroke in strokes[direction]]
            values[f"{name}_scatter_{direction}"] = _log_rms(scatter)
            values[f"{name}_roughness_{direction}"] = _log_rms(rough)
    values["friction_current"] = 0.5 * (values["current_forward"] + values["current_backward"])
    return values


def _motion(window: Telemetry, fastest: float) -> CommandedMotion:
    return CommandedMotion(window.sample_period, *map(_short, (np.ptp(window.command), fastest)))


def _speeds(window: Telemetry) -> tuple[Array, float]:
    """Return the commanded speed, ``(n,)``, and the 99 % quantile of its magnitude [rad/s]."""
    speed = np.gradient(window.command) / window.sample_period
    return speed, float(np.percentile(np.abs(speed), _FASTEST))


def _strokes(moving: Flags) -> list[NDArray[np.intp]]:
    """Return the sample indices of each stroke, omitting its first sixth (settling time)."""
    places = np.flatnonzero(moving)
    runs = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1)
    settled = [run[len(run) // _SETTLING :] for run in runs]
    return [run for run in settled if len(run) >= _SHORTEST]


def _detrended(values: Array) -> Array:
    steps = np.arange(len(values)) - 0.5 * (len(values) - 1)
    return values - np.mean(values) - steps * (steps @ values) / (steps @ steps)


def _short(value: float) -> float:
    return float(f"{value:.6g}")


def _log_rms(pieces: list[Array]) -> float:
    """Return the logarithm of the root mean square of all pieces."""
    return 0.5 * math.log(max(float(np.mean(np.concatenate(pieces) ** 2)), _TINY**2))
