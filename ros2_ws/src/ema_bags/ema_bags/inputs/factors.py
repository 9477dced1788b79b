# SPDX-License-Identifier: Apache-2.0
"""Detection of wrong units, signs and shafts from relations between position, command and speed.

With the right factors, the position follows the command, its derivative equals the speed times the
gear ratio, and no motion exceeds the actuator's limits. Among the factors that satisfy this, those
with the fewest changes to the mapping are chosen.

The search is here and not in `ema_core.columns`, because it tries the entries of a mapping. It
works for any motion, finds several wrong entries in one run, and names the entry to change.

An unknown drive may have an elastic gear, a lagging sensor, or few samples per stroke. Its
relations are therefore accepted within a factor of 2. Beyond that, a factor counts as a mistake
only if it is close to the factor of a common mistake.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from ema_bags.inputs.mapping import SHAFTS, AngleSource, ColumnMapping, SpeedSource
from ema_bags.inputs.motion import ThinnedMotion
from ema_core.columns.mistakes import Kind, Mistake, mistaken_unit
from ema_core.columns.tolerances import (
    MAPPED_SPEED,
    MAPPED_TRACKING,
    NEAR_MISTAKE,
    NEAR_MISTAKES,
    OVER_STOP,
    OVER_TOP_SPEED,
    PLAUSIBLE,
    is_beyond,
    is_within,
)
from ema_core.description import ActuatorDescription
from ema_core.units import ANGLES, SPEEDS

_MOST_CHANGES: Final = 3
_NEAR_RATIO: Final = (0.3, 3.0)
_WEIGHT_OF_RATIO: Final = 1.6
_MOST_OF_ONE: Final = 2


@dataclass(frozen=True)
class MeasuredRelations:
    """Measured relations between the columns under the unchanged mapping."""

    gain: float | None
    """Travel of the position divided by travel of the command [-]; None if unknown."""

    speed_ratio: float | None
    """Derivative of the position divided by speed times gear ratio [-]; None if unknown."""

    reach: float
    """Largest absolute position [rad]."""

    end_stop: float | None
    """End stop angle [rad]; None if unknown or not exceeded."""


@dataclass(frozen=True)
class MappingChange:
    """Suggested change of a mapping entry, with its evidence."""

    quantity: str
    """Mapped quantity to change, such as ``position``."""

    mistake: Mistake
    """Kind and factor of the mistake."""

    stated: Any
    """Current value of the entry."""

    value: Any
    """Suggested value of the entry."""

    relations: MeasuredRelations
    """Measured relations that the change explains."""

    @property
    def entry(self) -> str:
        """Name of the entry to change, such as ``unit``."""
        return self.mistake.kind.value


class _Option(NamedTuple):
    """Alternative interpretation of a quantity; ``factor`` multiplies the mapped factor."""

    factor: float
    changes: tuple[tuple[Mistake, Any], ...]
    weight: float


def explain(
    motion: ThinnedMotion, mapping: ColumnMapping, description: ActuatorDescription
) -> list[MappingChange] | None:
    """Return the smallest set of mapping changes that makes the columns consistent.

    The list is empty if the columns are consistent already. Return None if no set of changes makes
    them consistent.
    """
    p = description.parameters
    # An unknown drive has no known limits.
    is_known = description.is_modelled
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
        if reach * abs(position) > OVER_STOP * p.theta_stop:
            return False
        if (
            "command" in factors
            and gain is not None
            and not is_within(gain * position / factors["command"], MAPPED_TRACKING)
        ):
            return False
        if ratio is None:
            return True
        speed = factors["speed"]
        is_slow = fastest * abs(speed) <= OVER_TOP_SPEED * p.top_speed
        return is_within(ratio * position / speed, MAPPED_SPEED) and is_slow

    unchanged = dict.fromkeys(sources, 1.0)
    if agrees(unchanged):
        return []
    best: dict[str, _Option] | None = None
    least = np.inf
    if ratio is not None and _NEAR_RATIO[0] < ratio < _NEAR_RATIO[1]:
        # A wrong gear ratio is more likely than two mistakes that multiply to this factor.
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
    relations = MeasuredRelations(gain, ratio, reach, p.theta_stop if over_stop else None)
    return [
        MappingChange(name, mistake, getattr(sources[name], mistake.kind.value), value, relations)
        for name, item in best.items()
        for mistake, value in item.changes
    ]


def _scales_both(chosen: dict[str, _Option]) -> bool:
    """Return whether both position and speed are rescaled, not just reversed.

    The product of two rescalings can match almost any factor by chance.
    """
    factors = [chosen[name].factor for name in ("position", "speed") if name in chosen]
    return len(factors) == 2 and all(abs(abs(factor) - 1.0) > 1e-9 for factor in factors)


def _is_explained(value: float, change: float, changes: int) -> bool:
    """Return whether the ratio of two columns is plausible after changing their factors."""
    if abs(abs(change) - 1.0) < 1e-9:
        factor = PLAUSIBLE
    else:
        factor = NEAR_MISTAKE if changes == 1 else NEAR_MISTAKES
    return not is_beyond(value * change, factor)


def _options(source: AngleSource | SpeedSource, tau: float) -> Iterator[_Option]:
    """Yield possible interpretations of a quantity; less likely ones have larger weights."""
    is_angle = isinstance(source, AngleSource)
    units = ANGLES if is_angle else SPEEDS
    if source.unit not in units:  # a length, whose lead is stated or guessed
        units = {source.unit: 1.0}
    # Factor from the mapped shaft to the other; angles refer to the user shaft, speeds to the
    # motor.
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
        # Prefer common units to rare ones.
        rare = 0.5 * (unit in ("arcmin", "mrad/s", "mrad")) + 0.2 * is_second
        yield _Option(factor, tuple(changes), len(changes) + rare)
    for scale in (1e3, 1e-3):
        mistake = Mistake(Kind.SCALE, 1.0 / scale)
        yield _Option(scale, ((mistake, source.scale * scale),), 1.5)
