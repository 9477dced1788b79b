"""The course of an identification: progress, evaluations, budget, and where it begins."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.faults import ECCENTRICITY_PHASE, estimation_error, fault_vector
from ema_monitor.diagnosis import Identification, identify
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.model.monitor_model import MonitorModel

from .reference_cases import CASES

ALL_BUT_PHASE = np.arange(8) != ECCENTRICITY_PHASE


@pytest.fixture
def counted(monkeypatch):
    """How many windows the model has computed."""
    counts = []
    respond = MonitorModel.respond

    def counting(model, window, faults, *others):
        counts.append(len(np.atleast_2d(faults)))
        return respond(model, window, faults, *others)

    monkeypatch.setattr(MonitorModel, "respond", counting)
    return counts


@pytest.mark.parametrize("algorithm", ["least_squares", "pso"])
def test_progress_falls_to_the_estimate(windows_of, calibration, description, algorithm):
    """Where nothing is put back to healthy."""
    [window] = windows_of(CASES["gain high"])
    settings = SearchSettings(algorithm, budget=1000, parsimonious=False)
    identification = Identification(window, description, calibration, settings)
    assert identification.estimate is None
    generations = list(identification)
    assert [g.generation for g in generations] == list(range(1, len(generations) + 1))
    assert np.all(np.diff([g.evaluations for g in generations]) > 0)
    assert np.all(np.diff([g.fitness for g in generations]) <= 0.0)
    for generation in generations:
        assert np.array_equal(fault_vector(generation.faults), generation.faults)
    estimate = identification.estimate
    assert estimate is not None
    # To the point of the plane of eccentricity and back: rounding.
    assert estimate.fitness == pytest.approx(generations[-1].fitness, rel=1e-6)
    # The point, two difference windows for each component, what the estimate leaves there and at
    # the healthy point, what six deviations of the unit do at both, and its lift.
    left = 1 + 2 * 8 + 2 + 2 * (1 + 6) + 1
    assert estimate.evaluations == generations[-1].evaluations + left
    known = ~estimate.unobservable
    assert np.array(estimate.faults)[known] == pytest.approx(
        generations[-1].faults[known], abs=1e-12
    )


@pytest.mark.parametrize("parsimonious", [True, False])
@pytest.mark.parametrize("algorithm", ["least_squares", "pso"])
@pytest.mark.parametrize("case", ["healthy", "wide"])
def test_reported_evaluations_are_those_made(
    windows_of, calibration, description, counted, case, algorithm, parsimonious
):
    [window] = windows_of(CASES[case])
    settings = SearchSettings(algorithm, budget=500, parsimonious=parsimonious)
    estimate = identify(window, description, calibration, settings)
    assert estimate.evaluations == sum(counted) <= 500


@pytest.mark.slow
@pytest.mark.parametrize("known", [True, False])
def test_no_budget_is_passed(windows_of, calibration, description, counted, known):
    """Be it spent to the last evaluation, with what putting back to healthy takes."""
    [window] = windows_of(CASES["friction low"])
    window = window if known else replace(window, play=None)
    whole = Identification(window, description, calibration, SearchSettings())
    done = [generation.evaluations for generation in whole]
    # Three linearisations with the causes, the unit's deviations, and some to spare.
    for evaluations in done[1:4]:
        for budget in range(evaluations + 145, evaluations + 157, 4):
            counted.clear()
            settings = SearchSettings(budget=budget)
            estimate = identify(window, description, calibration, settings)
            assert estimate.evaluations == sum(counted) <= budget


def test_cancelled_identification_has_no_estimate(windows_of, calibration, description):
    [window] = windows_of(CASES["gain high"])
    identification = Identification(window, description, calibration, SearchSettings())
    for generation in identification:
        assert np.all(np.isfinite(generation.faults))
        break
    assert identification.estimate is None


# Evaluations of the search alone. A healthy window begins at its optimum either way.
@pytest.mark.parametrize(
    ("case", "share"),
    [("healthy", 3.0), ("friction low", 0.8), ("short circuit high", 0.6), ("multiple", 0.6)],
)
def test_faults_of_the_window_before_save_evaluations_and_change_nothing_else(
    stirred_window, calibration, description, case, share
):
    window, truth = stirred_window(CASES[case], 3), fault_vector(CASES[case])
    near = np.clip(truth + 0.01 * np.random.default_rng(1).normal(size=8), 0.0, 0.98)
    searches = [
        Identification(window, description, calibration, SearchSettings(), previous=previous)
        for previous in (None, near)
    ]
    of_cold, of_warm = ([generation.evaluations for generation in one][-1] for one in searches)
    cold, warm = (one.estimate for one in searches)
    assert cold is not None
    assert warm is not None
    # At the limit of what is put back to zero, an eccentricity of 0.004 may go or stay.
    found, expected = (np.array(one.faults)[ALL_BUT_PHASE] for one in (warm, cold))
    assert found == pytest.approx(expected, abs=6e-3)
    assert warm.fitness == pytest.approx(cold.fitness, rel=0.02)
    assert of_warm < share * of_cold
    assert warm.valid


@pytest.mark.slow
@pytest.mark.parametrize("case", ["friction high", "eccentricity low", "wide"])
@pytest.mark.parametrize("seed", [0, 1])
def test_unrelated_faults_of_the_window_before_do_no_harm(
    stirred_window, calibration, description, case, seed
):
    """They cost a descent, or a screen where that ends in a poor optimum."""
    window, truth = stirred_window(CASES[case], 3), fault_vector(CASES[case])
    cold = identify(window, description, calibration)
    previous = 0.9 * np.random.default_rng(seed).random(8)
    astray = identify(window, description, calibration, previous=previous)
    assert estimation_error(astray.faults, truth) < estimation_error(cold.faults, truth) + 0.3
    assert astray.fitness < 1.05 * cold.fitness


def test_previous_estimate_that_is_no_fault_vector_is_refused(windows_of, calibration, description):
    [window] = windows_of(CASES["friction low"])
    for previous in (np.full(8, np.nan), np.full(8, 1.5), np.zeros(7)):
        with pytest.raises(ValueError, match=r"fault|expected"):
            identify(window, description, calibration, previous=previous)
