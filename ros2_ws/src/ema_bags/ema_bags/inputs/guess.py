"""A mapping guessed from names, magnitudes and relations, to be confirmed by the user."""

import re
from collections.abc import Mapping as ByName
from dataclasses import dataclass, fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.conversion import convert, with_lead
from ema_bags.inputs.factors import explain
from ema_bags.inputs.mapping import (
    EPOCHS,
    LINEAR,
    TIMES_NS,
    TORQUES,
    AngleSource,
    Clock,
    CurrentSource,
    Mapping,
    Source,
    SpeedSource,
    TemperatureSource,
)
from ema_bags.inputs.motion import ThinnedMotion
from ema_bags.inputs.series import NO_STAMP
from ema_bags.inputs.tables import TableColumns
from ema_core.description import ActuatorDescription
from ema_core.wording import counted

_EPOCHS: Final = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"), (1e8, "s"))
_FASTEST_NS: Final = 1e4
_SLOWEST_NS: Final = 1e9
_NO_UNITS: Final = frozenset(("utc", "gmt", "local", "abs", "absolute", "rel", "relative", "-"))
_STEPS: Final = ((5e4, "ns"), (50.0, "us"), (0.2, "ms"))
JOINT_STATE: Final = "sensor_msgs/msg/JointState"
_WORDS: Final = {
    "command": r"cmd|command\w*|set ?points?|sp|ref|reference|target|demand\w*|desired|soll\w*|"
    r"commanded|input|goal",
    "error": r"err|error|deviation|following|tracking",
    "position": r"pos|position|angle|theta|winkel|enc|encoder|ist\w*|deflection|phi|pos estimate",
    "speed": r"vel|velocity|speed|omega|drehzahl|rpm|w|rate",
    "current": r"current|cur|iq|i q|i eq|ieq|strom|amps?|effort|torque|trq|moment|drehmoment|i",
    "temperature": r"temp|temps|temperature|temperatures|temperatur",
    "time": r"t|time|timestamp|stamp|zeit|sec|secs|seconds|date|datetime|clock|ns|ms|us",
}
_SPLIT: Final = re.compile(r"[^0-9A-Za-zµ°]+|(?<=[a-z]{2})(?=[A-Z])")
_UNITS: Final = {
    "rad": ("rad", "radian", "radians"),
    "deg": ("deg", "°", "degree", "degrees", "grad"),
    "mrad": ("mrad",),
    "turn": ("rev", "revs", "turn", "turns", "u", "cycles"),
    "rad/s": ("rad/s", "rad s", "rads", "rad/sec", "rad*s^-1"),
    "deg/s": ("deg/s", "°/s", "deg s", "deg/sec", "dps", "grad/s"),
    "rpm": ("rpm", "1/min", "u/min", "r/min", "rev/min", "min^-1", "min-1"),
    "turn/s": ("rev/s", "turn/s", "turns/s", "u/s", "rps", "hz"),
    "mm": ("mm", "millimeter", "millimetre"),
    "mm/s": ("mm/s", "mm s"),
    "A": ("a", "amp", "amps", "ampere"),
    "mA": ("ma", "milliamp"),
    "N.m": ("nm", "n.m", "n*m", "n m", "newton meter"),
    "mN.m": ("mnm", "mn.m", "mn*m"),
    "degC": ("degc", "°c", "deg c", "celsius", "c"),
    "degF": ("degf", "°f", "deg f", "fahrenheit", "f"),
    "K": ("k", "kelvin"),
    "s": ("s", "sec", "secs", "second", "seconds"),
    "ms": ("ms", "msec", "millis"),
    "us": ("us", "µs", "usec", "micros"),
    "ns": ("ns", "nsec", "nanos", "nanoseconds"),
    "min": ("min", "mins", "minute", "minutes", "minuten"),
    "h": ("h", "hr", "hrs", "hour", "hours", "std", "stunden"),
    "day": ("d", "day", "days", "tage"),
}
_LEAD: Final = 0.005
_NO_COMMAND: Final = "no command seems to be there: tracking is then not judged"
_BRACKETS: Final = re.compile(r"[\[(].*?[\])]")
_COMMANDS: Final = {
    "control_msgs/msg/JointTrajectoryControllerState": "reference.positions",
    "control_msgs/msg/SingleDOFStateStamped": "dof_state.reference",
    "std_msgs/msg/Float64": "data",
    "std_msgs/msg/Float32": "data",
    "std_msgs/msg/Float64MultiArray": "data[0]",
    "std_msgs/msg/Float32MultiArray": "data[0]",
}
_UNLIKE: Final[dict[str, set[str]]] = {
    "position": {"command", "error", "speed", "temperature"},
    "error": {"speed", "current", "temperature"},
    "command": {"speed", "current", "error", "temperature"},
    "speed": {"command", "error", "temperature"},
    "current": {"command", "error", "temperature"},
    "temperature": {"command", "error"},
}
"""What a column of each quantity must not seem to be, in the order in which columns are taken."""


@dataclass(frozen=True)
class Guess:
    """A guessed mapping and its reasons, one remark per line."""

    mapping: Mapping
    remarks: list[str]


def guess_columns(
    columns: TableColumns, clock: Clock | None = None, *, needs_command: bool = True
) -> Guess:
    """Return a mapping of the columns of a table by their names and units.

    Parameters
    ----------
    clock
        The clock, if it is known.
    needs_command
        Whether the drive is one that a position command is needed for.

    Raises
    ------
    ValueError
        When no column seems to be the position, or a command or position error that is needed, or
        a column looks like the time and is not a clock.
    """
    remarks = [f"column {name!r} holds no numbers" for name in columns.texts]
    if clock is None:
        clock, unused = _clock(columns, remarks)
    else:
        unused = [name for name in columns.values if name != clock.source]
    kinds = {name: _kinds_of(name) for name in unused}
    taken: dict[str, str] = {}
    for quantity, without in _UNLIKE.items():
        able = [
            name
            for name, quantities in kinds.items()
            if quantity in quantities and not quantities & without and name not in taken.values()
        ]
        if able:
            # In a table with several joints, columns with the position's words belong to its joint.
            position = _words_of(taken.get("position", ""))
            taken[quantity] = max(able, key=lambda name: len(_words_of(name) & position))
            able.remove(taken[quantity])
        if able:
            remarks.append(
                f"{quantity} {taken[quantity]!r} is a guess; others: {', '.join(map(repr, able))}"
            )
    phases = {
        kind: name
        for name, quantities in kinds.items()
        for kind in quantities
        if kind.startswith("phase_")
    }
    if list(phases) == ["phase_a"] and "current" not in taken:
        taken["current"] = phases.pop("phase_a")  # in A, not of phase A: there is no other phase
    if "position" not in taken and {"command", "error"} <= taken.keys():
        taken["position"] = f"{taken['command']} - {taken['error']}"
        remarks.append(f"position is {taken['position']}: an error is command less position")
    if "command" in taken:
        taken.pop("error", None)
    missing = [name for name in ("position",) if name not in taken]
    if "command" not in taken and "error" not in taken:
        if needs_command:
            missing.append("command (or position error)")
        remarks.append(_NO_COMMAND)
    if missing:
        raise ValueError(
            f"{columns.path}: no column seems to be the {' or the '.join(missing)}; columns: "
            f"{', '.join(columns.values)}: write a mapping by hand"
            + "; with drive: unknown in the actuator file, no command is needed"
            * ("position" in taken)
        )
    if needs_command and "temperature" in taken:
        remarks.append(
            f"{taken.pop('temperature')!r} may be the temperature of the winding: if it is, map "
            "it as temperature"
        )
    sources: dict[str, Any] = {}
    for quantity, name in taken.items():
        unit = _unit_of(columns.units.get(name, "")) or _unit_in_name(name)
        if quantity == "current" and not unit and re.search(r"[^A-Za-z]A$", name):
            unit = "A"
        sources[quantity] = _source(quantity, name, unit, remarks)
    if "current" not in sources and len(phases) >= 2:
        names = ", ".join(phases[key] for key in sorted(phases))
        remarks.append(
            f"phase currents {names}: map them by current: {{kind: phase_currents, phases: "
            f"[{names}], torque_sign: COLUMN}}, a column with the sign of the torque"
        )
    for quantity in ("speed", "current"):
        if quantity not in sources:
            remarks.append(f"no column seems to be the {quantity}: it is taken as not measured")
    return Guess(Mapping(**sources, clock=clock, table=columns.format), remarks)


def guess_topics(
    topics: ByName[str, str], joints: ByName[str, list[str]], *, needs_command: bool = True
) -> Guess:
    """Return a mapping of the topics of a bag by their types and names.

    Parameters
    ----------
    topics
        Types by topic.
    joints
        Names of the joints by topic of type ``sensor_msgs/msg/JointState``, the one that moves
        most first.
    needs_command
        Whether the drive is one that a position command is needed for.

    Raises
    ------
    ValueError
        When there is no joint state, or no topic that seems to be the required command.
    """
    remarks: list[str] = []
    states = [name for name, names in joints.items() if names]
    command = _command_topic(topics)
    if not states or (command is None and needs_command):
        what = "to be the command" if states else f"{JOINT_STATE} with a joint"
        lacking = f"no topic {'seems' if states else 'of'} {what}"
        listed = ", ".join(f"{name} ({kind})" for name, kind in topics.items()) or "none"
        raise ValueError(
            f"{lacking}; topics: {listed}: write a mapping by hand, the examples show how"
        )
    topic = states[0]
    joint, *others = [*joints[topic], *states[1:]]
    if others:
        remarks.append(
            f"joint {joint!r} on {topic} is a guess, it moves most; others: {', '.join(others)}"
        )
    if command is None:
        remarks.append(_NO_COMMAND)
    elif command.source.endswith("[0]"):
        remarks.append(f"command.source {command.source} is a guess")
    remarks.append("effort may be a current, a torque of motor or joint, or nothing: confirm kind")
    mapping = Mapping(
        position=AngleSource("position", topic),
        command=command,
        speed=SpeedSource("velocity", topic, shaft="user"),
        current=CurrentSource("effort", topic),
        joint=joint,
        clock=Clock("header"),
    )
    return Guess(mapping, remarks)


def refine(
    guess: Guess,
    raw: ByName[str, NDArray[np.float64]],
    stamps_ns: NDArray[np.int64],
    description: ActuatorDescription,
) -> Guess:
    """Return a guess with units, signs and shafts by which its columns agree with each other."""
    mapping, remarks = guess.mapping, list(guess.remarks)
    for name in ("position", "command", "error", "speed"):
        source = getattr(mapping, name)
        if source is None or source.unit not in LINEAR:
            continue
        if not with_lead(description, mapping).parameters.lead:
            mapping = replace(mapping, **{name: replace(source, lead=_LEAD)})
            remarks.append(f"{name}.lead {_LEAD:g} m is a guess: the way for one turn of the shaft")
    for name in ("current", "speed"):
        values = raw.get(name)
        if values is not None and len(np.unique(values[np.isfinite(values)])) < 2:
            mapping = replace(mapping, **{name: None})
            remarks.append(f"{name} never changes: it is taken as not measured")

    for name in ("position", "command", "error", "speed", "current"):
        encoding = _encoding(raw[name]) if name in raw else ""
        if encoding and (source := getattr(mapping, name)) is not None:
            mapping = replace(mapping, **{name: replace(source, encoding=encoding)})
            remarks.append(f"{name}.encoding {encoding}: its values are of a register without sign")
    current = mapping.current
    is_unsigned = current and not current.encoding and np.nanmin(raw["current"]) >= 0.0
    if current and current.kind == "equivalent" and is_unsigned:
        mapping = replace(mapping, current=replace(current, kind="magnitude"))
        remarks.append("current.kind magnitude: it is never negative, or a load holds it above 0")

    def moving(of: Mapping) -> ThinnedMotion | None:
        columns = convert(raw, of, with_lead(description, of))
        return ThinnedMotion.of(columns, stamps_ns, description.parameters.tau)

    motion = moving(mapping)
    if motion is None:
        return Guess(mapping, [*remarks, "too few samples to compare the columns"])
    for change in explain(motion, mapping, description) or ():
        section = replace(getattr(mapping, change.quantity), **{change.entry: change.value})
        mapping = replace(mapping, **{change.quantity: section})
        remarks.append(f"{change.quantity}.{change.entry} {change.value}: {change.reason}")
    motion = moving(mapping)
    if mapping.current is not None and motion is not None:
        if description.drive == "unknown":
            # Inertia and friction of such a drive are not known: only the sign can be found.
            dissipation = motion.dissipation
            relation = None if dissipation is None else (1.0, dissipation)
        else:
            relation = motion.current_against_torque(description.parameters)
        current = _refined(mapping.current, relation, description, remarks)
        mapping = replace(mapping, current=current)
    return Guess(mapping, remarks)


def _encoding(values: NDArray[np.float64]) -> str:
    """Return how a register has the sign of its values: the negative ones are far above others."""
    values = values[np.isfinite(values)]
    for bits in (16, 32):
        half = 2.0 ** (bits - 1)
        high, low = values[values >= half], values[values < half]
        if not len(high) or not len(low) or np.any(values % 1.0) or np.min(values) < 0.0:
            continue
        if np.max(values) < 2.0 * half and np.max(low) < half / 2.0:
            if np.min(high) > 1.5 * half:
                return f"twos_complement_{bits}"
            if bits == 16 and np.max(high) < 1.5 * half:
                return "sign_bit_16"
    return ""


def _refined(
    current: CurrentSource,
    relation: tuple[float, float] | None,
    description: ActuatorDescription,
    remarks: list[str],
) -> CurrentSource:
    """Return a current with the sign, and the torque's shaft, that inertia and friction need."""
    if relation is None or abs(relation[1]) < 0.4:
        remarks.append("sign and unit of the current cannot be checked")
        return current
    size, correlation = relation
    if correlation < 0.0:
        current = replace(current, sign=-current.sign)
        remarks.append(f"current.sign {current.sign}: it opposes the acceleration otherwise")
    tau = description.parameters.tau
    if current.kind == "motor_torque" and abs(np.log(size * tau)) < abs(np.log(size)):
        current = replace(current, kind="joint_torque")
        remarks.append("current.kind joint_torque: too large for the motor")
    elif current.kind == "equivalent" and not 0.03 < size < 30.0:
        remarks.append(
            f"the current is {size:.3g} times as large as inertia and friction of the description "
            "need: is it a torque?"
        )
    remarks.append("current.sampling cannot be found from data: mean, filtered or instantaneous?")
    return current


def _clock(columns: TableColumns, remarks: list[str]) -> tuple[Clock, list[str]]:
    """Return the clock and the names of the other columns.

    Raises
    ------
    ValueError
        When a column looks like the time, and none is a clock.
    """
    names = list(columns.values)
    named = [name for name in names if name in columns.dates or _is_time(columns, name)]
    rest = [name for name in names if name not in named]
    sums = _dated(columns, named)
    errors: list[ValueError] = []
    for name in sums or named:
        try:
            clock = _clock_of(columns, name)
            if not _is_clock(columns, clock):
                continue
            unit = "ns" if name in columns.dates or sums else _time_unit(columns, name)
        except ValueError as error:
            errors.append(error)
            continue
        if clock.unit != unit:
            remarks.append(
                f"clock.unit {clock.unit} by the size of the {'values' if unit else 'steps'}"
            )
        return clock, rest if sums else [item for item in names if item != name]
    if errors:
        raise errors[0]
    if named := [*named, *(name for name in columns.texts if "time" in _kinds_of(name))]:
        raise ValueError(
            f"{columns.path}: column {named[0]!r} looks like the time, but "
            f"{_disorder(columns, named[0])}: give clock.source and clock.unit, or clock.rate_hz "
            "if the samples are regular (--set)"
        )
    for clock in [_clock_of(columns, name) for name in rest]:
        if not _counts(columns.values[clock.source]) and _is_clock(columns, clock):
            remarks.append(f"clock.unit {clock.unit} by the size of the steps")
            return clock, [name for name in rest if name != clock.source]
    remarks.append("no column seems to be the time: give clock.rate_hz, here 1000 as a guess")
    return Clock(rate_hz=1000.0), rest


def _is_time(columns: TableColumns, name: str) -> bool:
    """Return whether a column is a time by its name, and by its unit if it has one."""
    unit = _unit_of(columns.units.get(name, "")) or _unit_in_name(name)
    return "time" in _kinds_of(name) and (not unit or unit in TIMES_NS)


def _dated(columns: TableColumns, named: list[str]) -> list[str]:
    """Return the sum of a column of days and one of times of day, if there are both."""
    of_day = [name for name in named if name in columns.of_day]
    days = [
        name
        for name in named
        if name in columns.dates
        and name not in columns.of_day
        and not np.any(columns.values[name][columns.values[name] != NO_STAMP] % TIMES_NS["day"])
    ]
    return [f"{days[0]} + {of_day[0]}"] if days and of_day else []


def _clock_of(columns: TableColumns, name: str) -> Clock:
    """Return the clock of a column: with the unit of its name, or by the size of its values."""
    if name not in columns.values or name in columns.dates:
        return Clock(name, "ns")
    unit = _epoch_of(columns.values[name]) or _time_unit(columns, name)
    if not unit:
        unit = _unit_of_times(columns.values[name])
    return Clock(name, unit)


def _time_unit(columns: TableColumns, name: str) -> str:
    """Return the unit of a time that its heading gives; empty without one.

    Raises
    ------
    ValueError
        When it is none that is known.
    """
    text = columns.units.get(name, "")
    first = re.split(r"[\s,;]", text.strip())[0].strip(".")
    unit = _unit_of(text) or _unit_of(first) or _unit_in_name(name)
    if unit in TIMES_NS or not text or text.lower() in _NO_UNITS:
        return unit if unit in TIMES_NS else ""
    raise ValueError(
        f"{columns.path}: column {name!r}: unit {text!r} of a time: expected "
        f"{', '.join(TIMES_NS)}; give clock.unit, or clock.rate_hz (--set)"
    )


def _is_clock(columns: TableColumns, clock: Clock) -> bool:
    """Return whether times grow from row to row, or go back: the newest row is the first."""
    stamps = columns.stamps(clock)
    steps = np.diff(stamps[stamps != NO_STAMP])
    return len(steps) > 0 and bool(np.mean(steps > 0) > 0.9 or np.mean(steps < 0) > 0.9)


def _counts(values: NDArray[Any]) -> bool:
    """Return whether values number the rows."""
    steps = np.diff(values[np.isfinite(values)])
    return len(steps) > 0 and bool(np.mean(steps == 1) > 0.9)


def _disorder(columns: TableColumns, name: str) -> str:
    """Return why times that do not grow are not a clock."""
    if name in columns.texts:
        cells = columns.texts[name]
        return f"its cells are no times: {next((cell for cell in cells if cell == cell), '')!r}"
    values = columns.stamps(_clock_of(columns, name))
    values = values[values != NO_STAMP]
    if len(values) < 2 or np.ptp(values) == 0:
        return "never changes and is no clock"
    steps = np.diff(values)
    back = int(np.count_nonzero(steps < 0))
    if not back:
        return f"changes in {np.mean(steps > 0):.0%} of the rows only"
    return (
        f"goes back {counted(back, 'time')} in {counted(len(values), 'row')} and is no clock (sort "
        "the rows by it, if they have lost their order)"
    )


def _epoch_of(values: NDArray[Any]) -> str:
    """Return the unit of times that count from another year than 1970; empty if they do not.

    They are of the years 2000 to 2060, at a rate that somebody samples with.
    """
    finite = values[np.isfinite(values)].astype(float)
    if len(finite) < 2:
        return ""
    step = abs(float(np.median(np.diff(finite))))
    for unit, epoch in EPOCHS.items():
        size = TIMES_NS[unit]
        years = (finite[-1] - epoch) * size / (365.25 * TIMES_NS["day"])
        if 30.0 < years < 90.0 and _FASTEST_NS < step * size < _SLOWEST_NS:
            # Seconds since 1904 are seconds since 1970 only after 2077.
            return unit
    return ""


def _unit_of_times(values: NDArray[Any]) -> str:
    finite = values[np.isfinite(values)].astype(float)
    step = abs(float(np.median(np.diff(finite)))) if len(finite) > 1 else 0.0
    for least, unit in _EPOCHS:
        # Since 1970, and at a rate that somebody samples with.
        if abs(finite[-1]) > least and _FASTEST_NS < step * TIMES_NS[unit] < _SLOWEST_NS:
            return unit
    return next((unit for least, unit in _STEPS if step > least), "s")


def _source(quantity: str, name: str, unit: str, remarks: list[str]) -> Source:
    kinds = {"speed": SpeedSource, "current": CurrentSource, "temperature": TemperatureSource}
    kind = kinds.get(quantity, AngleSource)
    [choices] = [item.metadata["choices"] for item in fields(kind) if item.name == "unit"]
    more: dict[str, Any] = {"unit": unit} if unit in choices else {}
    if not more:
        remarks.append(f"{quantity}.unit is a guess: {name!r} does not give it")
    if quantity == "current":
        words = name.lower().replace(" ", "").replace("_", "")
        if unit in TORQUES or any(w in words for w in ("torque", "trq", "moment")):
            more = {"unit": "N.m"} | more | {"kind": "motor_torque"}
        elif "iq" in words:
            more["kind"] = "i_q"
    return kind(source=name, **more)


def _command_topic(topics: ByName[str, str]) -> AngleSource | None:
    for name in sorted(topics, key=lambda name: "command" not in _kinds_of(name)):
        if path := _COMMANDS.get(topics[name]):
            # A set point of a type without a stamp is held until the next one.
            between = "hold" if topics[name].startswith("std_msgs") else "linear"
            return AngleSource(path, name, between=between)
    return None


def _unit_of(text: str) -> str:
    """Return the unit denoted by a text, such as "1/min"; empty if it is unknown."""
    plain = text.strip().lower().replace("²", "^2").replace("·", ".")
    for unit, spellings in _UNITS.items():
        if plain in spellings or plain == unit.lower():
            return unit
    return ""


def _unit_in_name(name: str) -> str:
    """Return the unit at the end of a name, as in ``pos_deg``; empty without one."""
    words = _words(name)
    for count in (2, 1):
        if len(words) > count:
            joined = " ".join(words[-count:])
            unit = _unit_of(joined)
            # A single letter at the end is a phase or an axis more often than a unit.
            if unit and (len(joined) > 1 or joined == "s"):
                return unit
    return ""


def _kinds_of(name: str) -> set[str]:
    """Return the possible roles of a column by its name: mapping keys, "time", "phase_a" to "c"."""
    words = _words(_BRACKETS.sub(" ", name))
    text = " ".join(words)
    roles = {
        kind for kind, pattern in _WORDS.items() if re.search(rf"(?:^| )(?:{pattern})(?: |$)", text)
    }
    if match := re.fullmatch(
        r"(?:i|current|strom|phase)(?: phase)?(?: current)? ?([abcuvw])", text
    ):
        return {f"phase_{'abcabc'['abcuvw'.index(match[1])]}"}
    return roles


def _words_of(name: str) -> set[str]:
    return set(_words(_BRACKETS.sub(" ", name)))


def _words(name: str) -> list[str]:
    return [word.lower() for word in _SPLIT.split(name) if word]
