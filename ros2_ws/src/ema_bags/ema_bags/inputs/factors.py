"""Units, signs and shafts that explain how position, command and speed relate.

Right factors are those with which the position follows the command, its derivative is the speed
times the gear ratio, and nothing moves beyond what the actuator can. Of all combinations the one
with the fewest changes of the mapping is taken.

A drive whose controller is unknown may have an elastic gear, a sensor that lags or few samples in
a stroke. There a relation within a factor of 2 is accepted, and only a factor near a mistaken unit,
sign or shaft is a mistake.
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
    """How columns of a mapping relate as they are.

    Attributes
    ----------
    gain
        Motion of the position over that of the command [-]; None if it is unknown.
    speed_ratio
        Derivative of the position over the speed times the gear ratio [-]; None if it is unknown.
    reach
        Largest angle of the position [rad].
    end_stop
        Angle of the end stop [rad]; None if it is unknown or not exceeded.
    """

    gain: float | None
    speed_ratio: float | None
    reach: float
    end_stop: float | None


@dataclass(frozen=True)
class MappingChange:
    """A change of an entry of a mapped quantity, and the evidence for it.

    Attributes
    ----------
    quantity
        The column that is wrong.
    mistake
        The mistake in it.
    stated, value
        Value of the entry in the mapping, and the value that was probably meant.
    relations
        The relations that it explains.
    """

    quantity: str
    mistake: Mistake
    stated: Any
    value: Any
    relations: Relations

    @property
    def entry(self) -> str:
        """The entry of the mapping."""
        return self.mistake.kind.value


class _Option(NamedTuple):
    """One interpretation of a quantity; ``factor`` multiplies the mapping's factor."""

    factor: float
    changes: tuple[tuple[Mistake, Any], ...]
    weight: float


def explain(
    motion: ThinnedMotion, mapping: Mapping, description: ActuatorDescription
) -> list[MappingChange] | None:
    """Return the fewest changes of a mapping with which its columns agree with each other.

    Empty where they agree as they are; None where no change explains them.
    """
    p = description.parameters
    # The limits of an unknown drive are unknown as well.
    is_known = description.drive != "unknown"
    gain = motion.gain
    ratio = motion.speed_ratio if is_known else motion.stroke_ratio
    reach = float(np.max(np.abs(motion.position)))
    fastest = motion.fastest / p.tau
    given = {"position": mapping.position, "command": mapping.command, "speed": mapping.speed}
    sources = {name: source for name, source in given.items() if source is not None}

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

    as_they_are = dict.fromkeys(sources, 1.0)
    if agrees(as_they_are):
        return []
    best: dict[str, _Option] | None = None
    least = np.inf
    if ratio is not None and _NEAR_RATIO[0] < ratio < _NEAR_RATIO[1]:
        # Another gear ratio is likelier than two mistakes that happen to give this factor.
        least = _WEIGHT_OF_RATIO if agrees(as_they_are | {"speed": ratio}) else np.inf
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

    Such products come near any factor by chance.
    """
    both = [chosen[name].factor for name in ("position", "speed") if name in chosen]
    return len(both) == 2 and all(abs(abs(factor) - 1.0) > 1e-9 for factor in both)


def _is_explained(value: float, change: float, changes: int) -> bool:
    """Return whether the ratio of two columns is right after a change of their factors."""
    left = value * change
    if left <= 0.0:
        return False
    if abs(abs(change) - 1.0) < 1e-9:
        within = _PLAUSIBLE
    else:
        # Two changes together come near more factors by chance.
        within = _NEAR_UNIT if changes == 1 else _NEAR_UNITS
    return 1.0 / within < left < within


def _options(source: AngleSource | SpeedSource, tau: float) -> Iterator[_Option]:
    """Yield ways to read a quantity, each with its weight: the more unusual, the heavier."""
    is_angle = isinstance(source, AngleSource)
    units = ANGLES if is_angle else SPEEDS
    if source.unit not in units:  # a length: its lead is known, or a guess
        units = {source.unit: 1.0}
    # From the mapped shaft to the other one; angles go to the user shaft, speeds to the motor.
    to_other = tau if is_angle else 1.0 / tau
    if source.shaft != SHAFTS[0 if is_angle else 1]:
        to_other = 1.0 / to_other
    shaft = next(item for item in SHAFTS if item != source.shaft)
    for sign, (unit, size), is_other in itertools.product((1, -1), units.items(), (False, True)):
        changes: list[tuple[Mistake, Any]] = []
        factor = float(sign) * size / units[source.unit]
        if unit != source.unit:
            changes.append((mistaken_unit(units, unit, source.unit), unit))
        if is_other:
            changes.append((Mistake(Kind.SHAFT, 1.0 / to_other), shaft))
            factor *= to_other
        if sign < 0:
            changes.append((Mistake(Kind.SIGN, -1.0), -source.sign))
        # Units unusual for a whole angle are considered only if nothing else explains it.
        rare = 0.5 * (unit in ("arcmin", "mrad/s", "mrad")) + 0.2 * is_other
        yield _Option(factor, tuple(changes), len(changes) + rare)
    for scale in (1e3, 1e-3):
        mistake = Mistake(Kind.SCALE, 1.0 / scale)
        yield _Option(scale, ((mistake, source.scale * scale),), 1.5)
