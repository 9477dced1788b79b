"""Units, signs and shafts that explain how position, command and speed relate.

Right factors are those with which the position follows the command, its derivative is the speed
times the gear ratio, and nothing moves beyond what the actuator can. Of all combinations the one
with the fewest changes of the mapping is taken.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ema_bags.inputs.mapping import SHAFTS, AngleSource, Mapping, Source
from ema_bags.inputs.motion import ThinnedMotion
from ema_bags.inputs.units import ANGLES, SPEEDS
from ema_core.description import ActuatorDescription

_GAIN_WITHIN: Final = 0.35
_RATIO_WITHIN: Final = 0.03
_MOST_CHANGES: Final = 3
_NEAR_RATIO: Final = (0.3, 3.0)
_WEIGHT_OF_RATIO: Final = 1.6
_OVER_STOP: Final = 1.05
_OVER_SPEED: Final = 3.0


@dataclass(frozen=True)
class MappingChange:
    """A change of a mapping.

    Attributes
    ----------
    quantity, entry, value
        What is changed to what.
    reason
        What the data say.
    """

    quantity: str
    entry: str
    value: Any
    reason: str

    @property
    def remedy(self) -> str:
        """What to write in the mapping."""
        value = f"{self.value:g}" if isinstance(self.value, float) else self.value
        return f"{self.quantity}: {{{self.entry}: {value}}}"


@dataclass(frozen=True)
class _Option:
    """One way to read a quantity; ``factor`` is on top of that of the mapping."""

    factor: float
    changes: tuple[tuple[str, Any], ...]
    weight: float


def explain(
    motion: ThinnedMotion, mapping: Mapping, description: ActuatorDescription
) -> list[MappingChange] | None:
    """Return the fewest changes of a mapping with which its columns agree with each other.

    Returns
    -------
    list of Change, or None
        Empty where they agree as they are; None where no change explains them.
    """
    p = description.parameters
    # Of a drive of which nothing is known, neither are the limits.
    is_known = description.drive != "unknown"
    gain = motion.gain
    ratio = motion.speed_ratio
    reach = float(np.max(np.abs(motion.position)))
    fastest = (
        float(np.max(np.abs(motion.angle) / motion.seconds)) / p.tau if len(motion.angle) else 0.0
    )
    follows = "command" if mapping.command is not None else ""
    sources: dict[str, Source] = {"position": mapping.position}
    if mapping.command is not None:
        sources["command"] = mapping.command
    if mapping.speed is not None:
        sources["speed"] = mapping.speed

    def agrees(factors: dict[str, float]) -> bool:
        position = factors["position"]
        if is_known and reach * abs(position) > _OVER_STOP * p.theta_stop:
            return False
        if follows and gain is not None:
            new = gain * position / factors["command"]
            if abs(new - 1.0) > _GAIN_WITHIN:
                return False
        if ratio is not None:
            speed = factors["speed"]
            if abs(ratio * position / speed - 1.0) > _RATIO_WITHIN:
                return False
            if is_known and fastest * abs(speed) > _OVER_SPEED * max(p.omega_max, p.V_max / p.k_e):
                return False
        return True

    options = {name: list(_options(source, p.tau)) for name, source in sources.items()}
    best: tuple[float, dict[str, _Option] | None] | None = None
    if ratio is not None and _NEAR_RATIO[0] < ratio < _NEAR_RATIO[1]:
        # Another gear ratio is likelier than two mistakes that happen to give this factor.
        one = dict.fromkeys(sources, 1.0)
        if agrees(one | {"speed": ratio}):
            best = _WEIGHT_OF_RATIO, None
    if agrees(dict.fromkeys(sources, 1.0)):
        return []
    for combination in itertools.product(*options.values()):
        weight = sum(item.weight for item in combination)
        if (best is not None and weight >= best[0]) or not weight:
            continue
        if sum(bool(item.changes) for item in combination) > _MOST_CHANGES:
            continue
        chosen = dict(zip(options, combination, strict=True))
        if agrees({name: item.factor for name, item in chosen.items()}):
            best = weight, chosen
    if best is None or best[1] is None:
        return None
    numbers = {"gain": gain, "ratio": ratio, "reach": reach, "stop": p.theta_stop}
    return [
        MappingChange(name, entry, value, _reason(name, entry, value, sources[name], numbers))
        for name, item in best[1].items()
        for entry, value in item.changes
    ]


def _options(source: Source, tau: float) -> Iterator[_Option]:
    """Yield ways to read a quantity, each with its weight: the more unusual, the heavier."""
    is_angle = isinstance(source, AngleSource)
    units = ANGLES if is_angle else SPEEDS
    if source.unit not in units:  # a length: its lead is known, or a guess
        units = {source.unit: 1.0}
    # From the mapped shaft to the other one; angles go to the user shaft, speeds to the motor.
    to_other = tau if is_angle else 1.0 / tau
    if source.shaft != SHAFTS[0 if is_angle else 1]:  # pyright: ignore
        to_other = 1.0 / to_other
    other = next(item for item in SHAFTS if item != source.shaft)  # pyright: ignore
    for sign, (unit, size), is_other in itertools.product((1, -1), units.items(), (False, True)):
        changes: list[tuple[str, Any]] = []
        factor = float(sign) * size / units[source.unit]
        if unit != source.unit:
            changes.append(("unit", unit))
        if is_other:
            changes.append(("shaft", other))
            factor *= to_other
        if sign < 0:
            changes.append(("sign", -source.sign))
        # Units that nobody uses for the whole of an angle only where nothing else explains it.
        rare = 0.5 * (unit in ("arcmin", "mrad/s", "mrad")) + 0.2 * is_other
        yield _Option(factor, tuple(changes), len(changes) + rare)
    for scale in (1e3, 1e-3):
        yield _Option(scale, (("scale", source.scale * scale),), 1.5)


def _reason(
    name: str, entry: str, value: Any, source: Source, numbers: dict[str, float | None]
) -> str:
    gain, ratio, reach, stop = (numbers[key] for key in ("gain", "ratio", "reach", "stop"))
    facts = []
    if gain is not None:
        facts.append(f"the position moves {gain:.4g} times as far as the command")
    if ratio is not None:
        facts.append(f"its derivative is {ratio:.4g} times the speed times the gear ratio")
    if reach is not None and stop is not None and reach > stop:
        facts.append(f"the position reaches {reach:.4g} rad, the end stop is at {stop:g} rad")
    now = getattr(source, entry)
    now = f"{now:g}" if isinstance(now, float) else now
    what = (
        f"{name} has {entry} {now}, {value:g} was probably meant"
        if isinstance(value, float)
        else f"{name} has {entry} {now}, {value} was probably meant"
    )
    return f"{what} ({', '.join(facts)})"
