"""A window or its refusal gives an estimate in any case, valid or with the reason why not."""

from dataclasses import replace

import numpy as np
import pytest

from ema_monitor.calibration.calibration import Calibration
from ema_monitor.diagnosis import Diagnosed, Diagnosis, Identification, identify
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.optimizers import ALGORITHMS
from ema_monitor.optimizers.driver import Termination
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Refusal


@pytest.fixture(scope="module")
def found(windows_of, description) -> Segment:
    [window] = windows_of({"friction": 0.3})
    return Segment(4, description, window)


def test_refused_window_keeps_its_reason_and_stamps(calibration, description):
    search = SearchSettings("pso", seed=3)
    for given, identity in ((calibration, calibration.calibration_id), ("none yet", "")):
        run = Identification(Refusal(5, 9, "gap of 3 samples"), description, given, search)
        assert list(run) == []
        estimate = run.estimate
        assert estimate is not None
        assert (estimate.valid, estimate.reason) == (False, "gap of 3 samples")
        assert (estimate.start_ns, estimate.end_ns) == (5, 9)
        assert (estimate.algorithm, estimate.seed, estimate.evaluations) == ("pso", 3, 0)
        assert estimate.calibration_id == identity
        assert estimate.calibration_windows == (calibration.windows if identity else 0)
        assert not estimate.warm_start
        assert np.isnan(estimate.faults).all()
        assert estimate.unobservable.all()


def test_window_without_calibration_is_refused_with_what_is_missing(found):
    missing = "calibration.yaml is missing"
    run = Identification(found.window, found.description, missing, SearchSettings())
    assert list(run) == []
    assert run.estimate is not None
    assert (run.estimate.valid, run.estimate.reason) == (False, "calibration.yaml is missing")
    assert run.estimate.excitation == found.window.excitation > 0.0
    assert (run.estimate.start_ns, run.estimate.end_ns) == (
        found.window.start_ns,
        found.window.end_ns,
    )


def test_budget_ends_the_search_unless_there_is_another_rule():
    assert SearchSettings(budget=700).termination == Termination(700)
    rule = Termination(5, tolerance=0.0)
    assert SearchSettings(budget=700, stop_rule=rule).termination is rule


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ({"algorithm": "tea_leaves"}, ["algorithm", "tea_leaves", *ALGORITHMS]),
        ({"fitness": "taste"}, ["fitness", "taste", "total_least_squares", "least_squares"]),
        ({"budget": 0}, ["budget = 0"]),
        ({"budget": 1.5}, ["budget = 1.5", "whole"]),
        ({"goodness_limit": 0.0}, ["goodness_limit = 0"]),
        ({"seed": -1}, ["seed = -1"]),
        ({"warm_start": 1}, ["warm_start = 1", "true or false"]),
    ],
)
def test_impossible_search_is_refused_by_name(values, texts):
    with pytest.raises(ValueError, match="=") as refused:
        SearchSettings(**values)
    assert all(text in str(refused.value) for text in texts)


def identified(
    found: Segment, calibration: Calibration | str, diagnosis: Diagnosis, **values
) -> Estimate:
    *_, last = diagnosis.add(found, calibration, SearchSettings(**values))
    assert isinstance(last, Diagnosed)
    return last.estimate


def test_search_begins_at_the_last_valid_estimate(windows_of, calibration, description):
    first, second = windows_of({"friction": 0.3, "eccentricity": 0.2}, 2)
    last = Diagnosis()
    cold = identified(Segment(0, description, first), calibration, last)
    warm = identified(Segment(1, description, second), calibration, last)
    assert (cold.warm_start, warm.warm_start) == (False, True)
    expected = identify(second, description, calibration, previous=cold.faults)
    np.testing.assert_array_equal(warm.faults, expected.faults)
    assert warm.evaluations == expected.evaluations < cold.evaluations


def test_windows_without_valid_estimate_leave_the_start_as_it_is(
    windows_of, calibration, description
):
    first, second = windows_of({"friction": 0.3}, 2)
    refusals = [Segment(1, description, Refusal(5, 9, reason)) for reason in ("gap", "dropped")]
    estimates = []
    for between in ([], refusals):
        last = Diagnosis()
        identified(Segment(0, description, first), calibration, last)
        for item in between:
            identified(item, calibration, last)
        identified(Segment(2, description, first), "there is no calibration", last)
        estimates.append(identified(Segment(3, description, second), calibration, last))
    undisturbed, disturbed = estimates
    assert undisturbed.warm_start
    assert disturbed.evaluations == undisturbed.evaluations
    np.testing.assert_array_equal(disturbed.faults, undisturbed.faults)


def test_search_begins_anew_with_another_description_or_calibration(
    windows_of, calibration, description
):
    [window] = windows_of({"friction": 0.3})
    for described, calibrated in (
        (replace(description, model="another"), calibration),
        (description, replace(calibration, windows=calibration.windows + 1)),
    ):
        last = Diagnosis()
        identified(Segment(0, description, window), calibration, last)
        assert identified(Segment(1, description, window), calibration, last).warm_start
        other = identified(Segment(2, described, window), calibrated, last)
        assert not other.warm_start
