# SPDX-License-Identifier: Apache-2.0
"""Settings of the simulated actuator, each with its description, unit and range."""

from dataclasses import asdict, dataclass, make_dataclass
from typing import Any, Final

from ema_core.cause_profiles import GRAMMAR, cause_profiles
from ema_core.faults import FAULTS
from ema_core.quantity import Checked, quantity, text, texts


@dataclass(frozen=True)
class FileSettings(Checked):
    """Description file of the simulated actuator."""

    actuator_file: str = text("", "actuator file (YAML); empty: the built-in actuator")


@dataclass(frozen=True)
class RunSettings(Checked):
    """Name of the actuator and rate of the simulation; ValueError if a value is out of range."""

    actuator_id: str = text("", "name of the actuator; empty: from its description")
    serial_number: str = text("", "serial number; empty: from its description")
    rate: float = quantity(1.0, "-", 0.01, 100.0, "ratio of simulated to wall time")


@dataclass(frozen=True)
class ResolutionSettings(Checked):
    """Resolution of the sensors, 0 for perfect sensors; ValueError if a value is out of range."""

    command: float = quantity(0.0, "rad", 0.0, 1.0, "resolution of the command; 0: perfect")
    current: float = quantity(0.0, "A", 0.0, 1e3, "resolution of the current; 0: perfect")
    position: float = quantity(0.0, "rad", 0.0, 1.0, "resolution of the position; 0: perfect")
    speed: float = quantity(0.0, "rad/s", 0.0, 1e4, "resolution of the speed; 0: perfect")

    def resolutions(self) -> dict[str, float]:
        """Return the resolution, keyed by column, without perfect sensors."""
        return {name: value for name, value in asdict(self).items() if value > 0.0}


@dataclass(frozen=True)
class CauseSettings(Checked):
    """Hidden causes of the simulated actuator; ValueError if a cause is invalid."""

    causes: tuple[str, ...] = texts(f"hidden causes other than faults, {GRAMMAR} (docs/faults.md)")

    def __post_init__(self) -> None:
        super().__post_init__()
        cause_profiles(self.causes)


FaultSettings: Final[Any] = make_dataclass(
    "FaultSettings",
    [
        (
            fault.name,
            float,
            quantity(fault.healthy, "-", 0.0, fault.highest, f"{fault.label}; {fault.meaning}"),
        )
        for fault in FAULTS
    ],
    frozen=True,
    bases=(Checked,),
)
"""Fault vector of the simulated actuator, with a field for each fault."""
