# SPDX-License-Identifier: Apache-2.0
"""Defects of a mapping or of its data, as typed values; ``defect_wording`` has their text."""

from dataclasses import dataclass

from ema_bags.inputs.defect_kinds import DefectKind
from ema_bags.inputs.factors import MappingChange
from ema_core.columns.errors import FrozenColumn, HeldColumn


@dataclass(frozen=True)
class SampleCount:
    """Number of samples with a defect."""

    count: int
    of: int
    """Number of samples received."""


@dataclass(frozen=True)
class LostSamples:
    """Samples missing in gaps."""

    count: int
    of: int
    """Number of samples received."""
    gaps: int
    is_interpolated: bool
    """Whether records are interpolated across short gaps."""


@dataclass(frozen=True)
class WrongStamps:
    """Stamps that do not increase."""

    decreasing: int
    repeated: int
    of: int
    """Number of samples received."""
    of_table: bool
    """Whether the samples are table rows, which have no arrival time."""


@dataclass(frozen=True)
class ValuesNotFinite:
    """Samples with NaN or infinite values."""

    by_column: dict[str, int]
    """Number of such values in each column that has any."""
    of: int
    """Number of samples received."""


@dataclass(frozen=True)
class OtherRate:
    """A sample rate that differs from the description."""

    hz: float
    """Measured sample rate [Hz]."""
    described_hz: float
    """Sample rate of the description [Hz]."""


@dataclass(frozen=True)
class RepeatedSamples:
    """Samples of all sensor columns that repeat each value; one sample per value is used."""

    times: float
    """Mean number of samples per value."""
    updated_hz: float
    """Rate at which the values change [Hz]."""


@dataclass(frozen=True)
class RepeatedValues:
    """Sensor columns that are updated more slowly than they are sampled."""

    columns: tuple[HeldColumn, ...]
    rate_hz: float
    """Sample rate [Hz]."""


@dataclass(frozen=True)
class PositionJumps:
    """Jumps of the position."""

    count: int
    largest: float
    """Largest jump [rad]."""


@dataclass(frozen=True)
class FarCommand:
    """A command far outside the travel."""

    command: float
    """First such command [rad]."""
    low: float
    """Lower end of the travel [rad]."""
    high: float
    """Upper end of the travel [rad]."""
    count: int
    of: int
    """Number of samples received."""


@dataclass(frozen=True)
class Frozen:
    """A column that is constant during motion."""

    column: FrozenColumn
    is_optional: bool
    """Whether the mapping may omit the column."""


@dataclass(frozen=True)
class GearRatio:
    """A gear ratio that differs from the description; user over motor speed."""

    measured: float
    """Ratio from position and speed [-]."""
    described: float
    """Ratio of the description [-]."""
    updated_hz: float | None
    """Update rate of the source [Hz] if it publishes each value several times; else None."""


@dataclass(frozen=True)
class Factor:
    """Factor of a column relative to its reference [-]."""

    factor: float
    """Position over command, speed over derivative of the position, or current over required
    current."""
    strokes: int | None = None
    """Number of strokes from which the factor is measured; None if not counted."""


@dataclass(frozen=True)
class ReversedCurrent:
    """A current with the opposite sign."""

    correlation: float
    """Correlation with the speed of an unknown drive, or with the required current [-]."""
    work_share: float | None
    """Net work over all work [-]; None for a modelled drive."""
    sign: int
    """Suggested sign."""


@dataclass(frozen=True)
class CurrentUnit:
    """A current that is wrong by a factor of 1000."""

    factor: float
    """Ratio to the required current [-]."""
    entry: str
    """Entry of the mapping to change: ``unit`` or ``scale``."""
    value: str | float
    """Suggested value of the entry."""


@dataclass(frozen=True)
class Setpoint:
    """A column that follows the command or a control law exactly."""

    lag: int = 0
    """Lag behind the command [samples]."""
    is_control_law: bool = False
    """Whether the column follows position error and speed, rather than the command."""


@dataclass(frozen=True)
class Publishers:
    """Several publishers of a joint."""

    rates_hz: tuple[float, ...]
    """Rate of each publisher [Hz]."""
    intervals_ms: tuple[float, ...]
    """Stamp intervals [ms]: two that alternate for two publishers; otherwise all of one period."""


@dataclass(frozen=True)
class OutOfRange:
    """A temperature that is out of range [degC]."""

    celsius: float
    lowest: float
    highest: float
    unit: str
    """Unit in which the temperature may be."""


Evidence = (
    SampleCount
    | LostSamples
    | WrongStamps
    | ValuesNotFinite
    | OtherRate
    | RepeatedSamples
    | RepeatedValues
    | PositionJumps
    | FarCommand
    | Frozen
    | MappingChange
    | GearRatio
    | Factor
    | ReversedCurrent
    | CurrentUnit
    | Setpoint
    | Publishers
    | OutOfRange
)
"""Measured figures of a defect."""


@dataclass(frozen=True)
class InputDefect:
    """A defect of a mapping or of its data."""

    kind: DefectKind
    """Kind, listed in the mapping's ``accept`` to accept the defect."""

    evidence: Evidence | None = None
    """Measured figures; None if the kind has none."""

    is_error: bool = True
    """Whether the defect makes estimates wrong. Otherwise it only costs data or is informative."""

    is_certain: bool = True
    """Whether the defect is proven.

    Live telemetry is withheld only for proven defects; more motion may refute the others.
    """

    needs_action: bool = True
    """Whether the user should change or check something. Otherwise the defect is informative."""
