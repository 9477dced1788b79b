# SPDX-License-Identifier: Apache-2.0
"""Combining stretches of ordinary motion is equivalent to fitting all stretches together."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from ema_core.faults import ECCENTRICITY_PHASE, FAULT_NAMES, N_FAULTS, fault_vector
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.diagnosis import Diagnosed, Diagnosis
from ema_monitor.identification.combination import Combination
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.knowledge import NUISANCE, Knowledge, information
from ema_monitor.identification.objective import PLAIN, Objective
from ema_monitor.identification.preview import StretchMotion
from ema_monitor.identification.search import Generation, ModelIdentification
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings, Tally
from ema_monitor.identification.uncertainty import shifts_of
from ema_monitor.model.deviations import Prior
from ema_monitor.model.measured import expected_causes
from ema_monitor.reasons import QueueFull, StatedReason
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator

from .motion import FLAP, H, moved, moves, stretches_of

FAULTS = {"friction": 0.2, "short_circuit_b": 0.1}


@pytest.fixture(scope="module")
def stretches() -> list[Window]:
    return stretches_of(moved(moves(6.0), **FAULTS))


def added(combination: Combination, stretch: Window | Refusal) -> list[Estimate]:
    """Return the estimates that a stretch completes."""
    return [state for state in combination.add(stretch) if isinstance(state, Estimate)]


def combined(
    stretches: Sequence[Window | Refusal], settings: CombinationSettings | None = None
) -> tuple[list[Estimate], Combination]:
    combination = Combination(FLAP, Calibration.builtin(), settings=settings)
    estimates = [estimate for stretch in stretches for estimate in added(combination, stretch)]
    return estimates, combination


def earlier(stretch: Window, by_ns: int) -> Window:
    telemetry = replace(stretch.telemetry, stamp_ns=stretch.start_ns - by_ns)
    return Window(telemetry, stretch.play)


def knowledge_of(objective: Objective, point: NDArray[np.float64]) -> Knowledge:
    """Return the knowledge from a single stretch with the noise of a healthy window."""
    at = objective.linearise(point)
    covariance = np.array(np.linalg.inv(information(at.jacobian, objective.noise)), dtype=float)
    return Knowledge(point[:N_FAULTS], (covariance + covariance.T) / 2.0)


def load_of(stretch: Window) -> tuple[Prior, ...]:
    suspects = expected_causes(FLAP.parameters, stretch)
    return tuple(cause for cause in suspects if cause.name == NUISANCE)


@pytest.fixture(scope="module")
def objectives(stretches) -> list[Objective]:
    calibration = Calibration.builtin().of_any_motion()
    return [Objective(stretch, calibration, causes=load_of(stretch)) for stretch in stretches[:2]]


@pytest.fixture(scope="module")
def point(objectives) -> NDArray[np.float64]:
    point = objectives[0].encode(fault_vector(FAULTS))
    [load] = objectives[0].hidden_causes
    point[-1] = 0.5 + 0.3 / load.reach / 2.0
    return point


@pytest.fixture(scope="module")
def knowledge(objectives, point) -> Knowledge:
    return knowledge_of(objectives[0], point)


@pytest.fixture(scope="module")
def second(stretches, objectives, knowledge) -> Objective:
    """Return the objective of the second stretch, with the knowledge from the first."""
    calibration = Calibration.builtin().of_any_motion()
    causes = objectives[1].hidden_causes
    return Objective(stretches[1], calibration, causes=causes, knowledge=knowledge)


def test_residuals_include_the_stretch_and_the_prior_knowledge(
    objectives, second, knowledge, point
):
    trial = point + 0.01
    [alone], [both] = objectives[1].residuals(trial[None]), second.residuals(trial[None])
    away = (trial - point)[:N_FAULTS]
    distance = away @ np.linalg.solve(knowledge.covariance, away)
    # Eigenvalues of the covariance span six decades.
    assert both @ both - alone @ alone == pytest.approx(second.noise * distance, rel=1e-6)
    assert len(both) == len(alone) + N_FAULTS


def test_information_of_two_stretches_equals_that_of_a_joint_fit(objectives, second, point):
    """The first stretch enters as a Gaussian; each stretch has its own fitted load."""
    normals = [
        information(objective.linearise(point).jacobian, objective.noise)
        for objective in objectives
    ]
    stacked = normals[0] + normals[1]
    sequential = information(second.linearise(point).jacobian, second.noise)
    scale = np.sqrt(np.outer(np.diag(stacked), np.diag(stacked)))
    np.testing.assert_allclose(sequential / scale, stacked / scale, rtol=0, atol=1e-6)


def test_uncertain_deviations_of_the_unit_do_not_average_out(stretches):
    """Repeating a stretch reduces the noise, but not the shift due to the unit's deviations."""
    calibration = Calibration.builtin().of_any_motion()
    stretch = stretches[0]
    causes = load_of(stretch)
    alone = Objective(stretch, calibration, causes=causes)
    point = alone.encode(fault_vector(FAULTS))
    at = alone.linearise(point)
    shifts = -shifts_of(at.jacobian, alone.unit_effects(point))[:N_FAULTS]
    knowledge = knowledge_of(alone, point)._replace(shifts=shifts)
    again = Objective(stretch, calibration, causes=causes, knowledge=knowledge)
    both = again.linearise(point)
    combined_shifts = -shifts_of(both.jacobian, again.unit_effects(point))[:N_FAULTS]
    # The ridge of the normal matrix affects directions with little information.
    np.testing.assert_allclose(combined_shifts, shifts, rtol=1e-2, atol=1e-6)


@pytest.mark.slow
def test_estimate_of_stretches_is_right_and_names_its_stretches(stretches):
    settings = CombinationSettings(wanted_sigma=0.02, pause_s=0.0)
    estimates, combination = combined(stretches, settings)
    assert len(estimates) >= 2
    truth = fault_vector(FAULTS)
    for estimate in estimates:
        assert estimate.valid
        assert 1 <= estimate.stretches <= len(stretches)
        assert (estimate.end_ns - estimate.start_ns) * 1e-9 >= 0.5 * estimate.stretches - 1e-6
        assert estimate.calibration_id == Calibration.builtin().calibration_id
        for i, name in enumerate(FAULT_NAMES):
            if i == ECCENTRICITY_PHASE:
                continue
            assert not estimate.unobservable[i], name
            # All stretches reached the wanted sigma of 0.02; errors of three sigma are rare.
            assert abs(estimate.faults[i] - truth[i]) <= 3.0 * max(estimate.sigma[i], 2e-3), name
        [load] = [cause for cause in estimate.causes if cause.name == "load_torque"]
        assert load.value == pytest.approx(0.3, abs=4.0 * load.sigma)
    # Each begins where the previous one ended.
    for before, after in pairwise(estimates):
        assert after.start_ns >= before.end_ns
    tally = combination.tally
    assert tally.stretches == len(stretches) == tally.combined + tally.skipped
    assert tally.refused == 0


@pytest.mark.slow
def test_repeated_motion_adds_no_information():
    """In a sine, each stretch repeats the first one, with the same model errors."""
    t = H * np.arange(1, 40_001)
    again = stretches_of(moved(0.006 * np.sin(2.0 * np.pi * 2.0 * t), **FAULTS))
    estimates, combination = combined(again)
    assert estimates == []
    assert combination.tally.combined <= 2
    assert combination.tally.skipped >= len(again) - 2
    [estimate] = combination.finish()
    # A single frequency does not separate shorts of all phases from a changed torque constant.
    assert any(estimate.unobservable[2:5])
    assert "the motion does not show" in estimate.reason


@pytest.mark.slow
def test_motion_that_does_not_reach_the_wanted_sigma_gives_no_estimate(stretches):
    estimates, combination = combined(stretches[:2], CombinationSettings(wanted_sigma=2e-4))
    assert estimates == combination.finish() == []
    assert combination.tally.fruitless == 1


def test_motions_with_another_load_or_at_another_position_are_not_repetitions(stretches):
    first, second = (StretchMotion.of(stretch, 0.1) for stretch in stretches[:2])
    assert first.repeats(first)
    assert not first.repeats(first._replace(load=0.2))
    assert not first.repeats(second)


@pytest.mark.slow
def test_fault_that_jumps_begins_a_new_combination():
    """The stretches before the jump give an estimate; the new combination ignores them."""
    actuator = SimulatedActuator()
    before = stretches_of(actuator.advance(moves(1.2, seed=5)))
    actuator.faults = fault_vector({"backlash": 0.3, "gain": 0.4})
    after = stretches_of(actuator.advance(moves(3.0, seed=6)))
    settings = CombinationSettings(wanted_sigma=6e-3, pause_s=0.0)
    estimates, combination = combined([*before, *after], settings)
    estimates += combination.finish()
    assert "does not agree" in estimates[0].reason
    assert estimates[0].stretches <= len(before)
    assert estimates[0].end_ns < after[0].end_ns <= estimates[1].start_ns + 500_000_000
    # The true difference is some tenths of a per cent; the jumps are far larger.
    assert estimates[0].faults.gain == pytest.approx(0.5, abs=0.02)
    assert estimates[1].faults.gain == pytest.approx(0.4, abs=0.02)
    assert estimates[1].faults.backlash == pytest.approx(0.3, abs=0.02)


@pytest.mark.slow
def test_motion_soon_after_an_estimate_is_ignored(stretches):
    settings = CombinationSettings(wanted_sigma=0.02, pause_s=60.0)
    estimates, combination = combined(stretches, settings)
    [estimate] = estimates
    later = [stretch for stretch in stretches if stretch.start_ns >= estimate.end_ns]
    assert later
    assert combination.tally.skipped >= len(later)
    assert combination.finish() == []


@pytest.mark.slow
def test_jam_is_reported_once_and_does_not_count_against_the_limit(stretches):
    """Every stretch is refused; the third in a row is reported, later ones are counted."""
    actuator = SimulatedActuator()
    actuator.causes = {"jam": 1.0}
    refused = stretches_of(actuator.advance(moves(6.0)))
    assert len(refused) > 3
    settings = CombinationSettings(wanted_sigma=5e-3, most_stretches=3)
    estimates, combination = combined(refused, settings)
    [estimate] = estimates
    assert not estimate.valid
    assert "jam" in estimate.reason
    assert "jam" in combination.tally.reason
    assert combination.finish() == []
    for stretch in stretches[:3]:
        assert added(combination, earlier(stretch, -refused[-1].start_ns)) == []
    assert (combination.tally.refused, combination.tally.combined) == (len(refused), 3)
    assert [estimate.stretches for estimate in combination.finish()] == [3]


def test_unusable_or_late_stretch_is_only_counted():
    estimates, combination = combined([Refusal(5, 9, StatedReason("a gap"))] * 4)
    assert estimates == []
    assert combination.tally == Tally(stretches=4, refused=4, reasons=(StatedReason("a gap"),))
    full = QueueFull(2, is_stretch=True)
    _, combination = combined([Refusal(5, 9, full, is_dropped=True)])
    assert combination.tally == Tally(stretches=1, dropped=1, reasons=(full,))
    assert "1 dropped (the latest: dropped: more than 2 stretches waited for" in str(
        combination.tally
    )


@pytest.mark.slow
def test_abandoned_stretch_leaves_the_combined_stretches_unchanged(stretches):
    combination = Combination(FLAP, Calibration.builtin())
    assert added(combination, stretches[0]) == []
    assert isinstance(next(combination.add(stretches[1])), Generation)
    [estimate] = combination.finish()
    assert (estimate.start_ns, estimate.end_ns) == (stretches[0].start_ns, stretches[0].end_ns)


def test_distance_without_a_noise_is_refused():
    with pytest.raises(ValueError, match=r"least_squares.*only"):
        Combination(FLAP, Calibration.builtin(), SearchSettings(fitness="least_squares"))


@pytest.mark.slow
def test_another_calibration_begins_a_new_combination(stretches):
    """The stretches combined so far are returned with their actuator."""
    diagnosis, of = Diagnosis(), (Calibration.builtin(), SearchSettings())
    stretch = Segment(7, FLAP, stretches[0], is_stretch=True)
    begun = diagnosis.add(stretch, *of, CombinationSettings(wanted_sigma=6e-3))
    assert all(isinstance(state, Generation) for state in begun)
    dropped = Segment(8, FLAP, Refusal(1, 2, StatedReason("dropped")), is_stretch=True)
    [ended] = diagnosis.add(dropped, *of, CombinationSettings(wanted_sigma=0.02))
    assert isinstance(ended, Diagnosed)
    assert (ended.number, ended.last, ended.description) == (0, 8, FLAP)
    assert ended.estimate.stretches == 1
    assert diagnosis.tally.stretches == 1
    assert diagnosis.finish() == []


@pytest.mark.slow
def test_clock_that_goes_back_ends_the_combination_and_the_pause(stretches):
    """The stamps go back by an hour, as if a bag is played again.

    An estimate from stretches before and after the step would end before it starts.
    """
    hour_ns = 3_600_000_000_000
    again = [earlier(stretch, hour_ns) for stretch in stretches[:3]]
    settings = CombinationSettings(wanted_sigma=0.02)
    estimates, combination = combined([*stretches[:1], *again], settings)
    estimates += combination.finish()
    assert estimates[0].stretches == 1
    assert len(estimates) >= 2
    assert all(estimate.start_ns < estimate.end_ns for estimate in estimates)


def test_population_searches_in_the_coordinates_of_the_prior_knowledge(stretches):
    """A search that begins at the expected faults has zero residuals of the prior knowledge."""
    faults = fault_vector(FAULTS | {"eccentricity": 0.15, "eccentricity_phase": 0.9})
    calibration = Calibration.builtin().of_any_motion()
    before = Knowledge.of_range(PLAIN.encode(faults))
    knowledge = before._replace(covariance=1e-4 * np.eye(N_FAULTS))
    alone = Objective(stretches[0], calibration, causes=load_of(stretches[0]))
    [at_start] = alone.residuals(alone.encode(faults)[None])
    run = ModelIdentification(
        stretches[0],
        FLAP,
        calibration,
        SearchSettings(algorithm="pso"),
        previous=faults,
        knowledge=knowledge,
    )
    assert next(run.run()).fitness <= at_start @ at_start * (1.0 + 1e-9)
