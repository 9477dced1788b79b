# SPDX-License-Identifier: Apache-2.0
"""Messages about wrong telemetry columns."""

from typing import Final

from ema_core.columns.errors import ColumnError, Reference, UnrelatedColumn
from ema_core.columns.mistakes import Kind, Mistake

_UNITS: Final = {
    "rad": "in radians",
    "deg": "in degrees",
    "turn": "in turns",
    "deg/s": "in degrees a second",
    "turn/s": "in turns a second",
    "/s": "per second",
    "/min": "per minute",
}
_REFERENCES: Final = {
    Reference.POSITION: "the position implies",
    Reference.SPEED: "the speed implies",
    Reference.INERTIA: "the inertia implies",
    Reference.DRIVE: "the drive implies",
    Reference.MODEL: "the model expects",
    Reference.RECORDS: "the healthy records have",
}


def question(column: str, mistake: Mistake, reference: Reference) -> str:
    """Return a question that asks the user whether a column has a certain mistake."""
    match mistake.kind:
        case Kind.SIGN:
            return "is its sign reversed?"
        case Kind.SCALE if mistake.factor > 1.0:
            return "are these thousandths read as whole units?"
        case Kind.SCALE:
            return "are whole units read as thousandths?"
        case Kind.GEAR_RATIO:
            return "was the gear ratio applied twice, or not at all?"
        case Kind.SHAFT:
            return "does it refer to the other side of the gear?"
        case Kind.AMPLITUDE:
            values = "a peak" if mistake.unit == "peak" else mistake.unit
            return f"is {values} given for {'a peak' if mistake.stated == 'peak' else 'RMS'}?"
        case Kind.UNIT:
            unit, stated = (_UNITS.get(name, f"in {name}") for name in mistake[2:])
            if column == "command":
                return f"is it {unit}, and the position {stated}?"
            if reference is Reference.RECORDS:
                return f"is it {unit}, and was {stated}?"
            return f"is it {unit}?" if mistake.is_of_si else f"is it {unit}, and not {stated}?"


def questions(error: ColumnError) -> str:
    """Return a question about the likely mistakes of a column, or "" if there are none."""
    parts = [question(error.columns[0], item, error.reference) for item in error.mistakes]
    return ", and ".join(text.rstrip("?") for text in parts) + "?" * bool(parts)


def error_text(error: ColumnError | UnrelatedColumn) -> str:
    """Return a message with the wrong column, its factor, and a question about likely mistakes."""
    reference = _REFERENCES[error.reference]
    if isinstance(error, UnrelatedColumn):
        return (
            f"the {error.column} has little to do with what {reference} (correlation "
            f"{error.correlation:.2f}): is it another column?"
        )
    text = f"the {' and '.join(error.columns)} is {error.factor:.3g} times what {reference}"
    rest = "the gear ratio" if error.reference is Reference.MODEL else "its scale"
    return f"{text}: {questions(error) or f'is its unit, or {rest}, right?'}"
