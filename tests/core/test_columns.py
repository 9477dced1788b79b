# SPDX-License-Identifier: Apache-2.0
"""Wrong columns: relations that show them, the usual mistakes, and the wording of the error."""

import math

import numpy as np
import pytest

from ema_core.columns.errors import ColumnError, FrozenColumn, Reference, UnrelatedColumn
from ema_core.columns.frozen import frozen_column
from ema_core.columns.mistakes import (
    PEAK_FOR_RMS,
    Kind,
    mistaken_unit,
    usual_mistake,
    usual_mistakes,
)
from ema_core.columns.of_current import reversed_current, wrong_current
from ema_core.columns.of_model import wrong_column_of_model
from ema_core.columns.of_records import wrong_effort_of_record, wrong_speed_of_record
from ema_core.columns.of_window import WindowRelations, wrong_amplitude, wrong_column_of_window
from ema_core.columns.repetition import held_column
from ema_core.columns.wording import error_text, question
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


@pytest.mark.parametrize(
    ("speed", "tracking", "inertia", "columns"),
    [
        (1.2, 1.5, 1.2, None),
        (9.55, 2.0, 1.0, ("position",)),
        # A wrong speed scales the apparent inertia by the inverse factor.
        (9.55, 1.0, 1.0 / 9.55, ("speed",)),
        (9.55, 1.0, 1.0, ("position", "command")),
        (9.55, 1.0, None, ("position", "command")),
        (1.0, -1.0, 1.0, ("command",)),
        (1.0, 1.0, 1.3, ("current",)),
        (1.0, 1.0, None, None),
    ],
)
def test_column_that_contradicts_the_others_is_wrong(speed, tracking, inertia, columns):
    error = wrong_column_of_window(WindowRelations(speed, tracking, inertia), TAU)
    assert (error and error.columns) == columns


@pytest.mark.parametrize(("gain", "unit"), [(1.43, "peak"), (0.7, "RMS"), (1.5, None), (1.0, None)])
def test_gain_between_peak_and_rms_is_a_wrong_amplitude(gain, unit):
    error = wrong_amplitude(gain)
    assert (error and error.mistakes[0].unit) == unit


@pytest.mark.parametrize(
    ("size", "correlation", "kinds"),
    [
        (1.0, -0.5, [Kind.SIGN]),
        (1e3, 0.3, None),
        (5e3, 0.9, [Kind.SCALE]),
        (2e-4, 0.9, [Kind.SCALE]),
        (40.0, 0.9, []),
        (25.0, 0.9, None),
    ],
)
def test_current_that_contradicts_acceleration_and_friction_is_wrong(size, correlation, kinds):
    error = wrong_current(size, correlation, TAU)
    assert (error and [mistake.kind for mistake in error.mistakes]) == kinds


def test_only_a_reversed_current_both_opposes_the_motion_and_gains_energy():
    assert reversed_current(-0.5, -0.2) is not None
    for dissipation, work_share in ((-0.5, 0.0), (-0.3, -0.2), (None, -0.2)):
        assert reversed_current(dissipation, work_share) is None


def test_column_is_compared_with_the_model_by_correlation_and_ratio():
    unrelated = wrong_column_of_model("speed", 1.0, 0.4, TAU)
    assert unrelated == UnrelatedColumn("speed", 0.4)
    assert wrong_column_of_model("speed", 1.39, 0.9, TAU) is None
    error = wrong_column_of_model("speed", 9.0, 0.9, TAU)
    assert isinstance(error, ColumnError)
    assert error.mistakes[0].unit == "rpm"


def test_only_the_factor_of_a_common_mistake_makes_the_speed_of_a_record_wrong():
    error = wrong_speed_of_record("speed", 9.6, TAU)
    assert error is not None
    assert (error.reference, error.mistakes[0].unit) == (Reference.RECORDS, "rpm")
    assert wrong_speed_of_record("speed", 7.6, TAU) is None
    assert wrong_speed_of_record("speed", 4.9, TAU) is None


@pytest.mark.parametrize(
    ("friction", "inertia", "is_wrong"),
    [
        (8.0, 1.0, False),
        (8.0, 6.0, True),
        (0.1, 0.1, True),
        (8.0, None, False),
        (25.0, None, True),
        (0.1, None, True),
    ],
)
def test_effort_of_a_record_is_wrong_if_the_inertia_grows_as_well(friction, inertia, is_wrong):
    error = wrong_effort_of_record(friction, inertia, TAU)
    assert (error is not None) == is_wrong
    assert error is None or error.factor == friction


def test_column_is_frozen_if_another_column_shows_the_same_motion():
    still = np.array([2.0, np.nan, 2.0])
    assert frozen_column("position", still, ["command", "speed"]) == FrozenColumn(
        "position", 2.0, "command", 2
    )
    assert frozen_column("current", still, ["position"]) is not None
    assert frozen_column("current", np.array([2.0, 2.1]), ["position"]) is None
    # A blocked shaft shows neither speed nor a change of position.
    assert frozen_column("position", still, ["command"]) is None
    assert frozen_column("speed", still, ["speed"]) is None


def test_held_column_has_its_samples_per_update():
    motion = np.sin(0.01 * np.arange(3000))
    assert held_column("position", motion) is None
    regular = held_column("position", np.repeat(motion, 3))
    assert regular is not None
    assert (regular.mean, regular.longest, regular.is_regular) == (3.0, 3, True)
    is_new = np.random.default_rng(0).random(3000) < 0.5
    rows = np.maximum.accumulate(np.where(is_new, np.arange(3000), 0))
    irregular = held_column("position", motion[rows])
    assert irregular is not None
    assert not irregular.is_regular
    # Updates with a probability of 1/2; the mean is of 1500 updates.
    assert irregular.mean == pytest.approx(2.0, rel=0.1)
    assert irregular.longest > 5
