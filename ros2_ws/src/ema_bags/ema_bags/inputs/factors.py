"""Units, signs and shafts that explain the relations of position, command and speed.

With the right factors the position follows the command, its derivative is the speed times the gear
ratio, and no motion exceeds the limits of the actuator. Of all such combinations, the combination
with the fewest changes of the mapping is chosen.

A drive whose controller is unknown may have an elastic gear, a sensor with lag, or few samples per
stroke. Its relations are accepted within a factor of 2, and only a factor near the factor of a
mistaken unit, sign or shaft is a mistake.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from ema_bags.inputs.mapping import SHAFTS, AngleSource, Mapping, SpeedSource
from ema_bags.inputs.motion import ThinnedMotion
from ema_core.column_errors import Kind, Mistake, mistaken_unit
from ema_core.description import ActuatorDescription
from ema_core.units import ANGLES, SPEEDS

_GAIN_WITHIN: Final = 0.35
_RATIO_WITHIN: Final = 0.03
_MOST_CHANGES: Final = 3
_NEAR_RATIO: Final = (0.3, 3.0)
_WEIGHT_OF_RATIO: Final = 1.6
_PLAUSIBLE: Final = 2.0
_MOST_OF_ONE: Final = 2
_NEAR_UNIT: Final = 1.2
_NEAR_UNITS: Final = 1.05
_OVER_STOP: Final = 1.05
_OVER_SPEED: Final = 3.0


@dataclass(frozen=True)
class Relations:
    """Relations of the columns of an unchanged mapping."""

    gain: float | None
    """Travel of the position over travel of the command [-]; None if unknown."""

    speed_ratio: float | None
    """Derivative of the position over speed times gear ratio [-]; None if unknown."""

    reach: float
    """Largest angle of the position [rad]."""

    end_stop: float | None
    """Angle of the end stop [rad]; None if unknown or not exceeded."""


@dataclass(frozen=True)
class MappingChange:
    """A change of an entry of a mapped quantity, with its evidence."""

    quantity: str
    """Name of the wrong column."""

    mistake: Mistake
    """The mistake in the mapping of the column."""

    stated: Any
    """Value of the entry in the mapping."""

    value: Any
    """Value that was probably meant."""

    relations: Relations
    """Relations that the change explains."""

    @property
    def entry(self) -> str:
        """The entry of the mapping."""
        return self.mistake.kind.value


class _Option(NamedTuple):
    """An interpretation of a quantity; ``factor`` multiplies the factor of the mapping."""

    factor: float
    changes: tuple[tuple[Mistake, Any], ...]
    weight: float


def explain(
    motion: ThinnedMotion, mapping: Mapping, description: ActuatorDescription
) -> list[MappingChange] | None:
    """Return the fewest changes of a mapping that make its columns agree with each other.

    The list is empty if the columns agree without a change. Return None if no changes explain the
    columns.
    """
    p = description.parameters
    # The limits of an unknown drive are unknown as well.
    is_known = description.drive != "unknown"
    gain = motion.gain
    ratio = motion.speed_ratio if is_known else motion.stroke_ratio
    reach = float(np.max(np.abs(motion.position)))
    fastest = motion.fastest / p.tau
    mapped = {"position": mapping.position, "command": mapping.command, "speed": mapping.speed}
    sources = {name: source for name, source in mapped.items() if source is not None}

    def agrees(factors: dict[str, float], changes: int = 0) -> bool:
        position = factors["position"]
        if not is_known:
            relations = ((gain, "command"), (ratio, "speed"))
            return all(
                _is_explained(value, position / factors[name], changes)
                for value, name in relations
                if value is not None and name in factors
            )
        if reach * abs(position) > _OVER_STOP * p.theta_stop:
            return False
        if (
            "command" in factors
            and gain is not None
            and abs(gain * position / factors["command"] - 1.0) > _GAIN_WITHIN
        ):
            return False
        if ratio is None:
            return True
        speed = factors["speed"]
        is_slow = fastest * abs(speed) <= _OVER_SPEED * p.top_speed
        return abs(ratio * position / speed - 1.0) <= _RATIO_WITHIN and is_slow

    unchanged = dict.fromkeys(sources, 1.0)
    if agrees(unchanged):
        return []
    best: dict[str, _Option] | None = None
    least = np.inf
    if ratio is not None and _NEAR_RATIO[0] < ratio < _NEAR_RATIO[1]:
        # A wrong gear ratio is likelier than two mistakes whose product is this factor.
        least = _WEIGHT_OF_RATIO if agrees(unchanged | {"speed": ratio}) else np.inf
    for combination in itertools.product(*(_options(source, p.tau) for source in sources.values())):
        weight = sum(item.weight for item in combination)
        if weight >= least or sum(bool(item.changes) for item in combination) > _MOST_CHANGES:
            continue
        chosen = dict(zip(sources, combination, strict=True))
        changes = max(len(item.changes) for item in combination)
        if not is_known and (changes > _MOST_OF_ONE or _scales_both(chosen)):
            continue
        if agrees({name: item.factor for name, item in chosen.items()}, changes):
            best, least = chosen, weight
    if best is None:
        return None
    over_stop = is_known and reach > p.theta_stop
    relations = Relations(gain, ratio, reach, p.theta_stop if over_stop else None)
    return [
        MappingChange(name, mistake, getattr(sources[name], mistake.kind.value), value, relations)
        for name, item in best.items()
        for mistake, value in item.changes
    ]


def _scales_both(chosen: dict[str, _Option]) -> bool:
    """Return whether both position and speed change by more than a sign.

    The product of two such changes is close to any factor by chance.
    """
    both = [chosen[name].factor for name in ("position", "speed") if name in chosen]
    return len(both) == 2 and all(abs(abs(factor) - 1.0) > 1e-9 for factor in both)


def _is_explained(value: float, change: float, changes: int) -> bool:
    """Return whether the ratio of two columns is plausible after a change of their factors."""
    left = value * change
    if left <= 0.0:
        return False
    if abs(abs(change) - 1.0) < 1e-9:
        within = _PLAUSIBLE
    else:
        # Products of two changes are close to more factors by chance.
        within = _NEAR_UNIT if changes == 1 else _NEAR_UNITS
    return 1.0 / within < left < within


def _options(source: AngleSource | SpeedSource, tau: float) -> Iterator[_Option]:
    """Yield interpretations of a quantity; unusual interpretations have larger weights."""
    is_angle = isinstance(source, AngleSource)
    units = ANGLES if is_angle else SPEEDS
    if source.unit not in units:  # a length, whose lead is stated or guessed
        units = {source.unit: 1.0}
    # From the mapped shaft to the second; angles refer to the user shaft, speeds to the motor.
    to_second = tau if is_angle else 1.0 / tau
    if source.shaft != SHAFTS[0 if is_angle else 1]:
        to_second = 1.0 / to_second
    shaft = next(item for item in SHAFTS if item != source.shaft)
    for sign, (unit, size), is_second in itertools.product((1, -1), units.items(), (False, True)):
        changes: list[tuple[Mistake, Any]] = []
        factor = float(sign) * size / units[source.unit]
        if unit != source.unit:
            changes.append((mistaken_unit(units, unit, source.unit), unit))
        if is_second:
            changes.append((Mistake(Kind.SHAFT, 1.0 / to_second), shaft))
            factor *= to_second
        if sign < 0:
            changes.append((Mistake(Kind.SIGN, -1.0), -source.sign))
        # Units unusual for a whole angle are a last resort.
        rare = 0.5 * (unit in ("arcmin", "mrad/s", "mrad")) + 0.2 * is_second
        yield _Option(factor, tuple(changes), len(changes) + rare)
    for scale in (1e3, 1e-3):
        mistake = Mistake(Kind.SCALE, 1.0 / scale)
        yield _Option(scale, ((mistake, source.scale * scale),), 1.5)
