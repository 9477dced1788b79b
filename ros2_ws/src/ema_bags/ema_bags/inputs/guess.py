"""Guessing a mapping from names, magnitudes and physical relations, for the user to confirm."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.change_wording import change_reason
from ema_bags.inputs.conversion import convert, with_lead
from ema_bags.inputs.factors import explain
from ema_bags.inputs.guessed_clock import guess_clock
from ema_bags.inputs.mapping import (
    AngleSource,
    Clock,
    ColumnMapping,
    CurrentSource,
    Source,
    SpeedSource,
    TemperatureSource,
)
from ema_bags.inputs.motion import ThinnedMotion
from ema_bags.inputs.names import hint_of, roles_of, unit_in_name, unit_of, words_of
from ema_bags.inputs.recognition import JointColumns, Recognizer
from ema_bags.inputs.series import NO_STAMP
from ema_bags.inputs.table_columns import TableColumns
from ema_core.description import ActuatorDescription
from ema_core.units import LINEAR, TORQUES

JOINT_STATE: Final = "sensor_msgs/msg/JointState"
_LEAD: Final = 0.005
_NO_COMMAND: Final = "no command was recognized: tracking is not assessed"
_COMMANDS: Final = {
    "control_msgs/msg/JointTrajectoryControllerState": "reference.positions",
    "control_msgs/msg/SingleDOFStateStamped": "dof_state.reference",
    "std_msgs/msg/Float64": "data",
    "std_msgs/msg/Float32": "data",
    "std_msgs/msg/Float64MultiArray": "data[0]",
    "std_msgs/msg/Float32MultiArray": "data[0]",
}
_UNLIKE: Final[dict[str, set[str]]] = {
    "position": {"command", "error", "speed", "temperature"},
    "error": {"speed", "current", "temperature"},
    "command": {"speed", "current", "error", "temperature"},
    "speed": {"command", "error", "temperature"},
    "current": {"command", "error", "temperature"},
    "temperature": {"command", "error"},
}
"""Roles that exclude a column from each quantity, in the order in which columns are assigned."""


@dataclass(frozen=True)
class Guess:
    """A guessed mapping and its reasons."""

    mapping: ColumnMapping
    """The guessed mapping."""

    remarks: list[str]
    """Reasons and open questions to show to the user."""


def guess_columns(
    columns: TableColumns, clock: Clock | None = None, *, needs_command: bool = True
) -> Guess:
    """Guess the mapping of the columns of a table.

    Parameters
    ----------
    columns
        The table.
    clock
        Known clock of the table; None to guess it.
    needs_command
        Whether the drive needs a position command.

    Raises
    ------
    ValueError
        If no column looks like the position or the required command, or if a column looks like the
        time but is not monotonic.
    """
    remarks = [f"column {name!r} contains no numbers" for name in columns.texts]
    if clock is None:
        clock, unused = guess_clock(columns, remarks)
    else:
        unused = [name for name in columns.values if name != clock.source]
    kinds = {name: roles_of(name) for name in unused}
    taken = _chosen(columns, clock, kinds, remarks)
    phases = {
        kind: name
        for name, quantities in kinds.items()
        for kind in quantities
        if kind.startswith("phase_")
    }
    if list(phases) == ["phase_a"] and "current" not in taken:
        taken["current"] = phases.pop("phase_a")  # in A, not of phase A: there is no other phase
    if "position" not in taken and {"command", "error"} <= taken.keys():
        taken["position"] = f"{taken['command']} - {taken['error']}"
        remarks.append(f"position is {taken['position']}: the error is command minus position")
    if "command" in taken:
        taken.pop("error", None)
    missing = [name for name in ("position",) if name not in taken]
    if "command" not in taken and "error" not in taken:
        if needs_command:
            missing.append("command (or position error)")
        remarks.append(_NO_COMMAND)
    if missing:
        raise ValueError(
            f"{columns.path}: no column was recognized as {' or '.join(missing)}; columns: "
            f"{', '.join(columns.values)}: write a mapping by hand"
            + "; with drive: unknown in the actuator file, no command is needed"
            * ("position" in taken)
        )
    if needs_command and "temperature" in taken:
        remarks.append(
            f"{taken.pop('temperature')!r} may be the winding temperature: if so, map it as "
            "temperature"
        )
    sources: dict[str, Any] = {}
    for quantity, name in taken.items():
        unit = unit_of(columns.units.get(name, "")) or unit_in_name(name)
        if quantity == "current" and not unit and re.search(r"[^A-Za-z]A$", name):
            unit = "A"
        sources[quantity] = _source(quantity, name, unit, remarks)
    if "current" not in sources and len(phases) >= 2:
        names = ", ".join(phases[key] for key in sorted(phases))
        remarks.append(
            f"phase currents {names}: map them as current: {{kind: phase_currents, phases: "
            f"[{names}], torque_sign: COLUMN}}, where COLUMN has the sign of the torque"
        )
    for quantity in ("speed", "current"):
        if quantity not in sources:
            remarks.append(
                f"no column was recognized as {quantity}: it is assumed not to be measured"
            )
    return Guess(ColumnMapping(**sources, clock=clock, table=columns.format), remarks)


def _chosen(
    columns: TableColumns, clock: Clock, kinds: Mapping[str, set[str]], remarks: list[str]
) -> dict[str, str]:
    """Return a column name per quantity, identified from the motion or else from the names."""
    joints = _joints(columns, clock, list(kinds))
    physical = dict(joints[0].columns) if joints else {}
    if not joints:
        remarks.append("the columns could not be identified from the motion, only from their names")
    taken = {
        "current" if quantity == "effort" else quantity: column.name
        for quantity, column in physical.items()
    }
    for quantity, without in _UNLIKE.items():
        matches = [
            name
            for name, quantities in kinds.items()
            if quantity in quantities and not quantities & without and name not in taken.values()
        ]
        if matches and quantity not in taken:
            # With several joints, prefer columns that share words with the position's name.
            position = words_of(taken.get("position", ""))
            taken[quantity] = max(matches, key=lambda name: len(words_of(name) & position))
            matches.remove(taken[quantity])
            if physical and quantity not in ("temperature", "error"):
                remarks.append(f"{quantity} {taken[quantity]!r} is a guess from its name alone")
        key = "effort" if quantity == "current" else quantity
        if key in physical and not physical[key].is_confirmed:
            by = "its name" if quantity in kinds[taken[quantity]] else "its values"
            remarks.append(f"{quantity} {taken[quantity]!r} is a guess from {by} alone")
        matches += [
            joint.columns[key].name
            for joint in joints[1:]
            if key in joint.columns and joint.columns[key].name not in matches
        ]
        if matches and quantity in taken:
            listed = ", ".join(map(repr, matches))
            remarks.append(f"{quantity} {taken[quantity]!r} is a guess; alternatives: {listed}")
    return taken


def _joints(columns: TableColumns, clock: Clock, names: list[str]) -> list[JointColumns]:
    """Identify joints from the motion in the named columns."""
    if clock.source:
        stamps = columns.stamps(clock)
        steps = np.abs(np.diff(stamps[stamps != NO_STAMP]))
        period = 1e-9 * float(np.median(steps)) if len(steps) else 0.0
    else:
        period = 1.0 / clock.rate_hz
    if period <= 0.0:
        return []
    values = {name: columns.values[name] for name in names if name not in columns.dates}
    return Recognizer(
        values, period, lambda name: hint_of(name, columns.units.get(name, ""))
    ).joints()


def guess_topics(
    topics: Mapping[str, str], joints: Mapping[str, list[str]], *, needs_command: bool = True
) -> Guess:
    """Guess the mapping of the topics of a bag from their types and names.

    Parameters
    ----------
    topics
        Message type by topic.
    joints
        Joint names in order of decreasing travel, for each ``sensor_msgs/msg/JointState`` topic.
    needs_command
        Whether the drive needs a position command.

    Raises
    ------
    ValueError
        If there is no joint state topic, or no topic looks like the required command.
    """
    remarks: list[str] = []
    states = [name for name, names in joints.items() if names]
    command = _command_topic(topics)
    if not states or (command is None and needs_command):
        missing = "recognized as the command" if states else f"of type {JOINT_STATE} with a joint"
        reason = f"no topic {missing}"
        listed = ", ".join(f"{name} ({kind})" for name, kind in topics.items()) or "none"
        raise ValueError(
            f"{reason}; topics: {listed}: write a mapping by hand, following the examples"
        )
    topic = states[0]
    joint, *alternatives = [*joints[topic], *states[1:]]
    if alternatives:
        listed = ", ".join(alternatives)
        remarks.append(
            f"joint {joint!r} on {topic} is a guess: it moves most; alternatives: {listed}"
        )
    if command is None:
        remarks.append(_NO_COMMAND)
    elif command.source.endswith("[0]"):
        remarks.append(f"command.source {command.source} is a guess")
    remarks.append(
        "effort may be a current, a motor torque, a joint torque, or unused: confirm kind"
    )
    mapping = ColumnMapping(
        position=AngleSource("position", topic),
        command=command,
        speed=SpeedSource("velocity", topic, shaft="user"),
        current=CurrentSource("effort", topic),
        joint=joint,
        clock=Clock("header"),
    )
    return Guess(mapping, remarks)


def refine(
    guess: Guess,
    raw: Mapping[str, NDArray[np.float64]],
    stamps_ns: NDArray[np.int64],
    description: ActuatorDescription,
) -> Guess:
    """Refine a guess: choose units, signs and shafts so that the columns agree."""
    mapping, remarks = guess.mapping, list(guess.remarks)
    for name in ("position", "command", "error", "speed"):
        source = getattr(mapping, name)
        if source is None or source.unit not in LINEAR:
            continue
        if not with_lead(description, mapping).parameters.lead:
            mapping = replace(mapping, **{name: replace(source, lead=_LEAD)})
            remarks.append(f"{name}.lead {_LEAD:g} m is a guess: enter the travel per shaft turn")
    for name in ("current", "speed"):
        values = raw.get(name)
        if values is not None and len(np.unique(values[np.isfinite(values)])) < 2:
            mapping = replace(mapping, **{name: None})
            remarks.append(f"{name} never changes: it is assumed not to be measured")

    for name in ("position", "command", "error", "speed", "current"):
        encoding = _encoding(raw[name]) if name in raw else ""
        if encoding and (source := getattr(mapping, name)) is not None:
            mapping = replace(mapping, **{name: replace(source, encoding=encoding)})
            remarks.append(
                f"{name}.encoding {encoding}: its values are from a signed register read as "
                "unsigned"
            )
    current = mapping.current
    is_unsigned = current and not current.encoding and np.nanmin(raw["current"]) >= 0.0
    if current and current.kind == "equivalent" and is_unsigned:
        mapping = replace(mapping, current=replace(current, kind="magnitude"))
        remarks.append(
            "current.kind magnitude: the current is never negative; confirm that no load keeps "
            "it above 0"
        )

    def moving(of: ColumnMapping) -> ThinnedMotion | None:
        columns = convert(raw, of, with_lead(description, of))
        return ThinnedMotion.of(columns, stamps_ns, description.parameters.tau)

    motion = moving(mapping)
    if motion is None:
        return Guess(mapping, [*remarks, "too few samples to compare the columns"])
    for change in explain(motion, mapping, description) or ():
        section = replace(getattr(mapping, change.quantity), **{change.entry: change.value})
        mapping = replace(mapping, **{change.quantity: section})
        remarks.append(f"{change.quantity}.{change.entry} {change.value}: {change_reason(change)}")
    motion = moving(mapping)
    if mapping.current is not None and motion is not None:
        if description.drive == "unknown":
            # Without known inertia and friction, only the sign can be determined.
            dissipation = motion.dissipation
            relation = None if dissipation is None else (1.0, dissipation)
        else:
            relation = motion.current_against_torque(description.parameters)
        current = _refined(mapping.current, relation, description, remarks)
        mapping = replace(mapping, current=current)
    return Guess(mapping, remarks)


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
    remarks: list[str],
) -> CurrentSource:
    """Return the current source with the sign and shaft that match inertia and friction."""
    if relation is None or abs(relation[1]) < 0.4:
        remarks.append("the sign and unit of the current cannot be checked")
        return current
    size, correlation = relation
    if correlation < 0.0:
        current = replace(current, sign=-current.sign)
        remarks.append(
            f"current.sign {current.sign}: with the opposite sign, it would oppose the acceleration"
        )
    tau = description.parameters.tau
    if current.kind == "motor_torque" and abs(np.log(size * tau)) < abs(np.log(size)):
        current = replace(current, kind="joint_torque")
        remarks.append("current.kind joint_torque: too large for a motor torque")
    elif current.kind == "equivalent" and not 0.03 < size < 30.0:
        remarks.append(
            f"the current is {size:.3g} times what the described inertia and friction require: "
            "is it a torque?"
        )
    remarks.append(
        "current.sampling cannot be inferred from the data: choose mean, filtered or instantaneous"
    )
    return current


def _source(quantity: str, name: str, unit: str, remarks: list[str]) -> Source:
    kinds = {"speed": SpeedSource, "current": CurrentSource, "temperature": TemperatureSource}
    kind = kinds.get(quantity, AngleSource)
    [choices] = [item.metadata["choices"] for item in fields(kind) if item.name == "unit"]
    more: dict[str, Any] = {"unit": unit} if unit in choices else {}
    if not more:
        remarks.append(f"{quantity}.unit is a guess: the name {name!r} has no unit")
    if quantity == "current":
        words = name.lower().replace(" ", "").replace("_", "")
        if unit in TORQUES or any(w in words for w in ("torque", "trq", "moment")):
            more = {"unit": "N.m"} | more | {"kind": "motor_torque"}
        elif "iq" in words:
            more["kind"] = "i_q"
    return kind(source=name, **more)


def _command_topic(topics: Mapping[str, str]) -> AngleSource | None:
    for name in sorted(topics, key=lambda name: "command" not in roles_of(name)):
        if path := _COMMANDS.get(topics[name]):
            # A setpoint without a stamp holds until the next message.
            between = "hold" if topics[name].startswith("std_msgs") else "linear"
            return AngleSource(path, name, between=between)
    return None
