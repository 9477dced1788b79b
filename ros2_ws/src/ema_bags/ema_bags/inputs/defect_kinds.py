# SPDX-License-Identifier: Apache-2.0
"""Kinds of defects of an import, by which a mapping accepts them."""

from enum import StrEnum, auto
from typing import Final

from ema_core.columns.mistakes import Kind


class DefectKind(StrEnum):
    """Kind of a defect of a mapping or of its data; ``docs/inputs.md`` lists the meanings."""

    CURRENT_ZERO = auto()
    COMMAND_FROZEN = auto()
    POSITION_FROZEN = auto()
    SPEED_FROZEN = auto()
    CURRENT_FROZEN = auto()
    POSITION_UNIT = auto()
    COMMAND_UNIT = auto()
    SPEED_UNIT = auto()
    CURRENT_UNIT = auto()
    POSITION_SIGN_REVERSED = auto()
    COMMAND_SIGN_REVERSED = auto()
    SPEED_SIGN_REVERSED = auto()
    CURRENT_SIGN_REVERSED = auto()
    POSITION_SHAFT = auto()
    COMMAND_SHAFT = auto()
    SPEED_SHAFT = auto()
    POSITION_SCALE = auto()
    COMMAND_SCALE = auto()
    SPEED_SCALE = auto()
    DRIVE_OF_I_Q = auto()
    GEAR_RATIO = auto()
    COMMAND_POSITION = auto()
    CURRENT_SIZE = auto()
    POSITION_JUMPS = auto()
    COMMAND_RANGE = auto()
    TWO_PUBLISHERS = auto()
    TEMPERATURE_RANGE = auto()
    NOT_FINITE = auto()
    TIME_NOT_MONOTONIC = auto()
    IMPOSSIBLE_SAMPLES = auto()
    VALUES_REPEAT = auto()
    LOST_SAMPLES = auto()
    FILLED_SAMPLES = auto()
    STAMPS_REBUILT = auto()
    SAMPLES_REORDERED = auto()
    DUPLICATE_SAMPLES = auto()
    POSITION_AT_MOTOR = auto()
    SPEED_RATIO = auto()
    POSITION_COMMANDED = auto()
    SPEED_COMMANDED = auto()
    CURRENT_COMMANDED = auto()
    ANGLE_WRAPS = auto()
    OTHER_RATE = auto()


_SUFFIXES: Final = {
    Kind.FROZEN: "frozen",
    Kind.UNIT: "unit",
    Kind.SIGN: "sign_reversed",
    Kind.SHAFT: "shaft",
    Kind.SCALE: "scale",
}


def kind_of_mistake(column: str, mistake: Kind) -> DefectKind:
    """Return the kind of defect of a column, such as ``position``, with a common mistake."""
    return DefectKind(f"{column}_{_SUFFIXES[mistake]}")
