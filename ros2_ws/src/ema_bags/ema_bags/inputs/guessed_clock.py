# SPDX-License-Identifier: Apache-2.0
"""Guessing the clock of a table from column names, units and values."""

import re
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.doubts import Doubt, DoubtKind
from ema_bags.inputs.mapping import EPOCHS, TIMES_NS, Clock
from ema_bags.inputs.names import roles_of, unit_in_name, unit_of
from ema_bags.inputs.series import NO_STAMP
from ema_bags.inputs.table_columns import TableColumns
from ema_core.wording import counted

_EPOCHS: Final = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"), (1e8, "s"))
_LEAST_STEP_S: Final = 9.5e-5
"""Smallest time step read as seconds if no unit is stated [s]."""

_FASTEST_NS: Final = 1e4
_SLOWEST_NS: Final = 1e9
_NO_UNITS: Final = frozenset(("utc", "gmt", "local", "abs", "absolute", "rel", "relative", "-"))
_ASSUMED_HZ: Final = 1000.0
"""Rate of a table without a time [Hz]."""

_STEPS: Final = ((5e4, "ns"), (50.0, "us"), (0.2, "ms"))


def guess_clock(columns: TableColumns, doubts: list[Doubt]) -> tuple[Clock, list[str]]:
    """Guess the clock of a table; return it and the names of the remaining columns.

    Doubts are appended to ``doubts``.

    Raises
    ------
    ValueError
        If a column looks like the time, but no column is a valid clock.
    """
    names = list(columns.values)
    named = [name for name in names if name in columns.dates or _is_time(columns, name)]
    remaining = [name for name in names if name not in named]
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
            doubts.append(Doubt(DoubtKind.CLOCK_UNIT, "clock", clock.source, entry=clock.unit))
        return clock, remaining if sums else [item for item in names if item != name]
    if errors:
        raise errors[0]
    if named := [*named, *(name for name in columns.texts if "time" in roles_of(name))]:
        raise ValueError(
            f"{columns.path}: column {named[0]!r} looks like the time, but "
            f"{_disorder(columns, named[0])}: set clock.source and clock.unit, or clock.rate_hz "
            "if the samples are regular (--set)"
        )
    for clock in [_clock_of(columns, name) for name in remaining if _may_be_time(columns, name)]:
        values = columns.values[clock.source]
        step_ns = _step_of(values) * TIMES_NS[clock.unit]
        is_usual = clock.source in columns.dates or _FASTEST_NS < step_ns < _SLOWEST_NS
        if is_usual and not _counts(values) and _is_clock(columns, clock):
            doubts.append(Doubt(DoubtKind.CLOCK_UNIT, "clock", clock.source, entry=clock.unit))
            return clock, [name for name in remaining if name != clock.source]
    doubts.append(Doubt(DoubtKind.NO_CLOCK, "clock", value=_ASSUMED_HZ))
    return Clock(rate_hz=_ASSUMED_HZ), remaining


def _is_time(columns: TableColumns, name: str) -> bool:
    """Return whether the name of a column, and its unit if it has one, denote a time."""
    unit = unit_of(columns.units.get(name, "")) or unit_in_name(name)
    return "time" in roles_of(name) and (not unit or unit in TIMES_NS)


def _may_be_time(columns: TableColumns, name: str) -> bool:
    """Return whether the unit of a column, if it has one, allows a time."""
    unit = columns.units.get(name, "")
    return not unit or unit.lower() in _NO_UNITS or unit_of(unit) in TIMES_NS


def _dated(columns: TableColumns, named: list[str]) -> list[str]:
    """Return the clock source that adds a date and a time of day; empty if a column is missing."""
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
    """Return a column as a clock, with the unit from its name or its values."""
    if name not in columns.values or name in columns.dates:
        return Clock(name, "ns")
    is_named = _is_time(columns, name)
    if is_named and (date := _date_in(columns.values[name])):
        raise ValueError(
            f"{columns.path}: column {name!r}: {date:.17g} looks like a date written as a number, "
            "yyyymmddhhmmss: expected separators (2026-03-30 08:00:00), or clock.rate_hz (--set)"
        )
    unit = _epoch_of(columns.values[name]) or _time_unit(columns, name)
    if not unit:
        unit = _unit_of_times(columns.values[name])
        step = _step_of(columns.values[name])
        if is_named and unit == "s" and 0.0 < step < _LEAST_STEP_S:
            raise ValueError(
                f"{columns.path}: column {name!r} has no unit, and its steps of {step:.3g} are too "
                "small for seconds: set clock.unit (--set), such as min, h or day"
            )
    return Clock(name, unit)


def _time_unit(columns: TableColumns, name: str) -> str:
    """Return the time unit in a column heading; empty if none is stated.

    Raises
    ------
    ValueError
        If the unit is unknown.
    """
    text = columns.units.get(name, "")
    first = re.split(r"[\s,;]", text.strip())[0].strip(".")
    unit = unit_of(text) or unit_of(first) or unit_in_name(name)
    if unit in TIMES_NS or not text or text.lower() in _NO_UNITS:
        return unit if unit in TIMES_NS else ""
    raise ValueError(
        f"{columns.path}: column {name!r}: unknown time unit {text!r}: expected "
        f"{', '.join(TIMES_NS)}; set clock.unit or clock.rate_hz (--set)"
    )


def _is_clock(columns: TableColumns, clock: Clock) -> bool:
    """Return whether more than 90 % of the time steps are positive, or more than 90 % negative."""
    stamps = columns.stamps(clock)
    steps = np.diff(stamps[stamps != NO_STAMP])
    return len(steps) > 0 and bool(np.mean(steps > 0) > 0.9 or np.mean(steps < 0) > 0.9)


def _counts(values: NDArray[Any]) -> bool:
    """Return whether the values are row numbers: more than 90 % of their steps are 1."""
    steps = np.diff(values[np.isfinite(values)])
    return len(steps) > 0 and bool(np.mean(steps == 1) > 0.9)


def _disorder(columns: TableColumns, name: str) -> str:
    """Return a clause that states why a column of times is not a clock."""
    if name in columns.texts:
        cells = columns.texts[name]
        return f"its cells are not times: {next((cell for cell in cells if cell == cell), '')!r}"
    values = columns.stamps(_clock_of(columns, name))
    values = values[values != NO_STAMP]
    if len(values) < 2 or np.ptp(values) == 0:
        return "never changes and is not a clock"
    steps = np.diff(values)
    back = int(np.count_nonzero(steps < 0))
    if not back:
        return f"changes in only {np.mean(steps > 0):.0%} of the rows"
    return (
        f"decreases {counted(back, 'time')} in {counted(len(values), 'row')} and is not a clock "
        "(if the rows are out of order, sort them by it)"
    )


def _epoch_of(values: NDArray[Any]) -> str:
    """Return the unit of times whose epoch is not 1970; empty if no such unit fits.

    A unit fits if the times lie between 2000 and 2060, at a plausible sample rate.
    """
    finite = values[np.isfinite(values)].astype(float)
    if len(finite) < 2:
        return ""
    step = abs(float(np.median(np.diff(finite))))
    for unit, epoch in EPOCHS.items():
        size = TIMES_NS[unit]
        years = (finite[-1] - epoch) * size / (365.25 * TIMES_NS["day"])
        if 30.0 < years < 90.0 and _FASTEST_NS < step * size < _SLOWEST_NS:
            # Seconds since 1970 cannot be mistaken for seconds since 1904 before 2066.
            return unit
    return ""


def _step_of(values: NDArray[Any]) -> float:
    """Return the absolute median step of a column; 0 for fewer than two values."""
    finite = values[np.isfinite(values)].astype(float)
    return abs(float(np.median(np.diff(finite)))) if len(finite) > 1 else 0.0


def _date_in(values: NDArray[Any]) -> float:
    """Return the first value if all values are dates in the form yyyymmddhhmmss, else 0."""
    numbers = np.floor(values[np.isfinite(values)].astype(float))
    if not len(numbers):
        return 0.0
    parts = [numbers // 10.0**power % 100 for power in (8, 6, 4, 2, 0)]
    years = numbers // 10.0**10
    is_date = (years >= 1970) & (years < 2100) & (parts[0] >= 1) & (parts[0] <= 12)
    is_date &= (parts[1] >= 1) & (parts[1] <= 31)
    for part, most in zip(parts[2:], (24, 60, 60), strict=True):
        is_date &= part < most
    return float(values[np.isfinite(values)][0]) if bool(np.all(is_date)) else 0.0


def _unit_of_times(values: NDArray[Any]) -> str:
    finite = values[np.isfinite(values)].astype(float)
    step = _step_of(values)
    for least, unit in _EPOCHS if len(finite) else ():
        # Plausible as a time since 1970 at a usual sample rate.
        if abs(finite[-1]) > least and _FASTEST_NS < step * TIMES_NS[unit] < _SLOWEST_NS:
            return unit
    return next((unit for least, unit in _STEPS if step > least), "s")
