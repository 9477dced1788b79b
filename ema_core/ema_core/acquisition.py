# SPDX-License-Identifier: Apache-2.0
"""Acquisition of telemetry: which columns are measured, and what a current sample means."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

from ema_core.quantity import Checked, flag, quantity, text

CURRENT_SAMPLINGS: Final = ("mean", "filtered", "instantaneous", "none")
"""Kinds of current samples: mean over the sample period, low-pass filtered value (first order) at
its end, instantaneous value at its end, or not measured."""

EFFORT_UNITS: Final = ("A", "N.m", "N")
"""Units of a recorded effort: current, joint torque, or rod force. Telemetry always contains the
equivalent current."""


@dataclass(frozen=True)
class Acquisition(Checked):
    """How the columns of telemetry are acquired.

    Raises
    ------
    ValueError
        If the sampling is unknown, the time constant is missing or out of range, or a time
        constant is given for an unfiltered current.
    """

    current: str = text("mean", "meaning of a current sample", CURRENT_SAMPLINGS)
    current_filter: float = quantity(0.0, "s", 0.0, 1.0, "time constant of the current filter")
    speed: bool = flag(True, "the speed is measured")
    command: bool = flag(True, "there is a position command")
    effort_unit: str = text(
        "A", "unit in which the effort was recorded", EFFORT_UNITS, compare=False
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.current == "filtered") != (self.current_filter > 0.0):
            raise ValueError(
                f"current_filter = {self.current_filter:g} s with current = {self.current}: "
                "expected a time constant above 0 for a filtered current, else 0"
            )

    def __str__(self) -> str:
        filtered = f" with {self.current_filter:g} s" if self.current_filter else ""
        current = "no current" if self.current == "none" else f"current {self.current}{filtered}"
        speed = "speed measured" if self.speed else "no speed"
        return f"{current}, {speed}{'' if self.command else ', no command'}"

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the telemetry columns that are empty because they are not measured."""
        absent = {
            "command": not self.command,
            "current": self.current == "none",
            "speed": not self.speed,
        }
        return tuple(name for name, is_absent in absent.items() if is_absent)

    def contradicting(self, missing: Collection[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the columns that contradict the acquisition, as two tuples of names.

        The first tuple has the columns that are empty although they are measured, the second the
        columns that have values although they are not measured.

        Parameters
        ----------
        missing
            Empty columns of the telemetry.
        """
        names = ("command", "current", "speed")
        empty = tuple(n for n in names if n in missing and n not in self.missing)
        return empty, tuple(n for n in names if n not in missing and n in self.missing)


USUAL: Final = Acquisition()
"""Default acquisition: all columns are measured, the current is the mean over a sample period."""
