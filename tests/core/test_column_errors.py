# SPDX-License-Identifier: Apache-2.0
"""Wrong columns: the usual mistakes behind a factor, and the wording of the error."""

import math

import pytest

from ema_core.column_errors import (
    PEAK_FOR_RMS,
    ColumnError,
    Kind,
    Reference,
    UnrelatedColumn,
    mistaken_unit,
    usual_mistake,
    usual_mistakes,
)
from ema_core.column_wording import error_text, question
from ema_core.units import ANGLES, SPEEDS, UNITS

TAU = 1.0 / 120.0
COLUMNS = ("command", "position", "speed", "current")


def kind_of(column, factor):
    mistake = usual_mistake(column, factor, TAU)
    return mistake and mistake.kind


@pytest.mark.parametrize("column", ["current", "speed", "position"])
def test_gear_ratio_in_a_column_is_named(column):
    assert kind_of(column, 121.0) is Kind.SHAFT
    assert kind_of(column, 1.0 / 118.0) is Kind.GEAR_RATIO
    assert kind_of(column, 17.0) is None


@pytest.mark.parametrize("column", COLUMNS)
def test_each_usual_mistake_is_recognised_by_its_factor(column):
    """Of two mistakes with the same factor, either may be reported."""
    for mistake in usual_mistakes(column, TAU):
        recognised = usual_mistake(column, 1.01 * mistake.factor, TAU)
        assert recognised is not None
        assert abs(recognised.factor / mistake.factor - 1.0) < 0.05


def test_factor_near_one_is_not_a_mistake():
    """Faults and tolerances of sensors change a column by less than a tenth."""
    for column in COLUMNS:
        for factor in (1.0, 1.1, 0.9, 1.2):
            assert usual_mistake(column, factor, TAU) is None


@pytest.mark.parametrize(
    ("sizes", "unit", "stated", "factor"),
    [
        (ANGLES, "deg", "rad", math.degrees(1.0)),
        (SPEEDS, "rpm", "rad/s", 30.0 / math.pi),
        (SPEEDS, "rad/s", "rpm", math.pi / 30.0),
        (UNITS, "mm", "in", 25.4),
    ],
)
def test_factor_of_a_mistaken_unit_is_the_ratio_of_the_units(sizes, unit, stated, factor):
    """A quantity in ``unit`` is read as if it were in ``stated``."""
    assert mistaken_unit(sizes, unit, stated).factor == pytest.approx(factor)


@pytest.mark.parametrize(
    ("column", "factor", "reference", "words"),
    [
        ("speed", 9.55, Reference.POSITION, "what the position implies: is it in rpm?"),
        ("speed", 9.55, Reference.RECORDS, "have: is it in rpm, and was in rad/s?"),
        ("speed", 57.3, Reference.POSITION, "is it in degrees a second?"),
        ("position", 57.3, Reference.RECORDS, "is it in degrees, and was in radians?"),
        ("position", 1.0 / 57.3, Reference.SPEED, "is it in radians, and not in degrees?"),
        ("command", 1.0 / 57.3, Reference.POSITION, "in radians, and the position in degrees?"),
        ("current", 1.41, Reference.INERTIA, "the inertia implies: is a peak given for RMS?"),
        ("current", 0.71, Reference.INERTIA, "is RMS given for a peak?"),
        ("speed", 60.0, Reference.RECORDS, "is it per minute, and was per second?"),
        ("speed", -9.55, Reference.POSITION, "is its sign reversed, and is it in rpm?"),
        ("current", 1e-3, Reference.MODEL, "are whole units read as thousandths?"),
        ("current", 3.0, Reference.INERTIA, "is its unit, or its scale, right?"),
        ("current", 3.0, Reference.MODEL, "is its unit, or the gear ratio, right?"),
    ],
)
def test_error_message_asks_about_the_usual_mistake(column, factor, reference, words):
    error = ColumnError.of((column,), factor, reference, TAU)
    text = error_text(error)
    assert text.startswith(f"the {column} is {factor:.3g} times what ")
    assert text.endswith(words)


def test_factor_close_to_the_model_is_not_reported_as_a_mistake():
    """The model is off by 8 %; a factor of 1.5 is more likely a wrong parameter than a peak."""
    model = Reference.MODEL
    [mistake] = ColumnError.of(("speed",), 1.25 * 30.0 / math.pi, model, TAU).mistakes
    assert (mistake.kind, mistake.unit) == (Kind.UNIT, "rpm")
    assert not ColumnError.of(("current",), 1.5, model, TAU).mistakes
    assert ColumnError.of(("current",), 1.5, Reference.DRIVE, TAU).mistakes == (PEAK_FOR_RMS,)


def test_several_columns_and_unrelated_columns_are_named():
    both = ColumnError.of(("position", "command"), 57.3, Reference.SPEED, TAU)
    assert error_text(both).startswith("the position and command is 57.3 times what the speed")
    assert error_text(UnrelatedColumn("current", 0.123)) == (
        "the current has little to do with what the model expects (correlation 0.12): is it "
        "another column?"
    )


@pytest.mark.parametrize("column", COLUMNS)
@pytest.mark.parametrize("reference", Reference)
def test_every_mistake_has_a_question(column, reference):
    for mistake in usual_mistakes(column, TAU):
        assert question(column, mistake, reference).endswith("?")
