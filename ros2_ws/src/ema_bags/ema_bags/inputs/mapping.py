"""What each column of telemetry is made of, in files, bags and topics of other makes."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from ema_bags.inputs.field_path import FieldPath
from ema_bags.inputs.units import (
    ANGLES,
    CURRENTS,
    LENGTHS,
    LINEAR_SPEEDS,
    SPEEDS,
    TIMES_NS,
    TORQUES,
)
from ema_core.acquisition import CURRENT_SAMPLINGS, Acquisition
from ema_core.quantity import check_quantities, quantity, text
from ema_core.wording import unknown_name

SHAFTS: Final = ("user", "motor")
"""Where an angle or speed is measured."""

BETWEEN: Final = ("linear", "hold")
"""What a value is between two messages: on the line between them, or the earlier one."""

CURRENT_KINDS: Final = (
    "equivalent",
    "i_q",
    "phase_currents",
    "motor_torque",
    "joint_torque",
    "magnitude",
)
"""What the equivalent current is made of."""

ENCODINGS: Final = {
    "": (0, 0),
    "sign_bit_16": (1 << 15, 1),
    "sign_bit_32": (1 << 31, 1),
    "twos_complement_16": (1 << 15, 2),
    "twos_complement_32": (1 << 31, 2),
}
"""Registers that are read as if they had no sign: the sign's bit, and how often it is taken off
(or, with the number's sign, once)."""

AMPLITUDES: Final = ("peak", "rms", "power")
"""What i_q is: the peak of a phase current, its root mean square, or the peak times sqrt(3/2) as of
the power-invariant transformation."""

CLOCKS: Final = ("header", "sent", "arrival")
"""Clocks of topics: the stamp in the message, when it was sent, when it was received."""

QUANTITIES: Final = ("position", "command", "error", "speed", "current")
"""Entries of a mapping that name a source."""

DEFECTS: Final = (
    *("current_zero", "command_frozen", "position_frozen", "speed_frozen", "current_frozen"),
    *("position_unit", "command_unit", "speed_unit", "current_unit"),
    *("position_sign_reversed", "command_sign_reversed", "speed_sign_reversed"),
    *("current_sign_reversed", "position_shaft", "command_shaft", "speed_shaft"),
    *("position_scale", "command_scale", "speed_scale", "drive_of_i_q", "gear_ratio"),
    *("command_position", "current_size", "not_finite", "time_not_monotonic"),
)
"""Names of the defects that are errors, which a mapping can accept."""

_SIGNS: Final = (-1, 1)


@dataclass(frozen=True)
class Source:
    """Where a number comes from, and what it has to be multiplied with.

    The value in SI units is ``sign scale unit raw + offset``.

    Raises
    ------
    ValueError
        When a value is impossible; the message names it, its value and what is expected.
    """

    source: str = text("", "column of a table, or path of a field in a message")
    topic: str = text("", "topic of the message; empty: a table")
    type: str = text("", "type of the message; empty: as it is published")
    names_topic: str = text("", "topic with the names that the message itself does not have")
    joint: str = text("", "joint whose element of an array is meant")
    unit: str = text("", "unit of the source")
    scale: float = quantity(1.0, "-", -1e12, 1e12, "factor, beside that of the unit")
    sign: int = quantity(1, "-", -1, 1, "-1 where the source counts the other way")
    offset: float = quantity(0.0, "-", -1e12, 1e12, "added at last, in rad, rad/s or A")
    encoding: str = text("", "how a register has its sign", tuple(ENCODINGS))
    between: str = text("linear", "value between two messages", BETWEEN)

    def __post_init__(self) -> None:
        check_quantities(self)
        if self.sign not in _SIGNS:
            raise ValueError(f"sign = {self.sign}: expected 1 or -1")
        if self.scale == 0.0:
            raise ValueError("scale = 0: expected a factor other than 0")
        if self.topic:
            if self.source:
                FieldPath(self.source)
        elif self.type or self.names_topic:
            given = "type" if self.type else "names_topic"
            raise ValueError(f"{given} = {getattr(self, given)!r} without topic: expected both")


@dataclass(frozen=True)
class AngleSource(Source):
    """Source of a position, a command or a position error."""

    unit: str = text("rad", "unit of the source", (*ANGLES, *LENGTHS))
    shaft: str = text("user", "shaft of the angle", SHAFTS)
    lead: float = quantity(0.0, "m", 0.0, 10.0, "of a length: way for one turn of the shaft")

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_lead(self, LENGTHS)


@dataclass(frozen=True)
class SpeedSource(Source):
    """Source of the speed."""

    unit: str = text("rad/s", "unit of the source", (*SPEEDS, *LINEAR_SPEEDS))
    shaft: str = text("motor", "shaft of the speed", SHAFTS)
    lead: float = quantity(0.0, "m", 0.0, 10.0, "of a length: way for one turn of the shaft")

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_lead(self, LINEAR_SPEEDS)


@dataclass(frozen=True)
class CurrentSource(Source):
    """Source of the current, what it is, and how it was sampled.

    Raises
    ------
    ValueError
        When the unit is not one of the kind, or what a kind needs is missing or given for another.
    """

    unit: str = text("A", "unit of the source", (*CURRENTS, *TORQUES))
    kind: str = text("equivalent", "what the source is", CURRENT_KINDS)
    amplitude: str = text("", "of i_q: its convention; empty: peak", ("", *AMPLITUDES))
    phases: tuple[str, ...] = ()
    torque_sign: str = text("", "of phase_currents: source with the sign of the torque")
    sampling: str = text("mean", "what a sample stands for", CURRENT_SAMPLINGS)
    filter_time: float = quantity(0.0, "s", 0.0, 1.0, "time constant of a filtered current")

    def __post_init__(self) -> None:
        object.__setattr__(self, "phases", tuple(self.phases))
        super().__post_init__()
        Acquisition(self.sampling, self.filter_time)
        units = TORQUES if self.kind.endswith("torque") else CURRENTS
        if self.unit not in units:
            raise ValueError(
                f"unit = {self.unit!r} with kind = {self.kind}: expected {', '.join(units)}"
            )
        if self.amplitude and self.kind != "i_q":
            raise ValueError(
                f"amplitude = {self.amplitude!r} with kind = {self.kind}: only i_q has one"
            )
        is_phases = self.kind == "phase_currents"
        if is_phases != bool(self.phases) or is_phases != bool(self.torque_sign):
            raise ValueError(
                f"phases = {list(self.phases)} and torque_sign = {self.torque_sign!r} with kind = "
                f"{self.kind}: phase_currents needs both, no other kind has them"
            )
        if self.topic:
            for path in (*self.phases, self.torque_sign):
                if path:
                    FieldPath(path)
        if is_phases and len(self.phases) not in (2, 3):
            raise ValueError(
                f"phases = {list(self.phases)}: expected the sources of three phases, or of two"
            )


def _check_lead(source: AngleSource | SpeedSource, lengths: Iterable[str]) -> None:
    """Raise ValueError unless a unit of length has a lead, and no other unit has one."""
    is_length = source.unit in lengths
    if is_length != bool(source.lead):
        expected = "the way for one turn of the shaft [m]" if is_length else "no lead"
        raise ValueError(f"lead = {source.lead:g} with unit = {source.unit}: expected {expected}")


@dataclass(frozen=True)
class Clock:
    """When samples were taken.

    Raises
    ------
    ValueError
        When a value is impossible.
    """

    source: str = text("", "column of a table; header, sent, arrival or a field path of a message")
    unit: str = text("s", "unit of a column or field", tuple(TIMES_NS))
    rate_hz: float = quantity(0.0, "Hz", 0.0, 1e6, "rate of the samples; 0: as the stamps say")

    def __post_init__(self) -> None:
        check_quantities(self)


@dataclass(frozen=True)
class Table:
    """How a CSV file is written; empty: as it looks.

    Raises
    ------
    ValueError
        When a value is impossible.
    """

    separator: str = text("", "character between the columns", ("", ",", ";", "\t", "|", " "))
    decimal: str = text("", "decimal sign", ("", ".", ","))

    def __post_init__(self) -> None:
        check_quantities(self)


@dataclass(frozen=True)
class Mapping:
    """What the columns of telemetry are made of.

    Attributes
    ----------
    joint
        Joint that is meant wherever a source names none.
    position
        Angle of the user shaft, or of the motor.
    command, error
        The command, or instead of it the position error, command less position.
    speed, current
        None where they are not measured.
    clock
        When samples were taken.
    table
        How a CSV file is written.
    accept
        Names of defects that are known and accepted.

    Raises
    ------
    ValueError
        When the position, or command and error, are missing or contradict each other, sources
        are partly columns and partly topics, or a name to accept is not that of a defect.
    """

    position: AngleSource
    command: AngleSource | None = None
    error: AngleSource | None = None
    speed: SpeedSource | None = None
    current: CurrentSource | None = None
    joint: str = ""
    clock: Clock = Clock()
    table: Table = Table()
    accept: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "accept", tuple(self.accept))
        for name in self.accept:
            if name not in DEFECTS:
                raise ValueError(f"accept: {unknown_name('defect', name, DEFECTS)}")
        if (self.command is None) == (self.error is None):
            given = "neither" if self.command is None else "both"
            raise ValueError(
                f"{given} of command and error given: expected the command, or instead of it the "
                "position error"
            )
        for name, item in self.sources():
            if not item.source and not getattr(item, "phases", ()):
                raise ValueError(f"{name}: source = '': expected a column or the path of a field")
        kinds = {bool(item.topic) for _, item in self.sources()}
        if len(kinds) > 1:
            without = [name for name, item in self.sources() if not item.topic]
            raise ValueError(
                f"{', '.join(without)} without topic: expected a topic for every quantity, or for "
                "none (columns of a table)"
            )
        current = self.current
        if current and current.kind == "magnitude" and not self.is_table and self.speed is None:
            raise ValueError(
                "current: kind = magnitude takes its sign from the motion: expected the speed, too"
            )
        if self.is_table and not self.clock.source and not self.clock.rate_hz:
            raise ValueError(
                "clock without source and rate_hz: expected the column of the time, or the rate of "
                "the samples [Hz]"
            )

    @property
    def is_table(self) -> bool:
        """Whether the sources are columns of a table."""
        return not self.position.topic

    @property
    def acquisition(self) -> Acquisition:
        """How the telemetry is acquired."""
        current, speed = self.measured_current, self.speed is not None
        if current is None:
            return Acquisition("none", 0.0, speed)
        return Acquisition(current.sampling, current.filter_time, speed)

    @property
    def measured_current(self) -> CurrentSource | None:
        """Source of the current, unless it is said not to be measured."""
        if self.current is None or self.current.sampling == "none":
            return None
        return self.current

    def sources(self) -> Iterator[tuple[str, Source]]:
        """Yield name and source of what is mapped."""
        for name in QUANTITIES:
            item = getattr(self, name)
            if item is not None and (name != "current" or self.measured_current is not None):
                yield name, item

    def wanted(self) -> Iterator[tuple[str, str, Source]]:
        """Yield a key, the source as a text and its section for every number that is read."""
        for name, item in self.sources():
            if isinstance(item, CurrentSource) and item.phases:
                for letter, source in zip("abc", item.phases, strict=False):
                    yield f"phase_{letter}", source, item
                yield "torque_sign", item.torque_sign, item
            else:
                yield name, item.source, item
