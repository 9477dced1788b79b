# SPDX-License-Identifier: Apache-2.0
"""A recognised mapping, refined so that units, signs and shafts agree with the motion."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.conversion import convert, with_lead
from ema_bags.inputs.doubts import Doubt, DoubtKind
from ema_bags.inputs.factors import explain
from ema_bags.inputs.mapping import (
    AngleSource,
    ColumnMapping,
    CurrentSource,
    Source,
    SpeedSource,
    TemperatureSource,
)
from ema_bags.inputs.motion import ThinnedMotion
from ema_core.columns.tolerances import CORRELATED, CURRENT_SIZE, is_beyond
from ema_core.description import ActuatorDescription
from ema_core.units import LINEAR, TORQUES

_LEAD: Final = 0.005


@dataclass(frozen=True)
class Guess:
    """A recognised mapping of one joint, with its doubts."""

    mapping: ColumnMapping
    """The recognised mapping."""

    doubts: tuple[Doubt, ...]
    """Reasons for the choices, and open questions."""

    joint: str = ""
    """Name of the joint; empty if the file has one joint."""

    second_position: str = ""
    """Column with a second measurement of the position, such as a motor encoder; empty if none."""


def source_of(quantity: str, name: str, unit: str, doubts: list[Doubt]) -> Source:
    """Return the source of a quantity in a table column; add a doubt if its unit is unknown."""
    kinds = {"speed": SpeedSource, "current": CurrentSource, "temperature": TemperatureSource}
    kind = kinds.get(quantity, AngleSource)
    [choices] = [item.metadata["choices"] for item in fields(kind) if item.name == "unit"]
    more: dict[str, Any] = {"unit": unit} if unit in choices else {}
    if not more:
        doubts.append(Doubt(DoubtKind.UNIT_GUESSED, quantity, name))
    if quantity == "current":
        plain_name = name.lower().replace(" ", "").replace("_", "")
        if unit in TORQUES or any(w in plain_name for w in ("torque", "trq", "moment")):
            more = {"unit": "N.m"} | more | {"kind": "motor_torque"}
        elif "iq" in plain_name:
            more["kind"] = "i_q"
    return kind(source=name, **more)


def unit_after_name(name: str) -> str:
    """Return "A" for a name such as ``current_A``; else ""."""
    return "A" if re.search(r"[^A-Za-z]A$", name) else ""


def refine(
    guess: Guess,
    raw: Mapping[str, NDArray[np.float64]],
    stamps_ns: NDArray[np.int64],
    description: ActuatorDescription,
) -> Guess:
    """Refine a guess: choose units, signs and shafts so that the columns agree.

    A speed or current that never changes is removed. ``raw`` has the source values by key.
    """
    mapping, doubts = guess.mapping, list(guess.doubts)
    for name in ("position", "command", "error", "speed"):
        source = getattr(mapping, name)
        if source is None or source.unit not in LINEAR:
            continue
        if not with_lead(description, mapping).parameters.lead:
            mapping = replace(mapping, **{name: replace(source, lead=_LEAD)})
            doubts.append(Doubt(DoubtKind.LEAD_GUESSED, name, source.source, value=_LEAD))
    for name in ("current", "speed"):
        values, source = raw.get(name), getattr(mapping, name)
        if (
            source is not None
            and values is not None
            and len(np.unique(values[np.isfinite(values)])) < 2
        ):
            mapping = replace(mapping, **{name: None})
            doubts.append(Doubt(DoubtKind.CONSTANT, name, source.source))

    for name in ("position", "command", "error", "speed", "current"):
        encoding = _encoding(raw[name]) if name in raw else ""
        if encoding and (source := getattr(mapping, name)) is not None:
            mapping = replace(mapping, **{name: replace(source, encoding=encoding)})
            doubts.append(Doubt(DoubtKind.ENCODING, name, source.source, entry=encoding))
    current = mapping.current
    is_unsigned = current and not current.encoding and np.nanmin(raw["current"]) >= 0.0
    if current and current.kind == "equivalent" and is_unsigned:
        # On topics, the sign of a magnitude comes from the speed.
        if mapping.is_table or mapping.speed is not None:
            mapping = replace(mapping, current=replace(current, kind="magnitude"))
        doubts.append(Doubt(DoubtKind.MAGNITUDE, "current", current.source))

    def moving(of: ColumnMapping) -> ThinnedMotion | None:
        columns = convert(raw, of, with_lead(description, of))
        return ThinnedMotion.of(columns, stamps_ns, description.parameters.tau)

    motion = moving(mapping)
    if motion is None:
        doubts.append(Doubt(DoubtKind.FEW_SAMPLES))
        return replace(guess, mapping=mapping, doubts=tuple(doubts))
    for change in explain(motion, mapping, description) or ():
        source = getattr(mapping, change.quantity)
        section = replace(source, **{change.entry: change.value})
        mapping = replace(mapping, **{change.quantity: section})
        doubts.append(
            Doubt(
                DoubtKind.CHANGED,
                change.quantity,
                source.source,
                entry=f"{change.entry} {change.value}",
                change=change,
            )
        )
    if not description.is_modelled and description.parameters.tau == 1.0:
        mapping = _of_joint(mapping)
    motion = moving(mapping)
    if mapping.current is not None and motion is not None:
        if not description.is_modelled:
            # Without known inertia and friction, only the sign can be determined.
            dissipation = motion.dissipation
            relation = None if dissipation is None else (1.0, dissipation)
        else:
            relation = motion.current_against_torque(description.parameters)
        current = _refined(mapping.current, relation, description, doubts)
        mapping = replace(mapping, current=current)
    return replace(guess, mapping=mapping, doubts=tuple(doubts))


def _of_joint(mapping: ColumnMapping) -> ColumnMapping:
    """Return the mapping with the speed at the user shaft, for a joint without a gear ratio."""
    speed = mapping.speed
    return mapping if speed is None else replace(mapping, speed=replace(speed, shaft="user"))


def _encoding(values: NDArray[np.float64]) -> str:
    """Return the encoding of a signed register that was read as unsigned, or "".

    Read as unsigned, negative values are much larger than the positive values.
    """
    values = values[np.isfinite(values)]
    for bits in (16, 32):
        half = 2.0 ** (bits - 1)
        high, low = values[values >= half], values[values < half]
        if not len(high) or not len(low) or np.any(values % 1.0) or np.min(values) < 0.0:
            continue
        if np.max(values) < 2.0 * half and np.max(low) < half / 2.0:
            if np.min(high) > 1.5 * half:
                return f"twos_complement_{bits}"
            if bits == 16 and np.max(high) < 1.5 * half:
                return "sign_bit_16"
    return ""


def _refined(
    current: CurrentSource,
    relation: tuple[float, float] | None,
    description: ActuatorDescription,
    doubts: list[Doubt],
) -> CurrentSource:
    """Return the current source with the sign and shaft that match inertia and friction.

    ``relation`` is the ratio of the effort to the expected effort, 1 if there is no data sheet, and
    their correlation; None if unknown. Doubts are added to ``doubts``.
    """

    def note(kind: DoubtKind, value: float = 0.0) -> None:
        doubts.append(Doubt(kind, "current", current.source, value=value))

    if relation is None or abs(relation[1]) < CORRELATED:
        note(DoubtKind.SIGN_UNCHECKED)
        return current
    size, correlation = relation
    if correlation < 0.0:
        current = replace(current, sign=-current.sign)
        note(DoubtKind.SIGN_REVERSED, current.sign)
    tau = description.parameters.tau
    if current.kind == "motor_torque" and abs(np.log(size * tau)) < abs(np.log(size)):
        current = replace(current, kind="joint_torque")
        note(DoubtKind.JOINT_TORQUE)
    elif current.kind == "equivalent" and is_beyond(size, CURRENT_SIZE):
        note(DoubtKind.EFFORT_SIZE, size)
    note(DoubtKind.SAMPLING_UNKNOWN)
    return current
