# SPDX-License-Identifier: Apache-2.0
"""Generate docs/records.md from the definitions of estimate, health and reasons (``make records``).

A field has the same name in message, JSON, history and archive. `REPRESENTED` lists the exceptions.
tests/docs compares the page with the definitions.
"""

import inspect
import re
from collections.abc import Collection, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Final, NamedTuple

from ema_archive.tables import HEALTH, UNIT_TABLES
from ema_monitor.identification.estimate import Estimate
from ema_monitor.reasons import KINDS, Reason

ROOT: Final = Path(__file__).resolve().parents[1]
PAGE: Final = ROOT / "docs" / "records.md"

UNIT: Final = ("header", "actuator_id", "serial_number")
"""Fields that identify the unit and time of a message; a record already belongs to a unit."""

REPRESENTED: Final = {
    "start_ns": "window_start",
    "end_ns": "window_end",
    "reasons": "reason_codes",
    "comparison": "quantities",
}
"""Estimate fields whose message field has a different name and form."""

JSON_ALONE: Final = {
    "parts": "figures of the window, or of each stretch, for a baseline of windows"
}
"""Estimate fields that messages lack, with their meaning."""

MESSAGE_ALONE: Final = ("window", "excitation_limit", "reason")
"""Message fields that are derived from other fields, or locate the window."""

_HEAD: Final = """# Records of estimates and health

Generated from the definitions by `make records`. A field of an estimate has the same name in
messages, in JSON (`ema estimate --json`), in the history of a unit and in the table `estimates` of
an archive.

In JSON, stamps are integers in nanoseconds (`_ns`), flags and verdicts are names, a fault vector is
an object by name, and NaN is null. `ema estimate --json` adds `sigma`, the standard deviation of
each fault, and `start` and `end`, the times of the window from the start of the bag [s]. In the
table, each fault is a column, and each standard deviation a column `FAULT_sigma`.

Health in JSON (`ema predict --json`) has the names of the messages `Health`, `FaultHealth`,
`RemainingUsefulLife`, `ScenarioLife` and `UnitEvent` ([messages](api/messages.md)). The tables
`health`, `units` and `growth` of an archive have the same names, and whole nanoseconds (`_ns`) for
stamps. A life is a struct: `rul.hours_05` in SQL, too.
"""
_NOT_IN_TABLE: Final = "–"
_GROWTH: Final = UNIT_TABLES["growth"]
_HEALTH_PARTS: Final[tuple[tuple[str, str, str, Collection[str]], ...]] = (
    ("Health", "Health", "health", HEALTH.names),
    ("Fault or requirement", "FaultHealth", "growth", _GROWTH.names),
    ("Remaining life", "RemainingUsefulLife", "", [item.name for item in HEALTH.field("rul").type]),
    ("Event", "UnitEvent", "", [item.name for item in HEALTH.field("events").type.value_type]),
)
"""Title, message, table and columns of each part of a health report."""

_REASONS: Final = """## Reasons

`reasons` in JSON is a list of objects with `code` and the fields of that kind of reason.
`reason_codes` of the message has the codes, `reason` of message and JSON the sentences. A reason
with `stretches` and `of_stretches` applies only to some of the stretches of ordinary motion.

| code | figures | meaning |
|---|---|---|
"""
_COUNTS: Final = {item.name for item in fields(Reason)}
_FIELD: Final = re.compile(r"^((?:# .*\n)+)([^#\s]+) (\w+)(?: [^#=\s]+)?$", re.MULTILINE)


class MessageField(NamedTuple):
    """Type, name and meaning of a message field."""

    kind: str
    name: str
    meaning: str


def message_fields(name: str) -> list[MessageField]:
    """Return the fields of a message of ``ema_interfaces`` that have a comment, in order."""
    path = ROOT / "ema_interfaces" / "msg" / f"{name}.msg"
    return [
        MessageField(kind, name, " ".join(line[2:] for line in comment.splitlines()))
        for comment, kind, name in _FIELD.findall(path.read_text(encoding="utf-8"))
    ]


def records_page() -> str:
    """Return the content of docs/records.md."""
    lines = [_HEAD, "## Estimate", "", "| message | JSON | meaning |", "|---|---|---|"]
    lines += _estimate_rows()
    for title, message, table, schema in _HEALTH_PARTS:
        heading = f"message, JSON | {f'table `{table}`' if table else 'in the table'}"
        lines += ["", f"## {title}", "", f"| {heading} | meaning |", "|---|---|---|"]
        lines += _health_rows(message, schema)
    lines += ["", _REASONS + "\n".join(_reason_rows())]
    return "\n".join(lines) + "\n"


def _estimate_rows() -> Iterator[str]:
    in_json = {item.name for item in fields(Estimate)}
    by_message = {message: name for name, message in REPRESENTED.items()}
    for field in message_fields("FaultEstimate"):
        if field.name in UNIT:
            continue
        name = by_message.get(field.name, field.name)
        is_in_json = name in in_json or name in ("reason", "excitation_limit")
        shown = f"`{name}`" if is_in_json else "–"
        yield f"| `{field.name}` | {shown} | {_escaped(field.meaning)} |"
    for name, meaning in JSON_ALONE.items():
        yield f"| – | `{name}` | {meaning} |"


def _health_rows(message: str, columns: Collection[str]) -> Iterator[str]:
    for field in message_fields(message):
        is_stamp = field.kind == "builtin_interfaces/Time"
        column = f"{field.name}_ns" if is_stamp else field.name
        # In the tables, `unit` is the name of the actuator's unit.
        is_stored = column in columns and (message, column) != ("FaultHealth", "unit")
        shown = f"`{column}`" if is_stored else _NOT_IN_TABLE
        yield f"| `{field.name}` | {shown} | {_escaped(field.meaning)} |"


def _reason_rows() -> Iterator[str]:
    for code, kind in KINDS.items():
        names = [
            item.name for item in fields(kind) if item.name not in ("stretches", "of_stretches")
        ]
        figures = ", ".join(f"`{name}`" for name in names)
        meaning = inspect.cleandoc(kind.__doc__ or "").partition("\n")[0]
        yield f"| `{code}` | {figures} | {_escaped(meaning.rstrip('.'))} |"


def _escaped(text: str) -> str:
    return text.replace("|", "\\|").replace("``", "`").replace("*", "\\*")


if __name__ == "__main__":
    PAGE.write_text(records_page(), encoding="utf-8")
