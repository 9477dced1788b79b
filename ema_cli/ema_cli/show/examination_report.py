# SPDX-License-Identifier: Apache-2.0
"""Report of an examination of recordings, as text or JSON."""

import math
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, NamedTuple, Self

from ema_bags.inputs.defect_wording import defect_text
from ema_bags.inputs.doubt_wording import doubt_text
from ema_bags.inputs.doubts import DoubtKind
from ema_bags.inputs.examination import ColumnExamination, Examination, JointExamination
from ema_bags.inputs.examination_wording import findings, judged_lines, motion_line, timing_line
from ema_bags.inputs.input_defect import InputDefect
from ema_bags.inputs.mapping import ColumnMapping, mapping_text
from ema_core.wording import counted, text_table

_MOST_LISTED = 40
_SHORT = frozenset(
    (
        *(DoubtKind.UNIT_GUESSED, DoubtKind.SAMPLING_UNKNOWN, DoubtKind.NAME_ALONE),
        *(DoubtKind.VALUES_ALONE, DoubtKind.NOT_FOUND, DoubtKind.NO_COMMAND),
        *(DoubtKind.CLOCK_UNIT, DoubtKind.EFFORT_KIND, DoubtKind.NO_NUMBERS),
    )
)
"""Doubts that are shown in the table; other doubts have a line of text."""

_HEADINGS = "quantity", "source", "unit", "range", "step", "doubt"


class _Doubts(NamedTuple):
    """Doubts to print about a joint, or about all joints."""

    short: dict[tuple[DoubtKind, str], None]
    """Kind and quantity of each doubt in the table, in order."""
    texts: dict[str, None]
    """Other doubts as text, in order."""

    @classmethod
    def of_joint(cls, joint: JointExamination) -> Self:
        of_columns = [doubt for column in joint.columns for doubt in column.doubts]
        is_table = joint.mapping.is_table
        of_clock = [doubt for doubt in joint.doubts if is_table and doubt.quantity == "clock"]
        return cls(
            {
                (doubt.kind, doubt.quantity): None
                for doubt in (*of_clock, *of_columns)
                if doubt.kind in _SHORT
            },
            {
                doubt_text(doubt): None
                for doubt in (*joint.doubts, *of_columns)
                if doubt.kind not in _SHORT
            },
        )

    @classmethod
    def common(cls, joints: Sequence[JointExamination]) -> Self:
        """Return the doubts that all joints share; none if there are fewer than two joints."""
        if len(joints) < 2:
            return cls({}, {})
        first, *further = map(cls.of_joint, joints)
        return cls(
            {key: None for key in first.short if all(key in item.short for item in further)},
            {text: None for text in first.texts if all(text in item.texts for item in further)},
        )

    def without(self, common: Self) -> Self:
        return type(self)(
            {key: None for key in self.short if key not in common.short},
            {text: None for text in self.texts if text not in common.texts},
        )

    def row(self, quantity: str) -> str:
        """Return the table cell with the doubts about a quantity."""
        return ", ".join(_short(kind) for kind, of in self.short if of == quantity)

    def lines(self) -> list[str]:
        """Return a line for each kind of doubt, and for each other doubt."""
        quantities: dict[DoubtKind, list[str]] = {}
        for kind, quantity in self.short:
            quantities.setdefault(kind, []).append("time" if quantity == "clock" else quantity)
        lines = [f"{_short(kind)}: {', '.join(names)}" for kind, names in quantities.items()]
        return [f"- {line}" for line in (*lines, *self.texts)]


def report_lines(examination: Examination) -> list[str]:
    """Return the lines of the report, without the mapping."""
    joints = examination.joints
    lines = [f"{examination.source}: {counted(len(joints), 'joint')}"]
    lines += [f"warning: {remark}" for remark in examination.remarks]
    common = _Doubts.common(joints)
    if of_all := common.lines():
        lines += ["", "all joints", *of_all]
    for joint in joints:
        lines += ["", *_of_joint(joint, _Doubts.of_joint(joint).without(common))]
    if unused := examination.unused:
        shown = ", ".join(map(repr, unused[:_MOST_LISTED]))
        more = f" and {len(unused) - _MOST_LISTED} more" if len(unused) > _MOST_LISTED else ""
        lines += ["", f"not used: {shown}{more}"]
    return lines


def mapping_lines(examination: Examination) -> list[str]:
    """Return the lines of the mapping of most joints in YAML; comments list excluded joints."""
    first, *further = examination.mappings
    lines = mapping_text(first).splitlines()
    for mapping in further:
        names = ", ".join(mapping.joints or (mapping.joint,))
        lines.append(f"# joint {names} needs a mapping of its own: ema check --joint")
    return lines


def as_record(examination: Examination) -> dict[str, Any]:
    """Return an examination as JSON values; unknown numbers are null."""
    record = _plain(examination)
    record["mappings"] = [mapping_text(mapping) for mapping in examination.mappings]
    return record


def _of_joint(joint: JointExamination, doubts: _Doubts) -> list[str]:
    lines = [f"joint {joint.joint}"] if joint.joint else []
    rows = [_clock_row(joint.mapping, doubts)] if joint.mapping.is_table else []
    rows += [_row(column, doubts) for column in joint.columns]
    if rows:
        count = len(_HEADINGS) if doubts.short else len(_HEADINGS) - 1
        lines += text_table(_HEADINGS[:count], [row[:count] for row in rows]).splitlines()
    if joint.timing is not None:
        lines.append(timing_line(joint.timing))
        lines.append(motion_line(joint))
    lines += [f"- {text}" for text in (*findings(joint), *doubts.texts)]
    return lines + judged_lines(joint)


def _clock_row(mapping: ColumnMapping, doubts: _Doubts) -> tuple[str, ...]:
    clock = mapping.clock
    source = clock.source or f"{clock.rate_hz:g} Hz"
    return "time", source, clock.unit if clock.source else "", "", "", doubts.row("clock")


def _row(column: ColumnExamination, doubts: _Doubts) -> tuple[str, ...]:
    source = f"{column.topic} {column.source}".strip()
    low, high = column.low, column.high
    reach = f"{low:.5g} to {high:.5g}" if math.isfinite(low) else "no number"
    step = f"{column.step:.3g}" if math.isfinite(column.step) else ""
    return column.quantity, source, column.unit, reach, step, doubts.row(column.quantity)


def _short(kind: str) -> str:
    return str(kind).replace("_", " ")


def _plain(value: Any) -> Any:
    if isinstance(value, ColumnMapping):
        return mapping_text(value)
    if isinstance(value, InputDefect):
        text = defect_text(value)._asdict()
        return {item.name: _plain(getattr(value, item.name)) for item in fields(value)} | text
    if is_dataclass(value):
        return {item.name: _plain(getattr(value, item.name)) for item in fields(value)}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
