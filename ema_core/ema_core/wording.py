# SPDX-License-Identifier: Apache-2.0
"""Formatting shared by messages for users."""

import math
from collections.abc import Iterable, Sequence
from difflib import get_close_matches


def counted(number: int, noun: str) -> str:
    """Return a number with its noun, such as "2 windows"; the plural adds "s", "es" after "ch"."""
    return f"{number} {noun}" + ("" if number == 1 else "es" if noun.endswith("ch") else "s")


def beside_limit(value: float, limit: float, digits: int = 3) -> tuple[str, str]:
    """Return a value and its limit as strings, with enough digits to show their difference."""
    texts = f"{value:.{digits}g}", f"{limit:.{digits}g}"
    if texts[0] == texts[1] and value != limit and digits < 17:
        return beside_limit(value, limit, digits + 1)
    return texts


def one_line(name: str, text: str, most: int) -> str:
    """Return a string as one line, with white space collapsed.

    Raises
    ------
    ValueError
        If it does not have 1 to ``most`` printable characters; the message begins with ``name``.
    """
    line = " ".join(text.split())
    if not 0 < len(line) <= most or not line.isprintable():
        raise ValueError(f"{name}: expected 1 to {most} printable characters, not {len(line)}")
    return line


def time_text(seconds: float) -> str:
    """Return a duration [s] as a string in s, min, h or d, or "-" if it is not finite."""
    if not math.isfinite(seconds):
        return "-"
    for size, unit in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


def unknown_name(kind: str, name: object, names: Iterable[str]) -> str:
    """Return an error message for an unknown name that suggests the closest and lists all names."""
    by_lower_case = {item.lower(): item for item in names}
    close = get_close_matches(as_identifier(str(name)), by_lower_case, n=1)
    hint = f"did you mean {by_lower_case[close[0]]!r}? " if close else ""
    return f"unknown {kind} {name!r}; {hint}known: {', '.join(by_lower_case.values())}"


def as_identifier(label: str) -> str:
    """Return a label as an identifier: "short circuit A" becomes short_circuit_a."""
    return "_".join(label.lower().replace("-", " ").split())


def text_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table as plain text, with numbers right-aligned and words left-aligned."""
    columns = list(zip(headings, *rows, strict=True))
    padded = []
    for column in columns:
        width = max(map(len, column))
        is_figures = any(cell[:1].isdigit() for cell in column[1:])
        padded.append([cell.rjust(width) if is_figures else cell.ljust(width) for cell in column])
    return "\n".join("  ".join(line).rstrip() for line in zip(*padded, strict=True))
