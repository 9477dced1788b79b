"""What a watch found gives an estimate in any case, valid or with the reason why not."""

from dataclasses import replace

import numpy as np
import pytest

from ema_monitor.diagnosis import Diagnosis, Search
from ema_monitor.estimate import Settings
from ema_monitor.identification import identify
from ema_monitor.optimizers import ALGORITHMS
from ema_monitor.optimizers.driver import Termination
from ema_monitor.trigger import Refusal
from ema_monitor.watch import Found


@pytest.fixture(scope="module")
def found(windows_of, description) -> Found:
    [window] = windows_of({"friction": 0.3})
    return Found(4, description, window)


def test_window_gives_the_estimate_of_its_identification(found, calibration, description):
    run = Diagnosis(found, calibration, Settings())
    assert run.estimate is None
    generations = [item.generation for item in run]
    expected = identify(found.window, description, calibration)
    assert generations == list(range(1, len(generations) + 1))
    assert run.estimate is not None
    np.testing.assert_array_equal(run.estimate.faults, expected.faults)
    assert run.estimate.evaluations == expected.evaluations


def test_refused_window_keeps_its_reason_and_stamps(calibration, description):
    settings = Settings("pso", seed=3)
    for given, identity in ((calibration, calibration.calibration_id), ("none yet", "")):
        run = Diagnosis(Found(0, description, Refusal(5, 9, "gap of 3 samples")), given, settings)
        assert list(run) == []
        estimate = run.estimate
        assert estimate is not None
        assert (estimate.valid, estimate.reason) == (False, "gap of 3 samples")
        assert (estimate.start_ns, estimate.end_ns) == (5, 9)
        assert (estimate.algorithm, estimate.seed, estimate.evaluations) == ("pso", 3, 0)
        assert estimate.calibration_id == identity
        assert np.isnan(estimate.faults).all()
        assert estimate.unobservable.all()


def test_window_without_calibration_is_refused_with_what_is_missing(found):
    run = Diagnosis(found, "calibration.yaml is missing", Settings())
    assert list(run) == []
    assert run.estimate is not None
    assert (run.estimate.valid, run.estimate.reason) == (False, "calibration.yaml is missing")
    assert run.estimate.excitation == found.window.excitation > 0.0
    assert (run.estimate.start_ns, run.estimate.end_ns) == (
        found.window.start_ns,
        found.window.end_ns,
    )


def test_force_makes_an_estimate_with_a_calibration_of_another_unit(found, calibration):
    other = replace(calibration, serial_number="SIM-0002")
    for force in (False, True):
        run = Diagnosis(found, other, Settings(), force=force)
        for _ in run:
            pass
        assert run.estimate is not None
        assert run.estimate.valid == force
        assert "SIM-0002" in run.estimate.reason


def test_search_gives_the_settings_of_an_identification():
    assert Search().settings() == Settings()
    search = Search("pso", "least_squares", 700, 9)
    assert search.settings() == Settings("pso", "least_squares", Termination(700), 9)


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ({"algorithm": "tea_leaves"}, ["algorithm", "tea_leaves", *ALGORITHMS]),
        ({"fitness": "taste"}, ["fitness", "taste", "total_least_squares", "least_squares"]),
        ({"budget": 0}, ["budget = 0"]),
        ({"budget": 1.5}, ["budget = 1.5", "whole"]),
        ({"seed": -1}, ["seed = -1"]),
    ],
)
def test_impossible_search_is_refused_by_name(values, texts):
    with pytest.raises(ValueError, match="=") as refused:
        Search(**values)
    assert all(text in str(refused.value) for text in texts)
