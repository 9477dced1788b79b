# SPDX-License-Identifier: Apache-2.0
"""Texts about changed, unchanged and unjudged quantities."""

from dataclasses import replace

import pytest

from ema_monitor.joint.comparison import Comparison, FigureChange, Improvement
from ema_monitor.joint.wording import HEADINGS, improvement_sentences, rows, smallest_text, summary
from ema_monitor.quantities import (
    FRICTION,
    FRICTION_OVER_INERTIA,
    GRAVITY,
    INERTIA,
    LOAD,
    TORQUE,
    VISCOUS,
)

from .comparisons import (
    CASES,
    EFFORT_UP,
    FRICTION_UP,
    HEALTHY,
    HIDDEN,
    LOADED,
    NOTHING,
    STILL,
    changed,
    comparison,
    not_judged,
    rival,
    unchanged,
)


def row(of: Comparison, label: str) -> tuple[str, ...]:
    [match] = [table_row for table_row in rows(of) if table_row[0] == label]
    return match[1:]


def test_change_is_stated_with_its_interval():
    assert summary(FRICTION_UP).startswith(
        "Coulomb friction rose 15.2 % (90 % interval 11.2 to 19.2 %). "
    )
    assert row(FRICTION_UP, "Coulomb friction") == ("+15.2 %", "+11.2 to +19.2 %", "changed")


def test_decrease_has_an_ascending_interval():
    fallen = comparison(changed(INERTIA, -0.2, 0.05))
    assert "Inertia fell 20.0 % (90 % interval 15.0 to 25.0 %)" in summary(fallen)
    assert row(fallen, "inertia")[:2] == ("-20.0 %", "-25.0 to -15.0 %")


def test_healthy_record_states_the_detectable_change_and_the_unjudged_quantities():
    assert summary(HEALTHY) == (
        "No quantity has changed: changes of Coulomb friction above 6 % would show. "
        "Not judged: play (it needs the speed of the motor, the position of "
        "the joint and several reversals), tracking lag (there is no position command)"
    )
    assert summary(comparison(not_judged(FRICTION))).startswith(
        f"No quantity has changed. Not judged: Coulomb friction ({HIDDEN}), "
    )
    assert row(HEALTHY, "Coulomb friction")[2] == "unchanged (changes above 6 % would show)"
    assert row(HEALTHY, "tracking lag") == ("", "", "not judged (there is no position command)")


@pytest.mark.parametrize(
    "of",
    [
        EFFORT_UP,
        comparison(
            changed(TORQUE, 1.0 / 1.22 - 1.0, 0.02, (FRICTION,)), rival(FRICTION, TORQUE, 0.22)
        ),
    ],
    ids=["friction first", "torque alone"],
)
def test_unseparated_friction_and_torque_are_a_change_of_effort(of: Comparison):
    words = summary(of)
    assert words.startswith("Effort at the same motion rose 22.0 % (90 % interval ")
    assert words.count("cannot be distinguished in this motion") == 1
    assert "friction rose" not in words
    assert "ampere fell" not in words
    assert "Not judged: play" in words


def test_other_rivals_are_named_with_the_quantity():
    words = summary(comparison(changed(INERTIA, 0.3, rivals=(GRAVITY,))))
    assert "Inertia rose 30.0 %" in words
    assert "Inertia and gravity cannot be distinguished in this motion" in words
    reported = row(comparison(changed(INERTIA, 0.3, rivals=(GRAVITY,))), "inertia")
    assert reported[2] == "changed (not distinguishable from gravity)"


def test_rival_has_no_numbers_in_the_table():
    reported = "not judged (this motion cannot distinguish it from Coulomb friction)"
    assert row(EFFORT_UP, "torque per unit of effort") == ("", "", reported)


def test_two_changes_with_a_common_rival_are_separated_from_it_once():
    payload = comparison(
        changed(GRAVITY, 0.4, rivals=(TORQUE,)), changed(INERTIA, 0.3, rivals=(TORQUE,))
    )
    words = summary(payload)
    assert words.index("Inertia rose 30.0 %") < words.index("Gravity rose 40.0 %")
    reported = (
        "Inertia and gravity cannot be distinguished from torque per unit of effort in this motion."
    )
    assert words.count(reported) == words.count("distinguished") == 1


def test_ratio_of_friction_and_inertia_is_stated_only_if_neither_is():
    ratio = changed(FRICTION_OVER_INERTIA, 0.2)
    assert "over inertia" not in summary(comparison(ratio, changed(FRICTION, 0.2)))
    assert "Coulomb friction over inertia rose 20.0 %" in summary(comparison(ratio))


def test_viscous_friction_is_expressed_as_a_share_of_all_friction():
    of = comparison(changed(VISCOUS, 0.12, 0.02))
    reported = "Viscous friction rose by 12.0 % of all friction at the usual speed (90 % interval "
    assert summary(of).startswith(reported)
    assert row(of, "viscous friction (of all friction at the usual speed)")[0] == "+12.0 %"


def test_absolute_change_has_its_unit():
    assert "Constant load changed by +0.50 N.m (90 % interval +0.40 to +0.60 N.m)" in summary(
        LOADED
    )
    assert row(LOADED, "constant load")[0] == "+0.50 N.m"


def test_record_that_shows_nothing_gives_the_reason_once():
    assert summary(NOTHING) == f"No quantity could be judged: {STILL}"
    assert {judgement for *_, judgement in rows(NOTHING)} == {f"not judged ({STILL})"}


def test_departed_figure_is_stated_though_no_quantity_has_changed():
    of = replace(HEALTHY, figures=(FigureChange("tracking_error", 3.1, 1e-5),))
    assert summary(of).startswith("Tracking error is 3.1 times the healthy value.")
    assert "No quantity has changed" not in summary(of)
    assert row(of, "tracking error") == ("× 3.1", "", "changed")


def test_departed_figures_share_a_sentence():
    figures = (FigureChange("effort_scatter", 3.07, 1e-9), FigureChange("error_scatter", 1.3, 1e-4))
    reported = "Effort scatter is 3.07 times and error scatter 1.3 times the healthy value"
    assert summary(replace(HEALTHY, figures=figures)).startswith(reported)


def test_change_that_rounds_to_zero_has_no_minus_sign():
    of = comparison(replace(unchanged(FRICTION), change=-2e-4, low=-4e-4, high=0.01))
    assert row(of, "Coulomb friction")[:2] == ("+0.0 %", "+0.0 to +1.0 %")


def test_absolute_change_has_the_digits_of_its_smallest_change():
    load = replace(unchanged(LOAD, 0.086), change=-0.00573, low=-0.0228, high=0.0113)
    assert row(comparison(load), "constant load")[:2] == ("-0.006 N.m", "-0.023 to +0.011 N.m")


def test_improvement_states_both_smallest_changes_of_a_day_without_healthy_records():
    """The smallest change of the record itself, 6 %, may apply to a day with healthy records."""
    of = replace(HEALTHY, improvements=(Improvement(FRICTION, 2, 6, 0.14, 0.12),))
    assert improvement_sentences(of) == [
        "6 further healthy records on 2 further days would lower the smallest detectable change "
        "of Coulomb friction from 14 % to 12 % on a day without healthy records."
    ]


@pytest.mark.parametrize(
    ("smallest", "reported"), [(0.054, "5.4 %"), (0.138, "14 %"), (1.2, "120 %")]
)
def test_smallest_change_is_written_without_an_exponent(smallest: float, reported: str):
    assert smallest_text(unchanged(FRICTION, smallest)) == reported


@pytest.mark.parametrize("name", CASES)
def test_every_quantity_has_a_complete_row(name: str):
    table = rows(CASES[name])
    assert len(table) == len(CASES[name].quantities)
    assert all(len(table_row) == len(HEADINGS) for table_row in table)
    assert "nan" not in str(table) + summary(CASES[name])
