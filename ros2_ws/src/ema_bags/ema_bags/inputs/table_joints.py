# SPDX-License-Identifier: Apache-2.0
"""Recognition of the joints of a table from motion and column names."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.doubts import Doubt, DoubtKind
from ema_bags.inputs.families import JointNames, joint_names
from ema_bags.inputs.guess import Guess, source_of, unit_after_name
from ema_bags.inputs.guessed_clock import guess_clock
from ema_bags.inputs.mapping import Clock, ColumnMapping, PayloadSource, Source
from ema_bags.inputs.names import hint_of, names_payload, roles_of, unit_in_name, unit_of, words_of
from ema_bags.inputs.recognition import Hint, IdentifiedColumn, JointColumns, Recognizer
from ema_bags.inputs.series import NO_STAMP
from ema_bags.inputs.table_columns import TableColumns
from ema_core.description import ActuatorDescription

_UNLIKE: Final[dict[str, set[str]]] = {
    "position": {"command", "error", "speed", "temperature"},
    "error": {"speed", "current", "temperature"},
    "command": {"speed", "current", "error", "temperature"},
    "speed": {"command", "error", "temperature"},
    "current": {"command", "error", "temperature"},
    "temperature": {"command", "error"},
}
"""Roles that exclude a column from each quantity, in the order in which columns are assigned."""

_OF_HINT: Final = {"effort": "current"}
"""Mapping section of each recognised quantity whose section has a different name."""

_PHYSICAL: Final = ("position", "speed", "command", "effort")
_CONFIRMED_VOTES: Final = 3
_MOST_CHANGES: Final = 0.05
_MOTOR_SIDE: Final = frozenset(("motor", "rotor", "m"))
_JOINT_SIDE: Final = frozenset(("joint", "link", "load", "output", "gear", "user", "arm"))


class _Recognised(NamedTuple):
    """Columns of one joint, identified from the motion."""

    joint: JointColumns | None
    alternatives: tuple[JointColumns, ...] = ()
    second_position: str = ""


class TableJoints:
    """Recognises the joints of a table.

    Parameters
    ----------
    columns
        The table.
    clock
        Known clock of the table; None to recognise it.
    description
        Description of the actuator; a modelled drive needs a command.

    Raises
    ------
    ValueError
        If a column looks like the time but is not monotonic.
    """

    def __init__(
        self, columns: TableColumns, clock: Clock | None, description: ActuatorDescription
    ) -> None:
        self._columns = columns
        self._needs_command = description.is_modelled
        self._doubts = [Doubt(DoubtKind.NO_NUMBERS, column=name) for name in columns.texts]
        if clock is None:
            clock, self._names = guess_clock(columns, self._doubts)
        else:
            self._names = [name for name in columns.values if name != clock.source]
        self._names = [name for name in self._names if name != columns.format.segment]
        self._payload = _payload_of(columns, self._names)
        self._names = [name for name in self._names if name != self._payload]
        self._clock = clock
        self._period = _period(columns, clock)

    def guesses(self) -> list[Guess]:
        """Return the recognised mapping of each joint, in the order of the columns.

        Raises
        ------
        ValueError
            If no column looks like the position, or like a command that the drive needs.
        """
        return [self._with_payload(guess) for guess in self._guesses()]

    def _with_payload(self, guess: Guess) -> Guess:
        """Return a guess with the payload column, which all joints share."""
        if not self._payload:
            return guess
        mapping = replace(guess.mapping, payload=PayloadSource(self._payload))
        doubt = Doubt(DoubtKind.NAME_ALONE, "payload", self._payload)
        return replace(guess, mapping=mapping, doubts=(*guess.doubts, doubt))

    def _guesses(self) -> list[Guess]:
        families = joint_names(self._names, self._hint)
        if families:
            recognised = self._voted(families, [self._recognise(f.columns) for f in families])
            guesses = [
                self._guess(family.joint, list(family.columns.values()), item, family)
                for family, item in zip(families, recognised, strict=True)
            ]
            return guesses + self._outside(families)
        by_name = {name: name for name in self._names}
        first = self._recognise(by_name)
        further = [joint for joint in first.alternatives if self._is_certain(joint)]
        guesses = [self._guess("", self._names, first)]
        for joint in further:
            names = [column.name for column in joint.columns.values()]
            guesses.append(self._guess(joint.columns["position"].name, names, _Recognised(joint)))
        if further:
            name = guesses[0].mapping.position.source
            guesses[0] = replace(guesses[0], joint=name)
        return guesses

    def _outside(self, families: Sequence[JointNames]) -> list[Guess]:
        """Return the joint among the columns that belong to no family, such as a gripper.

        The list is empty if there is none.
        """
        used = {name for family in families for name in family.columns.values()}
        remaining = [name for name in self._names if name not in used]
        named = [
            name
            for name in remaining
            if self._hint(name).supports("position") > 0.0 and not self._hint(name).is_commanded
        ]
        item = self._recognise({name: name for name in remaining}) if named else _Recognised(None)
        if item.joint is None or item.joint.columns["position"].name not in named:
            return []
        return [self._guess(item.joint.columns["position"].name, remaining, item)]

    def _hint(self, name: str) -> Hint:
        return hint_of(name, self._columns.units.get(name, ""))

    def _recognise(self, columns: Mapping[str, str]) -> _Recognised:
        """Identify the columns of a joint from the motion; ``columns`` is keyed by template."""
        names = [name for name in columns.values() if name not in self._columns.dates]
        if self._period <= 0.0:
            return _Recognised(None)
        values = {name: self._columns.values[name] for name in names}
        recognizer = Recognizer(values, self._period, self._hint)
        joints = recognizer.joints()
        if not joints:
            return _Recognised(None)
        first, *further = joints
        used = {column.name for column in first.columns.values()}
        second = [
            name
            for name in recognizer.copies(first.columns["position"].name)
            if name not in used
            and not self._hint(name).is_commanded
            and self._hint(name).supports("position") > 0.0
        ]
        if not second:
            return _Recognised(first, tuple(further))
        return _with_joint_side(first, second[0], tuple(further))

    def _is_certain(self, joint: JointColumns) -> bool:
        """Return whether a further joint has measured columns, rather than setpoints."""
        hints = [self._hint(column.name) for column in joint.columns.values()]
        return (
            joint.columns["position"].is_confirmed
            and self._hint(joint.columns["position"].name).supports("position") > 0.0
            and len(joint.columns) > 1
            and not any(hint.is_commanded for hint in hints)
        )

    def _voted(
        self, families: Sequence[JointNames], recognised: Sequence[_Recognised]
    ) -> list[_Recognised]:
        """Return the columns of each joint, from the templates on which most joints agree."""
        votes: dict[str, dict[str, int]] = {quantity: {} for quantity in _PHYSICAL}
        for family, item in zip(families, recognised, strict=True):
            template_of = {name: template for template, name in family.columns.items()}
            for quantity, column in item.joint.columns.items() if item.joint else ():
                template = template_of[column.name]
                counts = votes[quantity]
                counts[template] = counts.get(template, 0) + (
                    _CONFIRMED_VOTES if column.is_confirmed else 1
                )
        templates: dict[str, tuple[str, bool]] = {}
        for quantity in _PHYSICAL:
            free = {
                template: count
                for template, count in votes[quantity].items()
                if template not in {name for name, _ in templates.values()}
            }
            if free:
                best = max(free, key=lambda name: free[name])
                templates[quantity] = best, free[best] >= _CONFIRMED_VOTES
        if "position" not in templates:
            return [_Recognised(None) for _ in families]
        return [
            _Recognised(
                JointColumns(
                    {
                        quantity: IdentifiedColumn(family.columns[template], is_confirmed)
                        for quantity, (template, is_confirmed) in templates.items()
                        if template in family.columns
                    }
                ),
                (),
                item.second_position,
            )
            for family, item in zip(families, recognised, strict=True)
        ]

    def _guess(
        self,
        joint: str,
        names: Sequence[str],
        recognised: _Recognised,
        family: JointNames | None = None,
    ) -> Guess:
        columns, doubts = self._columns, list(self._doubts)
        kinds = {name: self._roles(name) for name in names}
        taken = _chosen(kinds, recognised, doubts)
        phases = {
            kind: name
            for name, quantities in kinds.items()
            for kind in quantities
            if kind.startswith("phase_")
        }
        if list(phases) == ["phase_a"] and "current" not in taken:
            taken["current"] = phases.pop("phase_a")  # A is the unit: there is no other phase
        if "position" not in taken and {"command", "error"} <= taken.keys():
            taken["position"] = f"{taken['command']} - {taken['error']}"
            doubts.append(Doubt(DoubtKind.FROM_ERROR, "position", taken["position"]))
        if "command" in taken:
            taken.pop("error", None)
        self._require(taken, doubts)
        if self._needs_command and "temperature" in taken:
            name = taken.pop("temperature")
            doubts.append(Doubt(DoubtKind.WINDING, "temperature", name))
        sources: dict[str, Any] = {}
        for quantity, name in taken.items():
            unit = unit_of(columns.units.get(name, "")) or unit_in_name(name)
            if quantity == "current" and not unit:
                unit = unit_after_name(name)
            sources[quantity] = source_of(quantity, name, unit, doubts)
            if quantity in ("current", "speed") and self._hint(name).is_commanded:
                doubts.append(Doubt(DoubtKind.SET_POINT, quantity, name))
        if "current" not in sources and len(phases) >= 2:
            listed = tuple(phases[key] for key in sorted(phases))
            doubts.append(Doubt(DoubtKind.PHASE_CURRENTS, "current", names=listed))
        doubts += [
            Doubt(DoubtKind.NOT_FOUND, quantity)
            for quantity in ("speed", "current")
            if quantity not in sources
        ]
        if family is not None:
            sources = {name: _of_family(item, family) for name, item in sources.items()}
        mapping = ColumnMapping(
            **sources, joint=family.joint if family else "", clock=self._clock, table=columns.format
        )
        return Guess(mapping, tuple(doubts), joint, recognised.second_position)

    def _roles(self, name: str) -> set[str]:
        """Return the roles of a column; a unit decides which quantity it measures."""
        roles, hint = roles_of(name), self._hint(name)
        of_unit = {_OF_HINT.get(quantity, quantity) for quantity in hint.quantities}
        if of_unit & {"position", "speed", "current", "temperature"} and "error" not in roles:
            roles = roles - {"position", "speed", "current", "temperature"} | of_unit
        return roles

    def _require(self, taken: Mapping[str, str], doubts: list[Doubt]) -> None:
        missing = [name for name in ("position",) if name not in taken]
        if "command" not in taken and "error" not in taken:
            if self._needs_command:
                missing.append("command (or position error)")
            doubts.append(Doubt(DoubtKind.NO_COMMAND, "command"))
        if missing:
            raise ValueError(
                f"{self._columns.path}: no column was recognized as {' or '.join(missing)}; "
                f"columns: {', '.join(self._columns.values)}: write a mapping by hand"
                + "; with drive: unknown in the actuator file, no command is needed"
                * ("position" in taken)
            )


def _payload_of(columns: TableColumns, names: Sequence[str]) -> str:
    """Return the column whose name and values indicate a payload, or "".

    A payload rarely changes, and its smallest value is 0. The position of a gripper is not a
    payload.
    """
    candidates = [name for name in names if _is_payload(name, columns.values[name])]
    return candidates[0] if len(candidates) == 1 else ""


def _is_payload(name: str, values: NDArray[np.float64]) -> bool:
    if not names_payload(name, is_flag=True):
        return False
    levels = values[np.isfinite(values)].astype(float)
    if not len(levels) or np.min(levels) != 0.0:
        return False
    is_flag = set(np.unique(levels)) <= {0.0, 1.0}
    rests = np.count_nonzero(np.diff(levels)) <= _MOST_CHANGES * len(levels)
    return bool(rests and names_payload(name, is_flag=is_flag))


def _with_joint_side(
    joint: JointColumns, second: str, alternatives: tuple[JointColumns, ...]
) -> _Recognised:
    """Return the recognised columns with the position of the joint rather than of the motor.

    The position is swapped with the column ``second`` if, by their names, the position is at the
    motor and ``second`` at the joint.
    """
    position = joint.columns["position"]
    if not (words_of(position.name) & _MOTOR_SIDE and words_of(second) & _JOINT_SIDE):
        return _Recognised(joint, alternatives, second)
    columns = {**joint.columns, "position": position._replace(name=second)}
    return _Recognised(JointColumns(columns), alternatives, position.name)


def _chosen(
    kinds: Mapping[str, set[str]], recognised: _Recognised, doubts: list[Doubt]
) -> dict[str, str]:
    """Return a column name per quantity, identified from the motion or else from the names.

    ``kinds`` has the quantities that the name of each column suggests. Doubts are appended to
    ``doubts``.
    """
    physical = dict(recognised.joint.columns) if recognised.joint else {}
    if not physical:
        doubts.append(Doubt(DoubtKind.NO_MOTION))
    taken = {_OF_HINT.get(quantity, quantity): column.name for quantity, column in physical.items()}
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
                doubts.append(Doubt(DoubtKind.NAME_ALONE, quantity, taken[quantity]))
        key = "effort" if quantity == "current" else quantity
        if key in physical and not physical[key].is_confirmed:
            is_named = quantity in kinds[taken[quantity]]
            kind = DoubtKind.NAME_ALONE if is_named else DoubtKind.VALUES_ALONE
            doubts.append(Doubt(kind, quantity, taken[quantity]))
        matches += _alternatives(recognised.alternatives, key, matches)
        if matches and quantity in taken:
            doubts.append(Doubt(DoubtKind.ALTERNATIVES, quantity, taken[quantity], tuple(matches)))
    return taken


def _of_family(source: Source, family: JointNames) -> Source:
    """Return a source in which ``{joint}`` replaces the joint in the column names."""
    text = source.source
    for template, name in sorted(family.columns.items(), key=lambda item: -len(item[1])):
        if text == name:
            return replace(source, source=template)
        text = text.replace(name, template)
    return replace(source, source=text)


def _alternatives(joints: Iterable[JointColumns], quantity: str, named: Sequence[str]) -> list[str]:
    return [
        joint.columns[quantity].name
        for joint in joints
        if quantity in joint.columns and joint.columns[quantity].name not in named
    ]


def _period(columns: TableColumns, clock: Clock) -> float:
    """Return the sample period [s].

    It is the period of the fixed rate if the clock has no source, otherwise the median difference
    of the times; 0 if there are fewer than two times.
    """
    if not clock.source:
        return 1.0 / clock.rate_hz
    stamps: NDArray[np.int64] = columns.stamps(clock)
    steps = np.abs(np.diff(stamps[stamps != NO_STAMP]))
    return 1e-9 * float(np.median(steps)) if len(steps) else 0.0
