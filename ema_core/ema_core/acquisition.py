"""How the columns of telemetry are acquired: what a sample of the current stands for."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

from ema_core.quantity import Checked, flag, quantity, text

CURRENT_SAMPLINGS: Final = ("mean", "filtered", "instantaneous", "none")
"""What a sample of the current stands for: its mean over the sample period, its value at the end
of it behind a first-order low-pass filter, that value itself, or nothing: it is not measured."""

EFFORT_UNITS: Final = ("A", "N.m", "N")
"""Units in which an effort is recorded: as a current, a torque of the joint or a force of the rod.
Telemetry has the equivalent current in any case."""


@dataclass(frozen=True)
class Acquisition(Checked):
    """How telemetry is acquired.

    Raises
    ------
    ValueError
        When the sampling is unknown, or the time constant is missing, impossible or given for a
        current that is not filtered.
    """

    current: str = text("mean", "what a sample of the current stands for", CURRENT_SAMPLINGS)
    current_filter: float = quantity(0.0, "s", 0.0, 1.0, "time constant of the current's filter")
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
                "a filtered current needs a time constant above 0, any other 0"
            )

    def __str__(self) -> str:
        filtered = f" with {self.current_filter:g} s" if self.current_filter else ""
        current = "no current" if self.current == "none" else f"current {self.current}{filtered}"
        speed = "speed measured" if self.speed else "no speed"
        return f"{current}, {speed}{'' if self.command else ', no command'}"

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the columns of telemetry that are not measured, and so are empty."""
        absent = {
            "command": not self.command,
            "current": self.current == "none",
            "speed": not self.speed,
        }
        return tuple(name for name, is_absent in absent.items() if is_absent)

    def contradiction(self, missing: Collection[str]) -> str:
        """Return how telemetry with these empty columns contradicts the acquisition."""
        reasons = [
            f"the {name} is declared as measured ({self}), but its column is empty"
            if name in missing
            else f"the {name} is declared as not measured ({self}), but its column is filled"
            for name in ("command", "current", "speed")
            if (name in missing) != (name in self.missing)
        ]
        return "; ".join(reasons)


USUAL: Final = Acquisition()
"""The current's mean over a sample, and all measured."""
