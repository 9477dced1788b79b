"""Rows of numbers are kept to the last bit in the memory of their bits."""

import math
import tracemalloc
from typing import NamedTuple

import numpy as np
import pytest

from ema_monitor.prognosis.packed_rows import PackedRows


class Row(NamedTuple):
    stamp_ns: int
    hours: float
    is_counted: bool


ROWS = [Row(2**63 - 1, 0.1, True), Row(-(2**63), -0.0, False), Row(7, math.inf, True)]


def packed(rows: list[Row]) -> PackedRows[Row]:
    made = PackedRows(Row)
    for row in rows:
        made.append(row)
    return made


def test_rows_come_back_as_plain_values():
    rows = packed(ROWS)
    assert (len(rows), list(rows)) == (3, ROWS)
    assert (rows[0], rows[-1], rows[-3]) == (ROWS[0], ROWS[2], ROWS[0])
    assert [type(value) for value in rows[1]] == [int, float, bool]
    assert math.copysign(1.0, rows[1].hours) == -1.0
    rows.append(Row(1, math.nan, False))
    assert math.isnan(rows[3].hours)


@pytest.mark.parametrize("place", [3, -4])
def test_place_without_a_row_is_named(place: int):
    rows = packed(ROWS)
    with pytest.raises(IndexError, match=f"place {place} of 3 rows"):
        _ = rows[place]
    with pytest.raises(IndexError, match=f"place {place} of 3 rows"):
        rows[place] = ROWS[0]
    assert list(rows) == ROWS


def test_row_is_replaced_and_rows_are_chosen():
    rows = packed(ROWS)
    rows[1] = Row(5, 2.5, True)
    assert list(rows) == [ROWS[0], Row(5, 2.5, True), ROWS[2]]
    rows[-1] = Row(6, 3.5, False)
    assert list(rows) == [ROWS[0], Row(5, 2.5, True), Row(6, 3.5, False)]
    rows[2] = ROWS[2]
    chosen = rows.only(np.array([True, False, True]))
    chosen.append(ROWS[1])
    assert list(chosen) == [ROWS[0], ROWS[2], ROWS[1]]
    assert len(rows) == 3


def test_column_is_a_copy_that_stays_as_it_was():
    rows = packed(ROWS)
    column = rows.column("stamp_ns")
    rows.append(Row(8, 1.0, True))
    rows[2] = Row(9, 1.0, True)
    assert column.dtype == np.int64
    assert column.tolist() == [row.stamp_ns for row in ROWS]
    assert packed([]).column("hours").size == 0


def test_number_beyond_64_bits_is_refused():
    with pytest.raises(OverflowError):
        packed([Row(2**63, 0.0, True)])


def test_memory_of_a_row_is_that_of_its_bits():
    rows = packed(ROWS)
    tracemalloc.start()
    for number in range(10_000):
        rows.append(Row(number, 0.1 * number, True))
    grown = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert grown < 10_000 * 17 * 1.2
