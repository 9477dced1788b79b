"""What columns and fields are, by their names and units."""

import re
from typing import Final

_WORDS: Final = {
    "command": r"cmd|command\w*|set ?points?|sp|ref|reference|target|demand\w*|desired|soll\w*|"
    r"commanded|input",
    "error": r"err|error|deviation|following|tracking",
    "position": r"pos|position|angle|theta|winkel|enc|encoder|ist\w*|deflection|phi|pos estimate",
    "speed": r"vel|velocity|speed|omega|drehzahl|rpm|w|rate",
    "current": r"current|cur|iq|i q|i eq|ieq|strom|amps?|effort|torque|trq|moment|drehmoment|i",
    "time": r"t|time|timestamp|stamp|zeit|sec|secs|seconds|date|datetime|clock|ns|ms|us",
}
_SPLIT: Final = re.compile(r"[^0-9A-Za-zµ°]+|(?<=[a-z])(?=[A-Z])")
_UNITS: Final = {
    "rad": ("rad", "radian", "radians"),
    "deg": ("deg", "°", "degree", "degrees", "grad"),
    "mrad": ("mrad",),
    "turn": ("rev", "revs", "turn", "turns", "u", "cycles"),
    "rad/s": ("rad/s", "rad s", "rads", "rad/sec", "rad*s^-1"),
    "deg/s": ("deg/s", "°/s", "deg s", "deg/sec", "dps", "grad/s"),
    "rpm": ("rpm", "1/min", "u/min", "r/min", "rev/min", "min^-1", "min-1"),
    "turn/s": ("rev/s", "turn/s", "turns/s", "u/s", "rps", "hz"),
    "A": ("a", "amp", "amps", "ampere"),
    "mA": ("ma", "milliamp"),
    "N.m": ("nm", "n.m", "n*m", "n m", "newton meter"),
    "mN.m": ("mnm", "mn.m", "mn*m"),
    "s": ("s", "sec", "secs", "second", "seconds"),
    "ms": ("ms", "msec", "millis"),
    "us": ("us", "µs", "usec", "micros"),
    "ns": ("ns", "nsec", "nanos", "nanoseconds"),
}
_BRACKETS: Final = re.compile(r"[\[(].*?[\])]")


def unit_of(text: str) -> str:
    """Return the unit that is meant by a text, such as "1/min"; empty where it is none known."""
    plain = text.strip().lower().replace("²", "^2").replace("·", ".")
    for unit, spellings in _UNITS.items():
        if plain in spellings or plain == unit.lower():
            return unit
    return ""


def unit_in_name(name: str) -> str:
    """Return the unit at the end of a name, as in ``pos_deg``; empty without one."""
    words = _words(name)
    for count in (2, 1):
        if len(words) > count:
            joined = " ".join(words[-count:])
            unit = unit_of(joined)
            # A single letter at the end is a phase or an axis more often than a unit.
            if unit and (len(joined) > 1 or joined == "s"):
                return unit
    return ""


def kinds_of(name: str) -> set[str]:
    """Return what a column may be by its name: keys of a mapping, "time" or "phase_a" to "c"."""
    words = _words(_BRACKETS.sub(" ", name))
    text = " ".join(words)
    found = {
        kind for kind, pattern in _WORDS.items() if re.search(rf"(?:^| )(?:{pattern})(?: |$)", text)
    }
    if match := re.fullmatch(
        r"(?:i|current|strom|phase)(?: phase)?(?: current)? ?([abcuvw])", text
    ):
        return {f"phase_{'abcabc'['abcuvw'.index(match[1])]}"}
    return found


def words_of(name: str) -> set[str]:
    """Return the words of a name without its unit in brackets, in small letters."""
    return set(_words(_BRACKETS.sub(" ", name)))


def _words(name: str) -> list[str]:
    return [word.lower() for word in _SPLIT.split(name) if word]
