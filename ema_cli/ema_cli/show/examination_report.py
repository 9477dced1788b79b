"""Text and JSON of an examination."""

import math
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

from ema_bags.inputs.doubt_wording import doubt_text
from ema_bags.inputs.doubts import DoubtKind
from ema_bags.inputs.examination import ColumnExamination, Examination, JointExamination
from ema_bags.inputs.examination_wording import findings, judged_lines, motion_line, timing_line
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
"""Doubts that the table shows in full."""

_HEADINGS = "quantity", "source", "unit", "range", "step", "doubt"


def report_lines(examination: Examination) -> list[str]:
    """Return the report, one string per line, without the mapping."""
    joints = examination.joints
    lines = [f"{examination.source}: {counted(len(joints), 'joint')}"]
    lines += [f"warning: {remark}" for remark in examination.remarks]
    for joint in joints:
        lines += ["", *_of_joint(joint)]
    if unused := examination.unused:
        shown = ", ".join(map(repr, unused[:_MOST_LISTED]))
        more = f" and {len(unused) - _MOST_LISTED} more" if len(unused) > _MOST_LISTED else ""
        lines += ["", f"not used: {shown}{more}"]
    return lines


def mapping_lines(examination: Examination) -> list[str]:
    """Return the mapping of most joints as YAML, and as comments what it leaves out."""
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


def _of_joint(joint: JointExamination) -> list[str]:
    lines = [f"joint {joint.joint}"] if joint.joint else []
    rows = [_clock_row(joint.mapping, joint)] if joint.mapping.is_table else []
    rows += [_row(column) for column in joint.columns]
    if rows:
        lines += text_table(_HEADINGS, rows).splitlines()
    if joint.timing is not None:
        lines.append(timing_line(joint.timing))
        lines.append(motion_line(joint))
    doubts = [*joint.doubts, *(doubt for column in joint.columns for doubt in column.doubts)]
    detailed = [doubt_text(doubt) for doubt in doubts if doubt.kind not in _SHORT]
    lines += [f"- {text}" for text in (*findings(joint), *detailed)]
    return lines + judged_lines(joint)


def _clock_row(mapping: ColumnMapping, joint: JointExamination) -> tuple[str, ...]:
    clock = mapping.clock
    doubts = ", ".join(_short(item.kind) for item in joint.doubts if item.quantity == "clock")
    source = clock.source or f"{clock.rate_hz:g} Hz"
    return "time", source, clock.unit if clock.source else "", "", "", doubts


def _row(column: ColumnExamination) -> tuple[str, ...]:
    source = f"{column.topic} {column.source}".strip()
    low, high = column.low, column.high
    reach = f"{low:.5g} to {high:.5g}" if math.isfinite(low) else "no number"
    step = f"{column.step:.3g}" if math.isfinite(column.step) else ""
    kinds = ", ".join(dict.fromkeys(_short(item.kind) for item in column.doubts))
    return column.quantity, source, column.unit, reach, step, kinds


def _short(kind: str) -> str:
    return str(kind).replace("_", " ")


def _plain(value: Any) -> Any:
    if isinstance(value, ColumnMapping):
        return mapping_text(value)
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
