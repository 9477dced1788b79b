# SPDX-License-Identifier: Apache-2.0
"""Parsing of dates and times of day in table cells, in common notations."""

import re
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.on_demand import pd

ORDERS: Final = ("d/m/y", "m/d/y")
"""Values of ``clock.unit`` that resolve an ambiguous order of day and month."""

_NO_TIME: Final = -(2**63)
_SECOND: Final = 1_000_000_000
_DAY: Final = 86_400 * _SECOND
_ISO: Final = re.compile(r"\s*\d{4}-\d\d-\d\d([T ]\d\d:|\s*$)")
_DATE: Final = (
    r"(?:[^\W\d]{2,9}\.?,?\s+)?(?P<a>\d{1,4})(?P<sep>[./ -]\s?)(?P<b>\d{1,2}|[^\W\d]{3,9})\.?"
    r"(?P=sep)(?P<c>\d{4}|\d{2})\.?"
)
_TIME: Final = (
    r"(?P<h>\d{1,3}):(?P<m>\d{2})(?::(?P<s>\d{2})(?:[.,:](?P<f>\d{1,9}))?)?"
    r"\s*(?P<half>[AaPp]\.?\s?[Mm]\.?)?\s*(?:Uhr)?\s*(?P<zone>Z|UTC|GMT|[+-]\d\d:?\d\d)?"
)
_BOTH: Final = re.compile(rf"^\s*{_DATE}(?:[T\s,;_]\s*-?\s*{_TIME})?\s*$")
_CLOCK: Final = re.compile(rf"^\s*{_TIME}\s*$")
_MINUTES: Final = re.compile(r"^\s*(?P<m>\d{1,4}):(?P<s>\d{2})[.,](?P<f>\d{1,9})\s*$")
_COMPACT: Final = re.compile(
    r"^\s*(?P<a>\d{4})(?P<b>\d{2})(?P<c>\d{2})[T_ -](?P<h>\d{2}):?(?P<m>\d{2}):?(?P<s>\d{2})"
    r"(?:[.,](?P<f>\d{1,9}))?\s*(?P<zone>Z)?\s*$"
)
_MONTHS: Final = (
    *("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"),
    *("jan", "feb", "mär", "apr", "mai", "jun", "jul", "aug", "sep", "okt", "nov", "dez"),
)


@dataclass(frozen=True, eq=False)
class WrittenTimes:
    """Times parsed from a column of cells."""

    values: NDArray[np.int64]
    """Time since 1970, or since midnight or the start if ``is_of_day``, ``(n,)`` [ns].

    The smallest int64 marks cells without a time.
    """

    is_of_day: bool = False
    """Whether the cells contain only times of day or durations, no dates."""

    exchanged: NDArray[np.int64] | None = None
    """Values with day and month swapped, ``(n,)`` [ns]; None if the order is unambiguous."""

    problem: str = ""
    """Row and content of a cell that is not a valid time; empty if all are."""

    example: str = ""
    """Row and content of the first cell with a date."""


def read_times(column: "pd.Series[Any]") -> WrittenTimes | None:
    """Parse a column of dates or strings as times; return None if it does not contain times."""
    if pd.api.types.is_datetime64_any_dtype(column.dtype):
        return WrittenTimes(_stamps(column))
    if pd.api.types.is_numeric_dtype(column.dtype):
        return None
    filled = column.dropna()
    first = str(filled.iloc[0]) if len(filled) else ""
    if _ISO.match(first):
        stamps = _stamps(pd.to_datetime(column, utc=True, format="ISO8601", errors="coerce"))
        missing = column.isna().to_numpy(bool)
        if not np.any((stamps == _NO_TIME) & ~missing):
            return WrittenTimes(stamps)
    for pattern in (_BOTH, _COMPACT, _CLOCK, _MINUTES):
        if pattern.match(first):
            times = _read(column, pattern)
            read = np.count_nonzero(times.values != _NO_TIME)
            return times if read > 0.5 * len(filled) else None
    return None


def is_time(cell: str) -> bool:
    """Return whether a cell looks like a date or a time of day."""
    return any(pattern.match(cell) for pattern in (_BOTH, _COMPACT, _CLOCK, _MINUTES))


def _stamps(column: "pd.Series[Any]") -> NDArray[np.int64]:
    moments = pd.DatetimeIndex(column)
    moments = moments.tz_convert(None) if moments.tz is not None else moments
    return moments.to_numpy().astype("datetime64[ns]").astype(np.int64)


def _read(column: "pd.Series[Any]", pattern: re.Pattern[str]) -> WrittenTimes:
    texts = column.astype(str).astype(object)
    parts = texts.str.extract(pattern)
    missing = column.isna().to_numpy(bool) | (texts.str.strip() == "").to_numpy(bool)
    unread = parts["m" if "a" not in parts else "a"].isna().to_numpy(bool) & ~missing
    of_day = _of_day(parts)
    if "a" not in parts:
        values = np.where(unread | missing, _NO_TIME, of_day)
        return WrittenTimes(values, is_of_day=True, problem=_problem(texts, unread))
    days, exchanged = _days(parts)
    unread |= (days == _NO_TIME) & ~missing
    is_read = ~unread & ~missing
    values = np.where(is_read, days * _DAY + of_day, _NO_TIME)
    exchanged_values = None
    if exchanged is not None:
        exchanged_values = np.where(is_read, exchanged * _DAY + of_day, _NO_TIME)
    row = int(np.argmax(is_read))
    example = f"row {row + 1}: {texts.iloc[row].strip()!r}"
    return WrittenTimes(
        values, exchanged=exchanged_values, problem=_problem(texts, unread), example=example
    )


def _problem(texts: "pd.Series[Any]", unread: NDArray[np.bool_]) -> str:
    if not np.any(unread):
        return ""
    row = int(np.argmax(unread))
    return (
        f"row {row + 1}: {texts.iloc[row].strip()!r} is not a time in the format of the cells above"
    )


def _of_day(parts: "pd.DataFrame") -> NDArray[np.int64]:
    """Return UTC times since midnight [ns]; 0 for cells without a time of day."""

    def number(name: str) -> NDArray[np.int64]:
        if name not in parts:
            return np.zeros(len(parts), dtype=np.int64)
        return pd.to_numeric(parts[name], errors="coerce").fillna(0).to_numpy(np.int64)

    hours = number("h")
    if "half" in parts:
        half = parts["half"].str[:1].str.lower()
        hours = np.where(half.notna(), hours % 12, hours) + 12 * (half == "p").to_numpy(np.int64)
    digits = parts["f"].str.ljust(9, "0")
    fraction = pd.to_numeric(digits, errors="coerce").fillna(0).to_numpy(np.int64)
    seconds = 3600 * hours + 60 * number("m") + number("s") - _zone_s(parts)
    return seconds * _SECOND + fraction


def _zone_s(parts: "pd.DataFrame") -> NDArray[np.int64]:
    """Return the offset of each time zone from UTC [s]."""
    if "zone" not in parts:
        return np.zeros(len(parts), dtype=np.int64)
    zone = parts["zone"].str.extract(r"(?P<sign>[+-])(?P<h>\d\d):?(?P<m>\d\d)")
    ahead = 3600 * zone["h"].astype(float) + 60 * zone["m"].astype(float)
    signs = np.where(zone["sign"] == "-", -1, 1)
    return np.asarray(signs * ahead.fillna(0.0).to_numpy(float), dtype=np.int64)


def _days(parts: "pd.DataFrame") -> tuple[NDArray[np.int64], NDArray[np.int64] | None]:
    """Return days since 1970, ``(n,)``, and the days with day and month swapped if ambiguous."""
    a, c = (pd.to_numeric(parts[name], errors="coerce") for name in "ac")
    names = parts["b"].str[:3].str.lower()
    months = names.map({name: i % 12 + 1 for i, name in enumerate(_MONTHS)})
    b = pd.to_numeric(parts["b"], errors="coerce").fillna(months)
    if a.max() > 31:
        return _days_of(a, b, c), None
    century = c.where(c > 99, c + 2000)
    if months.notna().any():
        return _days_of(century, b, a), None
    is_point = (parts["sep"].str.strip() == ".").any() if "sep" in parts else False
    is_half_day = "half" in parts and parts["half"].notna().any()
    if a.max() > 12 or (is_point and b.max() <= 12):
        return _days_of(century, b, a), None
    if b.max() > 12 or is_half_day:
        return _days_of(century, a, b), None
    if (a.dropna() == b.dropna()).all():
        return _days_of(century, b, a), None
    return _days_of(century, b, a), _days_of(century, a, b)


def _days_of(
    years: "pd.Series[Any]", months: "pd.Series[Any]", days: "pd.Series[Any]"
) -> NDArray[np.int64]:
    frame = pd.DataFrame({"year": years, "month": months, "day": days})
    moments = pd.to_datetime(frame, errors="coerce").to_numpy().astype("datetime64[D]")
    return np.where(np.isnat(moments), _NO_TIME, moments.astype(np.int64))
