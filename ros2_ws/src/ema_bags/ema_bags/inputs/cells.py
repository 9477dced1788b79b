# SPDX-License-Identifier: Apache-2.0
"""Parsing of numbers in table cells: decimal commas, thousands separators, Unicode minus signs."""

import re
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.on_demand import pd

_MINUS: Final = str.maketrans(dict.fromkeys("\u2212\u2010\u2011\u2012\u2013\ufe63\uff0d", "-"))
_SPACES: Final = str.maketrans(dict.fromkeys("\u00a0\u2007\u2009\u202f", " ") | {"\u2019": "'"})
_SIGNED: Final = re.compile(r"^\(\s*([^()+-]+?)\s*\)$|^([\d.,' ]+)-$|^-\s+(?=[\d.,])")
_FORTRAN: Final = re.compile(r"^([+-]?[\d.,]+)[dD]([+-]?\d+)$")
_MISSING: Final = frozenset(("", "-", "--", "---", "nan", "na", "n/a", "none", "null", "<na>"))
_LITERAL: Final = frozenset(("nan", "inf", "+inf", "-inf", "infinity", "-infinity"))
_MOSTLY: Final = 0.5


@dataclass(frozen=True, eq=False)
class WrittenNumbers:
    """Numbers parsed from a column of cells."""

    values: NDArray[np.float64]
    """Parsed numbers, ``(n,)``; NaN for cells without a number."""

    problem: str = ""
    """Row and content of a cell that cannot be parsed; empty if all can."""

    decimal: str = ""
    """Decimal sign, if a cell proves it; else empty."""

    thousands: str = ""
    """Character read as thousands separator that could be a decimal sign; empty if none."""

    example: str = ""
    """Row and content of a cell that contains ``thousands``."""

    unclear: str = ""
    """Row and content of a cell whose decimal sign could be a thousands separator.

    Empty if another cell, such as 0.5, 12.75 or 1234.500, rules this out.
    """


def is_number(cell: str, decimal: str) -> bool:
    """Return whether a cell is a number with the given decimal sign, or a word such as nan or inf.

    The number must not have thousands separators.
    """
    text = _plain(cell)
    return bool(re.match(_number(decimal), text)) or text.lower() in _LITERAL


def may_be_number(cell: str) -> bool:
    """Return whether a cell is a number with any decimal sign or thousands separator."""
    text = _plain(cell)
    return any(is_number(cell, mark) or re.match(_grouped(mark), text) for mark in ".,")


def read_numbers(column: "pd.Series[Any]", decimal: str) -> WrittenNumbers | None:
    """Parse a column of strings as numbers; return None if most cells are not numbers.

    Cells with digits that are not numbers are reported in ``problem``; words become NaN.

    Parameters
    ----------
    column
        Cells as strings.
    decimal
        Decimal sign of the table, "." or ",". If it does not fit the column but the alternative
        fits all cells, the alternative is used.
    """
    texts = _texts(column)
    missing = (column.isna() | texts.str.lower().isin(_MISSING)).to_numpy(bool)
    if missing.all():
        return None
    numbers = _read(texts, missing, decimal)
    if numbers.problem:
        swapped = _read(texts, missing, "," if decimal == "." else ".")
        if not swapped.problem and swapped.decimal:
            numbers = swapped
    is_read = np.isfinite(numbers.values) | texts.str.contains(r"\d", regex=True).to_numpy(bool)
    share = np.isfinite(numbers.values).sum() / (~missing).sum()
    if share > _MOSTLY or (numbers.problem and is_read.all() and share > 0.0):
        return numbers
    return None


def shows_decimals(values: NDArray[Any]) -> bool:
    """Return whether any value has a fraction that cannot be a misread group of thousands."""
    parts = np.abs(values[np.isfinite(values)])
    parts = parts[parts % 1.0 != 0.0]
    thousands = parts * 1e3
    is_finer = np.abs(thousands - np.rint(thousands)) > 1e-6 * parts
    # A thousands separator follows one to three digits.
    return bool(np.any((parts < 1.0) | (parts >= 1e3) | is_finer))


def _read(texts: "pd.Series[Any]", missing: NDArray[np.bool_], decimal: str) -> WrittenNumbers:
    mark = "," if decimal == "." else "."
    grouped = texts.str.match(_grouped(decimal)).to_numpy(bool)
    plain = texts.where(~grouped, texts.str.replace(rf"[ '{mark}]", "", regex=True))
    if decimal == ",":
        # With a decimal comma, a point makes a cell invalid.
        plain = plain.where(~plain.str.contains(".", regex=False), "x0")
        plain = plain.str.replace(",", ".")
    values = pd.to_numeric(plain.where(~missing), errors="coerce").to_numpy(float)
    has_digits = texts.str.contains(r"\d", regex=True).to_numpy(bool)
    bad = has_digits & ~missing & np.isnan(values)
    marked = grouped & texts.str.contains(mark, regex=False).to_numpy(bool)
    problem, example = "", ""
    if np.any(bad):
        problem = f"{_place(texts, int(np.argmax(bad)))} is not a number"
    elif np.any(marked):
        example = _place(texts, int(np.argmax(marked)))
        # A program that writes thousands separators writes them in all large numbers.
        least = np.min(np.abs(values[marked]))
        bare = ~grouped & np.isfinite(values) & (np.abs(values) >= least)
        bare &= ~texts.str.contains("e", case=False, regex=False).to_numpy(bool)
        if np.any(bare):
            problem = (
                f"{example} has {mark!r} as thousands separator, but "
                f"{_place(texts, int(np.argmax(bare)))} has none"
            )
    cells = texts[~missing]
    shown = cells[cells.str.contains(decimal, regex=False)]
    # Two thousands groups, or both characters in one number, are unambiguous.
    doubtful = cells[marked[~missing]]
    is_sure = bool(
        (doubtful.str.count(re.escape(mark)) > 1).any()
        or doubtful.str.contains(decimal, regex=False).any()
    )
    is_decimal = len(shown) and not shown.str.match(_grouped(mark)).all()
    integers = cells.drop(shown.index)
    is_unclear = len(shown) and len(integers) and not is_decimal
    is_unclear = is_unclear and bool(integers.str.match(r"^[+-]?\d{1,3}$").all())
    unclear = _place(texts, int(np.argmax(texts.index == shown.index[0]))) if is_unclear else ""
    return WrittenNumbers(
        values,
        problem,
        decimal if is_decimal or is_sure else "",
        mark if np.any(marked) and not is_sure else "",
        example,
        unclear,
    )


def _texts(column: "pd.Series[Any]") -> "pd.Series[Any]":
    # Use object dtype: Arrow's regular expressions do not support back references.
    return pd.Series([_plain(str(cell)) for cell in column], column.index, dtype=object)


def _plain(cell: str) -> str:
    """Normalize a cell: ASCII signs, leading minus, ``e`` for exponents."""
    text = _FORTRAN.sub(r"\1e\2", cell.strip().translate(_MINUS).translate(_SPACES))
    match = _SIGNED.match(text)
    if match is None:
        return text
    return "-" + (match[1] or match[2] or text[match.end() :]).strip()


def _number(decimal: str) -> str:
    point = re.escape(decimal)
    return rf"^[+-]?(?:\d+{point}?\d*|{point}\d+)(?:[eE][+-]?\d+)?$"


def _grouped(decimal: str) -> str:
    """Return the regular expression of a number with thousands separators."""
    mark = re.escape("," if decimal == "." else ".")
    return rf"^[+-]?[1-9]\d{{0,2}}([{mark} '])\d{{3}}(?:\1\d{{3}})*(?:{re.escape(decimal)}\d*)?$"


def _place(texts: "pd.Series[Any]", row: int) -> str:
    return f"row {row + 1}: {str(texts.iloc[row]).strip()!r}"
