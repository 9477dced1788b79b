"""Which formula the thesis's printed errors follow."""

import numpy as np
import pytest

from ema_core.faults import estimation_error
from ema_study.error_forms import FORMS, reproduction
from ema_study.printed_runs import printed_runs
from ema_study.record import K

FOLLOWED, PRINTED = FORMS[0], FORMS[1]


def test_each_form_weighs_the_phase_as_it_says():
    # only the phase is off, by 0.5, at an estimated eccentricity of 0.4 and a true one of 0.1
    estimate = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.4, 0.5, 0.5]])
    truth = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.5]])
    weights = {"k6^2": 0.16, "k_true6": 0.1, "k6": 0.4, "k_true6^2": 0.01}
    weights |= {"k6 k_true6": 0.04, "0": 0.0, "1": 1.0}

    assert {form.weight_text for form in FORMS} == weights.keys()
    for form in FORMS:
        expected = 100.0 * np.sqrt(0.09 + weights[form.weight_text] * 0.25)
        assert form.errors(estimate, truth) == pytest.approx(expected)


def test_our_errors_have_the_form_that_is_followed():
    runs = printed_runs()
    estimates = runs[K].to_numpy(dtype=float)
    truths = runs[[f"true_{k}" for k in K]].to_numpy(dtype=float)
    ours = [estimation_error(*pair) for pair in zip(estimates, truths, strict=True)]
    not_wrapped = np.abs(estimates[:, 6] - truths[:, 6]) <= 0.5

    errors = FOLLOWED.errors(estimates, truths)
    np.testing.assert_allclose(errors[not_wrapped], np.array(ours)[not_wrapped], rtol=1e-12)
    assert np.sum(not_wrapped) > 400


def test_all_printed_errors_follow_the_square_of_the_estimated_eccentricity():
    row = reproduction().to_dict("index")[FOLLOWED.name]

    assert row["runs"] == 500
    assert row["reproduced with 0.7474"] == 500
    assert row["reproduced with 74/99"] == 498
    assert row["reproduced with 0.747"] == 470
    # Two half digits, of the error and of the estimate, explain it.
    assert row["largest deviation with 0.7474 [%]"] < 0.015


def test_no_other_form_reproduces_the_printed_errors():
    table = reproduction()
    others = table.drop(index=FOLLOWED.name)

    assert others["reproduced with 0.7474"].max() < 400
    assert others["largest deviation with 0.7474 [%]"].min() > 0.5
    assert table.loc[PRINTED.name, "reproduced with 0.7474"] == 292


def test_rounding_does_not_hide_a_wrong_error():
    runs = printed_runs()
    runs.loc[runs["table"] == 12, "error_percent"] += 0.03

    row = reproduction(runs).to_dict("index")[FOLLOWED.name]

    assert row["reproduced with 0.7474"] == 490


def test_no_runs_reproduce_nothing():
    table = reproduction(printed_runs().iloc[:0])

    assert set(table["runs"]) == {0}
    assert set(table["reproduced with 0.747"]) == {0}
