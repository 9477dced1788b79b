# SPDX-License-Identifier: Apache-2.0
"""Numbers as people write them: read, or refused with column, row and cell."""

import numpy as np
import pytest

from ema_bags.inputs.mapping import Table
from ema_bags.inputs.tables import read_columns

SPEEDS = [885.0, 1885.0, -12.0, -2113.0, 0.0, 999.0]


def table(tmp_path, cells, decimal=".", more=True):
    """Return a table with a column of cells; ``more`` adds columns that show the decimal sign."""
    lines = ["t;speed;pos"]
    for i, cell in enumerate(cells):
        position = f"0{decimal}{i}25" if more else f"{i}"
        lines.append(f'{i};"{cell}";{position}')
    path = tmp_path / "a.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def grouped(value, mark):
    return f"{value:,.0f}".replace(",", mark)


@pytest.mark.parametrize(
    ("mark", "decimal"),
    [
        (".", ","),
        (",", "."),
        ("'", "."),
        ("\u2019", "."),
        (" ", ","),
        ("\u202f", ","),
        ("\xa0", ","),
    ],
)
def test_thousands_separators_are_read(tmp_path, mark, decimal):
    cells = [grouped(value, mark) for value in [*SPEEDS, 1234567.0]]
    columns = read_columns(table(tmp_path, cells, decimal))
    assert list(columns.column("speed")) == [*SPEEDS, 1234567.0]


def test_quoted_thousands_are_read_in_a_table_with_commas(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text('t,pos,speed\n0,0.125,"1,885"\n1,0.25,885\n2,0.5,"-2,113.5"\n')
    assert list(read_columns(path).column("speed")) == [1885.0, 885.0, -2113.5]


def test_thousands_that_could_be_decimals_are_named(tmp_path):
    columns = read_columns(table(tmp_path, [grouped(value, ".") for value in SPEEDS], ","))
    [note] = columns.notes_of(["speed"])
    assert note == "column 'speed', row 2: '1.885' is read with '.' as thousands separator"


@pytest.mark.parametrize("minus", "\u2212\u2013\u2010\u2011\ufe63\uff0d")
def test_every_minus_sign_is_read(tmp_path, minus):
    cells = [f"{value:g}".replace("-", minus) for value in (*SPEEDS, -1.5e-7)]
    assert list(read_columns(table(tmp_path, cells)).column("speed")) == [*SPEEDS, -1.5e-7]


def test_accountants_minus_signs_are_read(tmp_path):
    cells = ["(12.5)", "12.5-", "- 12.5", "+12.5", "( 1,885.5 )"]
    columns = read_columns(table(tmp_path, cells))
    assert list(columns.column("speed")) == [-12.5, -12.5, -12.5, 12.5, -1885.5]


def test_column_with_foreign_decimal_signs_is_read_if_its_cells_leave_no_doubt(tmp_path):
    columns = read_columns(table(tmp_path, ["12.34", "1.885", "0.5"], ","))
    assert list(columns.column("speed")) == [12.34, 1.885, 0.5]
    columns = read_columns(table(tmp_path, ["12,34", "1,885", "0,5"], "."))
    assert list(columns.column("speed")) == [12.34, 1.885, 0.5]


@pytest.mark.parametrize(
    ("cells", "decimal", "words"),
    [
        (["1.5", "1.2.3", "2.5"], ".", "row 2: '1.2.3' is not a number"),
        (["1.5", "12:30", "2.5"], ".", "row 2: '12:30' is not a number"),
        (["1.5", "2.5 A", "2.5"], ".", "row 2: '2.5 A' is not a number"),
        (["1,5", "1,23,4", "2,5"], ",", "row 2: '1,23,4' is not a number"),
        (["1.885", "885", "4500"], ",", "row 1: '1.885' has '.' as thousands separator, but row 3"),
    ],
)
def test_cell_that_is_not_a_number_is_refused_when_its_column_is_used(
    tmp_path, cells, decimal, words
):
    columns = read_columns(table(tmp_path, cells, decimal))
    assert len(columns.column("pos")) == len(cells)
    with pytest.raises(ValueError, match=rf"column 'speed', {words}"):
        columns.column("speed")
    with pytest.raises(ValueError, match=rf"column 'speed', {words}"):
        columns.column("pos + speed")


@pytest.mark.parametrize("mark", ",.")
def test_thousands_are_refused_if_nothing_shows_the_decimal_sign(tmp_path, mark):
    path = table(tmp_path, [grouped(value, mark) for value in SPEEDS], more=False)
    with pytest.raises(
        ValueError, match=rf"'speed', row 2: '1\{mark}885' may contain a thousands separator or"
    ):
        read_columns(path).column("speed")
    decimal = "," if mark == "." else "."
    assert list(read_columns(path, Table(decimal=decimal)).column("speed")) == SPEEDS
    assert read_columns(path, Table(decimal=mark)).column("speed")[1] == 1.885


def test_thousands_separator_that_may_be_a_decimal_sign_is_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("a;b;c;speed\n0,5;0,5;12.34;1.885\n0,5;0,25;0.5;885\n0,5;0,1;7.5;12\n")
    with pytest.raises(
        ValueError, match=r"'speed', row 1: '1\.885': '\.' is the decimal sign in other"
    ):
        read_columns(path).column("speed")


def test_words_among_numbers_become_nan(tmp_path):
    cells = ["1.5", "ERR", "-", "", "n/a", "--", "2.5", "3.5", "overflow", "4.5", "5", "6", "7"]
    speed = read_columns(table(tmp_path, cells)).column("speed")
    assert np.count_nonzero(np.isnan(speed)) == 6


def test_column_of_texts_is_refused_with_a_cell(tmp_path):
    with pytest.raises(ValueError, match=r"'speed' contains no numbers: row 1: '12\.5 rpm'"):
        read_columns(table(tmp_path, ["12.5 rpm", "13.5 rpm"])).column("speed")
