# SPDX-License-Identifier: Apache-2.0
"""The course of an identification: progress, evaluations, budget, and start."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_core.faults import ECCENTRICITY_PHASE, estimation_error, fault_vector
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.diagnosis import Diagnosed, Diagnosis, Identification, identify
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.optimizers import ALGORITHMS
from ema_monitor.optimizers.particle_swarm import ParticleSwarm
from ema_monitor.reasons import NoCalibration, StatedReason
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

from .reference_cases import CASES


@pytest.mark.parametrize("algorithm", ["least_squares", "pso"])
def test_progress_decreases_to_the_estimate(windows_of, calibration, description, algorithm):
    [window] = windows_of(CASES["gain high"])
    settings = SearchSettings(algorithm, budget=1000)
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
    assert estimate.evaluations > generations[-1].evaluations


@pytest.mark.parametrize("algorithm", ["least_squares", "pso"])
def test_reported_evaluations_equal_the_actual_ones(
    windows_of, calibration, description, counted, algorithm
):
    [window] = windows_of(CASES["wide"])
    settings = SearchSettings(algorithm, budget=500)
    estimate = identify(window, description, calibration, settings)
    assert estimate.evaluations == sum(counted) <= 500


@pytest.mark.slow
@pytest.mark.parametrize("is_play_known", [True, False])
def test_budget_is_never_exceeded(windows_of, calibration, description, counted, is_play_known):
    """The budget includes the evaluations for setting components to healthy."""
    [window] = windows_of(CASES["friction low"])
    window = window if is_play_known else replace(window, play=None)
    whole = Identification(window, description, calibration, SearchSettings())
    done = [generation.evaluations for generation in whole]
    # Three linearisations with the causes, the unit's deviations, and a reserve.
    for budget in range(done[2] + 145, done[2] + 157, 4):
        counted.clear()
        estimate = identify(window, description, calibration, SearchSettings(budget=budget))
        assert estimate.evaluations == sum(counted) <= budget


def test_optimizer_receives_a_good_cost_and_the_budget_less_the_evaluations_of_the_estimate(
    windows_of, calibration, description, monkeypatch
):
    every_hints = []

    class Listening(ParticleSwarm):
        def __init__(self, start, rng, hints):
            every_hints.append(hints)
            super().__init__(start, rng, hints)

    monkeypatch.setitem(ALGORITHMS, "pso", Listening)
    [window] = windows_of(CASES["friction low"])
    settings = SearchSettings("pso", budget=400)
    next(iter(Identification(window, description, calibration, settings)))
    [hints] = every_hints
    # The cost of the healthy point; three linearisations in eight faults and seven causes that
    # change the motion; two points; six deviations of the unit there and at the healthy point.
    assert hints.budget == 400 - (1 + 3 * 35 + 2 + 2 * (1 + 6))
    assert hints.good_cost > 0.0


def test_cancelled_identification_has_no_estimate(windows_of, calibration, description):
    [window] = windows_of(CASES["gain high"])
    identification = Identification(window, description, calibration, SearchSettings())
    for generation in identification:
        assert np.all(np.isfinite(generation.faults))
        break
    assert identification.estimate is None


# Evaluations of the search alone. A healthy window ends at once if the search begins healthy.
@pytest.mark.parametrize(
    ("case", "share"), [("healthy", 4.0), ("short circuit high", 0.6), ("multiple", 0.7)]
)
def test_faults_of_the_previous_window_save_evaluations_and_change_nothing_else(
    stirred_window, calibration, description, case, share
):
    window, truth = stirred_window(CASES[case], 3), fault_vector(CASES[case])
    near = np.clip(truth + 0.01 * np.random.default_rng(1).normal(size=8), 0.0, 0.98)
    evaluations, estimates = [], []
    for previous in (None, near):
        search = Identification(
            window, description, calibration, SearchSettings(), previous=previous
        )
        evaluations.append([generation.evaluations for generation in search][-1])
        estimates.append(search.estimate)
    cold, warm = estimates
    assert cold is not None
    assert warm is not None
    # An eccentricity of 0.004 is at the limit of significance: it may be 0.
    actual, expected = (np.delete(estimate.faults, ECCENTRICITY_PHASE) for estimate in (warm, cold))
    assert actual == pytest.approx(expected, abs=6e-3)
    assert warm.fitness == pytest.approx(cold.fitness, rel=0.02)
    assert evaluations[1] < share * evaluations[0]
    assert warm.valid


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "seed"), [("friction high", 0), ("eccentricity low", 1), ("wide", 0)]
)
def test_unrelated_faults_of_the_previous_window_do_no_harm(
    stirred_window, stirred_estimates, calibration, description, case, seed
):
    """They cost a descent, or a screen if the descent ends in a poor optimum."""
    cold, truth = stirred_estimates(case), fault_vector(CASES[case])
    previous = 0.9 * np.random.default_rng(seed).random(8)
    window = stirred_window(CASES[case], 3)
    astray = identify(window, description, calibration, previous=previous)
    assert estimation_error(astray.faults, truth) < estimation_error(cold.faults, truth) + 0.3
    assert astray.fitness < 1.05 * cold.fitness


def test_invalid_previous_estimate_is_refused(windows_of, calibration, description):
    [window] = windows_of(CASES["friction low"])
    for previous in (np.full(8, np.nan), np.full(8, 1.5), np.zeros(7)):
        with pytest.raises(ValueError, match=r"fault|expected"):
            identify(window, description, calibration, previous=previous)


def test_refused_window_keeps_its_reason_and_stamps(calibration, description):
    search = SearchSettings("pso", seed=3)
    for item, identity in (
        (calibration, calibration.calibration_id),
        (NoCalibration("c.yaml"), ""),
    ):
        estimate = identify(
            Refusal(5, 9, StatedReason("gap of 3 samples")), description, item, search
        )
        assert (estimate.valid, estimate.reason) == (False, "gap of 3 samples")
        assert (estimate.start_ns, estimate.end_ns) == (5, 9)
        assert (estimate.algorithm, estimate.seed, estimate.evaluations) == ("pso", 3, 0)
        assert estimate.calibration_id == identity
        assert estimate.calibration_windows == (calibration.windows if identity else 0)
        assert not estimate.warm_start
        assert np.isnan(estimate.faults).all()
        assert estimate.unobservable.all()


def test_window_without_calibration_is_refused_with_the_missing_part(healthy_windows, description):
    window, missing = healthy_windows[0], NoCalibration("calibration.yaml")
    estimate = identify(window, description, missing)
    assert (estimate.valid, estimate.reasons) == (False, (missing,))
    assert "calibration.yaml is missing" in estimate.reason
    assert estimate.excitation == window.excitation > 0.0
    assert (estimate.start_ns, estimate.end_ns) == (window.start_ns, window.end_ns)


def test_search_begins_at_the_last_valid_estimate_of_the_same_unit_and_calibration(
    windows_of, calibration, description
):
    [window] = windows_of(CASES["friction low"])
    diagnosis = Diagnosis()

    def identified(
        item: Window | Refusal = window,
        described: ActuatorDescription = description,
        by: Calibration | NoCalibration = calibration,
    ) -> Estimate:
        *_, last = diagnosis.add(Segment(0, described, item), by, SearchSettings())
        assert isinstance(last, Diagnosed)
        return last.estimate

    cold, warm = identified(), identified()
    assert (cold.warm_start, warm.warm_start) == (False, True)
    assert warm.evaluations < cold.evaluations
    # A refused window changes nothing.
    for item, by in (
        (Refusal(5, 9, StatedReason("gap")), calibration),
        (window, NoCalibration("c.yaml")),
    ):
        assert not identified(item, by=by).valid
    expected = identify(window, description, calibration, previous=warm.faults)
    np.testing.assert_array_equal(identified().faults, expected.faults)
    assert not identified(described=replace(description, model="another")).warm_start
    assert not identified(by=replace(calibration, windows=calibration.windows + 1)).warm_start
