# SPDX-License-Identifier: Apache-2.0
"""Mapping from third-party files, bags and topics to telemetry columns."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Final, Self

import yaml

from ema_bags.inputs.dates import ORDERS
from ema_bags.inputs.defect_kinds import DefectKind
from ema_bags.inputs.field_path import FieldPath
from ema_core.acquisition import CURRENT_SAMPLINGS, EFFORT_UNITS, Acquisition
from ema_core.quantity import Checked, quantity, text, texts
from ema_core.settings_file import load_settings
from ema_core.units import ANGLES, CURRENTS, FORCES, LENGTHS, LINEAR, LINEAR_SPEEDS, SPEEDS, TORQUES
from ema_core.wording import unknown_name

TEMPERATURES: Final = {"degC": (1.0, 0.0), "K": (1.0, -273.15), "degF": (5.0 / 9.0, -160.0 / 9.0)}
"""Factor and offset that convert each temperature unit to degC."""
TIMES_NS: Final = {
    **{"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1},
    **{"min": 60_000_000_000, "h": 3_600_000_000_000, "day": 86_400_000_000_000},
    **{"excel_day": 86_400_000_000_000, "matlab_day": 86_400_000_000_000},
    **{"s_1904": 1_000_000_000, "filetime": 100, "dotnet_ticks": 100},
}
"""Duration of each time unit [ns]."""
EPOCHS: Final = {
    **{"excel_day": 25_569, "matlab_day": 719_529, "s_1904": 2_082_844_800},
    **{"filetime": 116_444_736_000_000_000, "dotnet_ticks": 621_355_968_000_000_000},
}
"""Start of 1970, expressed in the units whose epoch is not 1970."""

SHAFTS: Final = ("user", "motor")
"""Shafts to which an angle or speed can refer."""

ENCODINGS: Final = {
    "": (0, 0),
    "sign_bit_16": (1 << 15, 1),
    "sign_bit_32": (1 << 31, 1),
    "twos_complement_16": (1 << 15, 2),
    "twos_complement_32": (1 << 31, 2),
}
"""Signed registers read as unsigned: value of the sign bit, and how many times to subtract it.

The sign bit is subtracted once for sign-magnitude and twice for two's complement.
"""

CLOCKS: Final = ("header", "sent", "arrival")
"""Clocks of topics: message header, publication time, reception time."""

_ANY_JOINT: Final = "{joint}"
_QUANTITIES: Final = ("position", "command", "error", "speed", "current")
_KINDS: Final = (
    *("equivalent", "i_q", "phase_currents", "motor_torque", "joint_torque", "magnitude"),
    "force",
)
# Conventions of i_q: peak or RMS phase current, or peak times sqrt(3/2) for the power-invariant
# transformation.
_AMPLITUDES: Final = ("", "peak", "rms", "power")
# Entries that are written even if they have their default values.
_ALWAYS_SHOWN: Final = ("unit", "shaft", "sampling", "kind")


@dataclass(frozen=True)
class Source(Checked):
    """Source of a quantity. Value in SI units: ``sign * scale * unit * raw + offset``.

    Raises
    ------
    ValueError
        If an entry has an invalid value; the error names the entry, its value and the expected
        values.
    """

    source: str = text("", "table column, or field path in a message")
    topic: str = text("", "topic of the message; empty for a table")
    type: str = text("", "message type; empty: the type that is published")
    names_topic: str = text("", "topic that publishes the element names, if the message has none")
    joint: str = text("", "joint whose array element is read")
    unit: str = text("", "unit of the source")
    scale: float = quantity(1.0, "-", -1e12, 1e12, "factor, in addition to the unit conversion")
    sign: int = quantity(1, "-", -1, 1, "-1 if the source counts in the opposite direction")
    offset: float = quantity(0.0, "-", -1e12, 1e12, "added last, in rad, rad/s, A or K")
    encoding: str = text("", "sign encoding of a register read as unsigned", tuple(ENCODINGS))
    between: str = text(
        "linear",
        "how values between messages are obtained: interpolated or held",
        ("linear", "hold"),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.sign:
            raise ValueError(f"sign = {self.sign}: expected 1 or -1")
        if self.scale == 0.0:
            raise ValueError("scale = 0: expected a factor other than 0")
        if self.topic:
            for path in filter(None, self.numbers().values()):
                FieldPath(path)
        elif self.type or self.names_topic:
            entry = "type" if self.type else "names_topic"
            raise ValueError(f"{entry} = {getattr(self, entry)!r} without topic: expected both")

    def numbers(self, name: str = "") -> dict[str, str]:
        """Return the columns or field paths to read for a quantity, by key."""
        return {name: self.source}


@dataclass(frozen=True)
class _ShaftSource(Source):
    """Source of an angle or speed; a lead converts a length to an angle."""

    shaft: str = text("user", "shaft of the angle or speed", SHAFTS)
    lead: float = quantity(
        0.0, "m", 0.0, 10.0, "travel per shaft turn for a length unit, if the description has none"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.lead and self.unit not in LINEAR:
            raise ValueError(f"lead = {self.lead:g} with unit = {self.unit}: expected no lead")


@dataclass(frozen=True)
class AngleSource(_ShaftSource):
    """Source of a position, a command or a position error."""

    unit: str = text("rad", "unit of the source", (*ANGLES, *LENGTHS))


@dataclass(frozen=True)
class SpeedSource(_ShaftSource):
    """Column or message field with the measured speed of the user shaft or the motor."""

    unit: str = text("rad/s", "unit of the source", (*SPEEDS, *LINEAR_SPEEDS))
    shaft: str = text("motor", "shaft of the speed", SHAFTS)


@dataclass(frozen=True)
class CurrentSource(Source):
    """Source of the current, with its kind and sampling.

    Raises
    ------
    ValueError
        If the unit does not match the kind, or an entry is missing or not applicable to the kind.
    """

    unit: str = text("A", "unit of the source", (*CURRENTS, *TORQUES, *FORCES))
    kind: str = text("equivalent", "kind of current or effort", _KINDS)
    amplitude: str = text("", "i_q: amplitude convention; empty: peak", _AMPLITUDES)
    phases: tuple[str, ...] = texts("phase_currents: sources of two or three phases")
    torque_sign: str = text("", "phase_currents: source with the sign of the torque")
    sampling: str = text("mean", "what a sample represents", CURRENT_SAMPLINGS)
    filter_time: float = quantity(0.0, "s", 0.0, 1.0, "time constant of a filtered current")

    def __post_init__(self) -> None:
        super().__post_init__()
        Acquisition(self.sampling, self.filter_time)
        units = TORQUES if self.kind.endswith("torque") else CURRENTS
        if self.kind == "force":
            units = FORCES
        elif self.kind in ("equivalent", "magnitude"):
            # Any unit of effort is allowed; only drives with a modelled controller need amperes.
            units = CURRENTS | TORQUES | FORCES
        if self.unit not in units:
            raise ValueError(
                f"unit = {self.unit!r} with kind = {self.kind}: expected {', '.join(units)}"
            )
        if self.amplitude and self.kind != "i_q":
            raise ValueError(
                f"amplitude = {self.amplitude!r} with kind = {self.kind}: only i_q has an amplitude"
            )
        is_phases = self.kind == "phase_currents"
        if is_phases != bool(self.phases) or is_phases != bool(self.torque_sign):
            raise ValueError(
                f"phases = {list(self.phases)} and torque_sign = {self.torque_sign!r} with kind = "
                f"{self.kind}: phase_currents requires both; other kinds allow neither"
            )
        if is_phases and len(self.phases) not in (2, 3):
            raise ValueError(
                f"phases = {list(self.phases)}: expected the sources of two or three phases"
            )

    def numbers(self, name: str = "") -> dict[str, str]:
        """Return the columns or field paths to read for a quantity, by key."""
        if not self.phases:
            return super().numbers(name)
        named = {f"phase_{letter}": path for letter, path in zip("abc", self.phases, strict=False)}
        return named | {"torque_sign": self.torque_sign}


@dataclass(frozen=True)
class TemperatureSource(Source):
    """Source of the motor, gear or oil temperature, on which friction depends."""

    unit: str = text("degC", "unit of the source", tuple(TEMPERATURES))
    between: str = text(
        "hold", "how values between messages are obtained: interpolated or held", ("linear", "hold")
    )


@dataclass(frozen=True)
class PayloadSource(Source):
    """Source of the payload: its mass, a flag, or the position of a gripper.

    The machine carries a payload while ``sign * scale * raw + offset`` is larger than ``above``.
    """

    above: float = quantity(0.0, "-", -1e12, 1e12, "largest value without a payload")
    between: str = text(
        "hold", "how values between messages are obtained: interpolated or held", ("linear", "hold")
    )


@dataclass(frozen=True)
class Clock(Checked):
    """Clock of the samples; invalid values raise ValueError."""

    source: str = text("", "table column; or header, sent, arrival or a field path of a message")
    unit: str = text("s", "time unit of a column or field", (*TIMES_NS, *ORDERS))
    rate_hz: float = quantity(0.0, "Hz", 0.0, 1e6, "sample rate; 0: measured from the stamps")


@dataclass(frozen=True)
class Table(Checked):
    """Format of a table; empty entries are detected, invalid values raise ValueError."""

    separator: str = text("", "column separator", ("", ",", ";", "\t", "|", " "))
    decimal: str = text("", "decimal sign", ("", ".", ","))
    segment: str = text(
        "", "column whose value changes at the start of each record, such as a cycle number"
    )


@dataclass(frozen=True)
class ColumnMapping(Checked):
    """Sources of the telemetry columns.

    Raises
    ------
    ValueError
        If both ``command`` and ``error`` are given, if columns and topics are mixed, or if
        ``accept`` contains an unknown defect.
    """

    position: AngleSource
    """Angle of the user shaft or the motor shaft."""
    command: AngleSource | None = None
    """Position command; None if ``error`` is given or the controller is unknown."""
    error: AngleSource | None = None
    """Position error (command minus position), as an alternative to ``command``."""
    speed: SpeedSource | None = None
    """Speed; None if not measured."""
    current: CurrentSource | None = None
    """Current or effort; None if not measured."""
    temperature: TemperatureSource | None = None
    """Temperature; None if not measured."""
    payload: PayloadSource | None = None
    """Payload; None if it is not known."""
    joint: str = text("", "default joint of sources without a joint, and replacement for {joint}")
    joints: tuple[str, ...] = texts("several joints instead of joint; each is a separate actuator")
    clock: Clock = Clock()
    table: Table = Table()
    fill_lost: int = quantity(0, "-", 0, 10, "longest run of lost samples to interpolate")
    accept: tuple[str, ...] = texts("names of defects to accept")

    def __post_init__(self) -> None:
        super().__post_init__()
        kinds = [kind.value for kind in DefectKind]
        for name in self.accept:
            if name not in kinds:
                raise ValueError(f"accept: {unknown_name('defect', name, kinds)}")
        if self.command is not None and self.error is not None:
            raise ValueError(
                "command and error are both set: expected either the command or the position error"
            )
        if self.joints and (self.joint or len(set(self.joints)) < len(self.joints)):
            joint = f"joint = {self.joint!r} and " if self.joint else ""
            raise ValueError(
                f"{joint}joints = {list(self.joints)}: expected one joint, or distinct joints"
            )
        sources = dict(self.sources())
        for name, item in sources.items():
            if not all(item.numbers().values()):
                raise ValueError(f"{name}: source = '': expected a column or field path")
            names_joint = any(_ANY_JOINT in path for path in item.numbers().values())
            if names_joint and not (item.joint or self.joint or self.joints):
                raise ValueError(f"{name}: source = {item.source!r} without joint: expected both")
        without = [name for name, item in sources.items() if not item.topic]
        if 0 < len(without) < len(sources):
            raise ValueError(
                f"{', '.join(without)} without topic: expected topics for all quantities, or for "
                "none (table columns)"
            )
        current = self.current
        if current and current.kind == "magnitude" and not self.is_table and self.speed is None:
            raise ValueError(
                "current: kind = magnitude takes its sign from the motion: map the speed as well"
            )
        if self.is_table and not self.clock.source and not self.clock.rate_hz:
            raise ValueError(
                "clock without source and rate_hz: expected the time column, or the sample rate "
                "[Hz]"
            )

    @property
    def is_table(self) -> bool:
        """Whether the sources are columns of a table."""
        return not self.position.topic

    def of_joint(self, name: str) -> Self:
        """Return the mapping for one joint; unchanged if ``joints`` is empty.

        Raises
        ------
        ValueError
            If ``joints`` does not contain ``name``.
        """
        if not self.joints:
            return self
        if name not in self.joints:
            raise ValueError(f"joints: {unknown_name('joint', name, self.joints)}")
        return replace(self, joint=name, joints=())

    @property
    def acquisition(self) -> Acquisition:
        """How current, speed and command are acquired."""
        current, speed = self.measured_current, self.speed is not None
        if current is None:
            return Acquisition("none", 0.0, speed, self.has_command)
        unit = next((unit for unit in EFFORT_UNITS if current.unit.endswith(unit)), EFFORT_UNITS[0])
        return Acquisition(current.sampling, current.filter_time, speed, self.has_command, unit)

    @property
    def has_command(self) -> bool:
        """Whether the command or the position error is mapped."""
        return self.command is not None or self.error is not None

    @property
    def measured_current(self) -> CurrentSource | None:
        """Source of the current; None if it is not measured."""
        if self.current is None or self.current.sampling == "none":
            return None
        return self.current

    def telemetry_sources(self) -> Iterator[tuple[str, Source]]:
        """Yield name and source of each telemetry column except the payload."""
        for name in _QUANTITIES:
            item = self.measured_current if name == "current" else getattr(self, name)
            if item is not None:
                yield name, item

    def sources(self) -> Iterator[tuple[str, Source]]:
        """Yield name and source of each mapped quantity, including temperature and payload."""
        yield from self.telemetry_sources()
        if self.temperature is not None:
            yield "temperature", self.temperature
        if self.payload is not None:
            yield "payload", self.payload

    def wanted(self) -> Iterator[tuple[str, str, Source]]:
        """Yield key, column or field path, and source of each number to read."""
        for name, item in self.sources():
            for key, path in item.numbers(name).items():
                yield key, path.replace(_ANY_JOINT, item.joint or self.joint), item


def load_mapping(path: Path) -> ColumnMapping:
    """Load a mapping from a YAML file.

    Raises
    ------
    ValueError
        If the file cannot be read or is not a mapping; the message names the file.
    """
    return load_settings(path, "mapping file", ColumnMapping)


def mapping_text(mapping: ColumnMapping) -> str:
    """Return a mapping as YAML text, omitting most default values."""
    return yaml.safe_dump(_shown(mapping), sort_keys=False, allow_unicode=True)


def _shown(part: Any) -> dict[str, Any]:
    entries: dict[str, Any] = {}
    for item in fields(part):
        value = getattr(part, item.name)
        if is_dataclass(value):
            value = _shown(value)
        always = value and item.name in _ALWAYS_SHOWN and isinstance(part, Source)
        if always or (value != item.default and value not in (None, {}, "")):
            entries[item.name] = list(value) if isinstance(value, tuple) else value
    return entries
