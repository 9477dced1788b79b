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

from ema_bags.inputs.mapping import ANGLES, SHAFTS, SPEEDS, AngleSource, Mapping, SpeedSource
from ema_bags.inputs.motion import ThinnedMotion
from ema_core.description import ActuatorDescription

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
class MappingChange:
    """A change of an entry of a mapped quantity, and the evidence for it."""

    quantity: str
    entry: str
    value: Any
    reason: str

    @property
    def remedy(self) -> str:
        """What to write in the mapping."""
        return f"{self.quantity}: {{{self.entry}: {_words(self.value)}}}"


class _Option(NamedTuple):
    """One interpretation of a quantity; ``factor`` multiplies the mapping's factor."""

    factor: float
    changes: tuple[tuple[str, Any], ...]
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
        is_slow = fastest * abs(speed) <= _OVER_SPEED * max(p.omega_max, p.V_max / p.k_e)
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
    facts = []
    if gain is not None:
        facts.append(f"the position moves {gain:.4g} times as far as the command")
    if ratio is not None:
        facts.append(f"its derivative is {ratio:.4g} times the speed times the gear ratio")
    if is_known and reach > p.theta_stop:
        facts.append(
            f"the position reaches {reach:.4g} rad, the end stop is at {p.theta_stop:g} rad"
        )
    return [
        MappingChange(
            name,
            entry,
            value,
            f"{name} has {entry} {_words(getattr(sources[name], entry))}, {_words(value)} was "
            f"probably meant ({', '.join(facts)})",
        )
        for name, item in best.items()
        for entry, value in item.changes
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
        changes: list[tuple[str, Any]] = []
        factor = float(sign) * size / units[source.unit]
        if unit != source.unit:
            changes.append(("unit", unit))
        if is_other:
            changes.append(("shaft", shaft))
            factor *= to_other
        if sign < 0:
            changes.append(("sign", -source.sign))
        # Units unusual for a whole angle are considered only if nothing else explains it.
        rare = 0.5 * (unit in ("arcmin", "mrad/s", "mrad")) + 0.2 * is_other
        yield _Option(factor, tuple(changes), len(changes) + rare)
    for scale in (1e3, 1e-3):
        yield _Option(scale, (("scale", source.scale * scale),), 1.5)


def _words(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
