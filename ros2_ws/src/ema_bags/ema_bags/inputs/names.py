# SPDX-License-Identifier: Apache-2.0
"""Inference of the role and unit of columns from their names."""

import re
from typing import Final

from ema_bags.inputs.mapping import TEMPERATURES
from ema_bags.inputs.recognition import Hint
from ema_core.units import ANGLES, CURRENTS, FORCES, LENGTHS, LINEAR_SPEEDS, SPEEDS, TORQUES

_WORDS: Final = {
    "command": r"cmd|command\w*|set|set ?points?|sp|ref|reference|target|tgt|demand\w*|des|"
    r"desired|d|soll\w*|commanded|input|goal|action",
    "error": r"err|error|deviation|following|tracking|diff|difference",
    "position": r"pos\w*|angle|theta|\w*winkel|enc|encoder|ist\w*|deflection|phi|q|q pos|"
    r"state",
    "speed": r"vel\w*|speed|omega|drehzahl|rpm|w|rate|dq|qd|q dot|^v(?=\d*$)",
    "current": r"curr\w*|cur|iq|i q|i eq|ieq|strom|amps?|effort|torq\w*|trq|moment|drehmoment|i|"
    r"tau|force",
    "temperature": r"temp|temps|temperature|temperatures|temperatur",
    "time": r"t|time|timestamp|stamp|zeit|sec|secs|seconds|date|datetime|clock|ns|ms|us|mjd|jd",
}
_MASSES: Final = frozenset(("payload", "nutzlast", "load kg"))
_GRIPS: Final = frozenset(("gripper", "grasped", "gripped", "holding", "held", "carrying"))
"""Words that may name a payload flag; words in ``_MASSES`` name the mass of a payload."""
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
_QUANTITIES: Final = {
    **dict.fromkeys([*ANGLES, *LENGTHS], "position"),
    **dict.fromkeys([*SPEEDS, *LINEAR_SPEEDS], "speed"),
    **dict.fromkeys([*CURRENTS, *TORQUES, *FORCES], "effort"),
    **dict.fromkeys(TEMPERATURES, "temperature"),
}
"""Quantity that each unit measures."""
_BRACKETS: Final = re.compile(r"[\[(].*?[\])]")


def unit_of(text: str) -> str:
    """Return the unit denoted by a string such as "1/min"; empty if unknown."""
    plain = text.strip().lower().replace("²", "^2").replace("·", ".")
    for unit, spellings in _UNITS.items():
        if plain in spellings or plain == unit.lower():
            return unit
    return ""


def unit_in_name(name: str) -> str:
    """Return the unit at the end of a name such as ``pos_deg``; empty if there is none."""
    words = _words(name)
    for count in (2, 1):
        if len(words) > count:
            joined = " ".join(words[-count:])
            unit = unit_of(joined)
            # A single trailing letter usually denotes a phase or an axis, not a unit.
            if unit and (len(joined) > 1 or joined == "s"):
                return unit
    return ""


def roles_of(name: str) -> set[str]:
    """Return the roles that a column name suggests: mapping keys, time, phase_a to phase_c."""
    words = _words(_BRACKETS.sub(" ", name))
    text = " ".join(words)
    roles = {
        kind
        for kind, pattern in _WORDS.items()
        if re.search(rf"(?:^| )(?:{pattern})\d*(?: |$)", text)
    }
    if match := re.fullmatch(
        r"(?:i|current|strom|phase)(?: phase)?(?: current)? ?([abcuvw])", text
    ):
        return {f"phase_{'abcabc'['abcuvw'.index(match[1])]}"}
    return roles


def hint_of(name: str, unit: str = "") -> Hint:
    """Return the quantities that the name and unit of a column suggest."""
    roles = roles_of(name)
    quantities = roles & {"position", "speed", "temperature"} | {"error"} & roles
    if roles & {"current"}:
        quantities.add("effort")
    if "error" in roles:
        quantities = {"error"}
    elif of_unit := _QUANTITIES.get(unit_of(unit) or unit_in_name(name)):
        quantities = {of_unit}
    elif any(role.startswith("phase_") for role in roles):
        quantities = {"phase"}
    return Hint(frozenset(quantities), "command" in roles)


def names_payload(name: str, *, is_flag: bool) -> bool:
    """Return whether a name suggests a payload, such as ``load_kg``, or ``gripper`` for a flag."""
    text = f" {' '.join(_words(name))} "
    return any(f" {words} " in text for words in (_MASSES | _GRIPS if is_flag else _MASSES))


def words_of(name: str) -> set[str]:
    """Return the words in a name, excluding text in brackets."""
    return set(_words(_BRACKETS.sub(" ", name)))


def _words(name: str) -> list[str]:
    return [word.lower() for word in _SPLIT.split(name) if word]
