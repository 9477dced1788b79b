"""What a test shows, in figures that need no model: levels, scatter and roughness by direction."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array, Flags
from ema_core.telemetry import Telemetry

LEVEL: Final = "level"
"""Kind of a figure in its own unit, compared with the running current of healthy tests."""

RATIO: Final = "ratio"
"""Kind of a scatter, compared by its logarithm."""

FIGURE: Final = "figure"
"""Kind of a figure of a move, compared by its logarithm."""

# By how much travel, speed and sample period of like tests may differ [-].
_TOLERANCE: Final = 0.05
_MOVING: Final = 0.5
_RESTING: Final = 0.02
_FASTEST: Final = 99.0
_SETTLING: Final = 6
_SHORTEST: Final = 4
_TINY: Final = 1e-12


class Feature(NamedTuple):
    """A figure of a test: its kind, and how it is told."""

    kind: str
    words: str


FEATURES: Final = {
    "rest_current": Feature(LEVEL, "the current at rest"),
    **{
        f"{name}_{way}": Feature(kind, f"{words} in the {way} stroke")
        for way in ("forward", "backward")
        for name, kind, words in (
            ("current", LEVEL, "the current"),
            ("current_scatter", RATIO, "the scatter of the current"),
            ("current_roughness", RATIO, "the roughness of the current"),
            ("error_scatter", RATIO, "the scatter of the tracking error"),
            ("error_roughness", RATIO, "the roughness of the tracking error"),
        )
    },
    "friction_current": Feature(LEVEL, "the current that follows the direction"),
}
"""Figures of a test, by name."""


@dataclass(frozen=True)
class Motion:
    """What was commanded in a test, so that only like is compared with like.

    It has the period of the samples [s], the travel of the command at the user shaft [rad], and the
    speed that all but 1 % of its samples stay below [rad/s].
    """

    sample_period: float
    travel: float
    speed: float

    def __str__(self) -> str:
        return f"{self.travel:.3g} rad at {self.speed:.3g} rad/s, {1.0 / self.sample_period:g} Hz"

    def is_like(self, other: "Motion") -> bool:
        """Return whether it can be compared with another."""
        ratios = np.divide(astuple(self), np.maximum(astuple(other), _TINY))
        return bool(np.all(np.abs(np.log(np.maximum(ratios, _TINY))) <= math.log1p(_TOLERANCE)))


class Part(NamedTuple):
    """What one stretch of a test commanded, its figures, and how many samples it has."""

    motion: Motion
    features: dict[str, float]
    samples: int


def motion_of(window: Telemetry) -> Motion:
    """Return what a window of at least two samples commands, with six digits."""
    return _motion(window, _speeds(window)[1])


def figures_of(window: Telemetry) -> list[Part]:
    """Return the figures of a window; none where it has no current, or no stroke each way.

    They have six digits, which is what a file or a history keeps of them. A current without sign is
    taken as it is: its magnitude is what friction and load need in each direction.
    """
    if not len(window.current) or len(window) < 2:
        return []
    speed, fastest = _speeds(window)
    strokes = {
        way: _strokes(sign * speed > _MOVING * fastest)
        for way, sign in (("forward", 1.0), ("backward", -1.0))
    }
    if not (fastest > 0.0 and all(strokes.values())):
        return []
    figures = _figures(window, np.abs(speed) < _RESTING * fastest, strokes)
    motion = _motion(window, fastest)
    return [Part(motion, {name: _short(one) for name, one in figures.items()}, len(window))]


def row_of(part: Part) -> list[float]:
    """Return a stretch as a row: samples, motion and all ``FEATURES``; NaN where it lacks one."""
    figures = (part.features.get(name, math.nan) for name in FEATURES)
    return [part.samples, *astuple(part.motion), *figures]


def part_of(row: Sequence[float | None], names: Iterable[str] = FEATURES) -> Part:
    """Return the stretch in a row of `row_of`, by the names of its figures; None is NaN.

    ValueError when it has no motion, or other figures.
    """
    samples, period, travel, speed, *values = np.array(row, dtype=np.float64).tolist()
    if not (0.0 < period < math.inf and 0.0 < travel * speed < math.inf):
        raise ValueError("a stretch has no motion: make it anew")
    named = zip(names, values, strict=True)
    figures = {name: value for name, value in named if math.isfinite(value)}
    return Part(Motion(period, travel, speed), figures, int(samples))


def mean_of(parts: Sequence[Part]) -> dict[str, float]:
    """Return the means of the figures that all parts of a test have."""
    weights = [part.samples for part in parts]
    return {
        name: float(np.average([part.features[name] for part in parts], weights=weights))
        for name in FEATURES
        if all(name in part.features for part in parts)
    }


def _figures(
    part: Telemetry, at_rest: Flags, strokes: dict[str, list[NDArray[np.intp]]]
) -> dict[str, float]:
    """Return the figures of one part."""
    error = part.command - part.position
    is_signed = bool(np.min(part.current) < -_RESTING * np.max(np.abs(part.current)))
    values: dict[str, float] = {}
    if np.any(at_rest):
        values["rest_current"] = float(np.median(np.abs(part.current[at_rest])))
    for way, sign in (("forward", 1.0), ("backward", -1.0)):
        current = sign * part.current if is_signed else part.current
        values[f"current_{way}"] = float(np.mean([np.mean(current[one]) for one in strokes[way]]))
        for name, column in (("current", current), ("error", error)):
            scatter = [_detrended(column[one]) for one in strokes[way]]
            rough = [np.diff(column[one]) for one in strokes[way]]
            values[f"{name}_scatter_{way}"] = _log_rms(scatter)
            values[f"{name}_roughness_{way}"] = _log_rms(rough)
    values["friction_current"] = 0.5 * (values["current_forward"] + values["current_backward"])
    return values


def _motion(window: Telemetry, fastest: float) -> Motion:
    return Motion(window.sample_period, *map(_short, (np.ptp(window.command), fastest)))


def _speeds(window: Telemetry) -> tuple[Array, float]:
    """Return the commanded speed, ``(n,)``, and what all but 1 % of it stay below [rad/s]."""
    speed = np.gradient(window.command) / window.sample_period
    return speed, float(np.percentile(np.abs(speed), _FASTEST))


def _strokes(moving: Flags) -> list[NDArray[np.intp]]:
    """Return the places of each stroke, without the sixth in which it settles."""
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
