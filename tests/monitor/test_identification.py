"""Identification end to end: telemetry of the simulated actuator in, its faults out."""

from dataclasses import fields, replace

import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_core.faults import (
    ECCENTRICITY,
    ECCENTRICITY_PHASE,
    FAULT_NAMES,
    degrade,
    estimation_error,
    fault_vector,
)
from ema_core.parameters import constants
from ema_monitor.healthy_fit import calibrate
from ema_monitor.estimate import Estimate, Settings
from ema_monitor.fitness import WEIGHTS
from ema_monitor.identification import Identification, identify
from ema_monitor.optimizers.driver import Termination
from ema_monitor.trigger import WindowTrigger
from ema_monitor.uncertainty import MISMATCH_SIGMA, sandwich_covariance
from ema_monitor.window import Window
from ema_sim.actuator import SimulatedActuator, at_rest

# The thesis's ten single faults (its tables 11 to 54) and its multiple one (table 56).
SINGLE = {
    "friction low": {"friction": 0.25},
    "friction high": {"friction": 0.75},
    "backlash low": {"backlash": 9 / 99},
    "backlash high": {"backlash": 74 / 99},
    "short circuit low": {"short_circuit_a": 0.2},
    "short circuit high": {"short_circuit_a": 0.7},
    "eccentricity low": {"eccentricity": 0.25},
    "eccentricity high": {"eccentricity": 0.75},
    "gain low": {"gain": 0.25},
    "gain high": {"gain": 0.75},
}
MULTIPLE = dict(
    zip(FAULT_NAMES, (0.0068, 0, 9.19e-3, 0.0013, 8.6e-4, 0.0111, 0.627, 0.38038), strict=True)
)
CASES = {"healthy": {}, **SINGLE, "multiple": MULTIPLE}
# Percent. Measured: 0.1 to 0.8; the thesis has 0.2 to 13.
LIMIT = 1.5


@pytest.fixture(scope="module")
def estimates(windows_of, calibration, description):
    """Estimate of each case by the default algorithm; each is made once."""
    made: dict[str, Estimate] = {}

    def estimate(case: str) -> Estimate:
        if case not in made:
            # A healthy window that the calibration has not seen.
            window = windows_of(CASES[case], 1 if CASES[case] else 7)[-1]
            made[case] = identify(window, description, calibration)
        return made[case]

    return estimate


def same(a: Estimate, b: Estimate) -> bool:
    """Whether two estimates agree to the last bit, but for the time that they took."""
    return all(
        np.array_equal(getattr(a, f.name), getattr(b, f.name), equal_nan=f.name != "unobservable")
        if isinstance(getattr(a, f.name), np.ndarray)
        else getattr(a, f.name) == getattr(b, f.name)
        for f in fields(Estimate)
        if f.name != "computing_time_s"
    )


@pytest.mark.parametrize("case", CASES)
def test_faults_are_found(estimates, case):
    estimate, truth = estimates(case), fault_vector(CASES[case])
    assert estimate.valid
    assert estimate.reason == ""
    assert estimation_error(estimate.faults, truth) < LIMIT
    assert np.array_equal(fault_vector(estimate.faults), estimate.faults)
    assert estimate.play == 1.0


@pytest.mark.parametrize("case", CASES)
def test_faults_are_as_far_off_as_their_sigma_says(estimates, case):
    """Short circuits of 0.7 and more are the worst, at 2 sigma."""
    estimate, truth = estimates(case), fault_vector(CASES[case])
    known = ~estimate.unobservable
    assert np.all(np.abs(estimate.faults - truth)[known] < 3.5 * estimate.sigma[known])
    assert np.all(estimate.sigma[known] < 0.01)


# Not the multiple case: its eccentricity of 0.0111 is at the limit of what is told from nothing.
@pytest.mark.parametrize("case", ["healthy", *SINGLE])
def test_only_the_phase_of_no_eccentricity_is_unobservable(estimates, case):
    estimate = estimates(case)
    expected = np.zeros(8, dtype=bool)
    expected[ECCENTRICITY_PHASE] = "eccentricity" not in case
    assert np.array_equal(estimate.unobservable, expected)
    assert np.array_equal(np.isnan(estimate.sigma), expected)
    if expected[ECCENTRICITY_PHASE]:
        assert estimate.faults[ECCENTRICITY_PHASE] == 0.5


def test_healthy_actuator_fits_as_a_healthy_one(estimates):
    # Its own residual is one window's, of some 5000 / 20 values: 6 % of scatter.
    assert estimates("healthy").goodness_of_fit == pytest.approx(1.0, abs=0.25)


def test_estimate_says_where_it_comes_from(estimates, windows_of, calibration):
    estimate = estimates("friction low")
    [window] = windows_of(CASES["friction low"])
    assert (estimate.start_ns, estimate.end_ns) == (window.start_ns, window.end_ns)
    assert estimate.end_ns - estimate.start_ns == 500_000_000
    assert (estimate.algorithm, estimate.seed) == ("least_squares", 0)
    assert estimate.calibration_id == calibration.calibration_id
    assert estimate.computing_time_s > 0.0


@pytest.mark.parametrize("fitness", WEIGHTS)
def test_fitness_is_the_weighted_sum_of_squares_at_the_estimate(
    windows_of, calibration, description, fitness
):
    """Of an eccentric motor: where the phase is not observable it is set after the search."""
    truth = CASES["eccentricity low"]
    [window] = windows_of(truth)
    estimate = identify(window, description, calibration, Settings(fitness=fitness))
    modelled = calibration.model().respond(window, estimate.faults, estimate.play)[0]
    difference = window.current - calibration.apply(modelled)
    h = window.sample_period
    denominator = np.ones(len(window))
    if fitness == "total_least_squares":
        slope = np.gradient(window.current, h)
        denominator = np.sqrt(slope**2 / np.mean(slope**2) + 1.0)
    expected = h * np.sum(difference**2 / denominator)
    # Fault vectors to the point and back: rounding, times a steep current.
    assert estimate.fitness == pytest.approx(expected, rel=1e-6)
    assert estimation_error(estimate.faults, fault_vector(truth)) < LIMIT


@pytest.mark.parametrize("case", ["friction low", "eccentricity low"])
def test_particle_swarm_finds_the_same(windows_of, calibration, description, case):
    [window] = windows_of(CASES[case])
    settings = Settings("pso", termination=Termination(budget=2000))
    estimate = identify(window, description, calibration, settings)
    assert estimate.valid
    assert estimate.algorithm == "pso"
    # Measured 0.1 and 0.4 %.
    assert estimation_error(estimate.faults, fault_vector(CASES[case])) < LIMIT


def test_model_recognises_itself(healthy_windows, calibration, description):
    """A current that the model made with a fault vector leads back to it."""
    truth = fault_vector(
        {
            "friction": 0.3,
            "backlash": 0.05,
            "short_circuit_b": 0.15,
            "eccentricity": 0.2,
            "eccentricity_phase": 0.8,
            "gain": 0.6,
        }
    )
    window = healthy_windows[0]
    current = calibration.apply(calibration.model().respond(window, truth, window.play))[0]
    telemetry = replace(window.telemetry, current=np.append(0.0, current))
    estimate = identify(replace(window, telemetry=telemetry), description, calibration)
    # Steps of the search end below 1e-4.
    assert estimate.faults == pytest.approx(truth, abs=1e-3)
    assert estimate.fitness < 1e-6
    assert not np.any(estimate.unobservable)


def test_same_seed_makes_the_same_estimate(estimates, windows_of, calibration, description):
    [window] = windows_of(CASES["multiple"])
    assert same(estimates("multiple"), identify(window, description, calibration))


def test_another_seed_finds_the_same_faults(estimates, windows_of, calibration, description):
    [window] = windows_of(CASES["short circuit low"])
    other = identify(window, description, calibration, Settings(seed=3))
    assert other.seed == 3
    assert not same(other, estimates("short circuit low"))
    # The minimum is flat to the roughness of a model with dry friction, some 1e-3.
    assert other.faults == pytest.approx(estimates("short circuit low").faults, abs=5e-3)


@pytest.fixture(scope="module")
def without_approach(cycle):
    """Window of a chirp from rest, with the motor at a place in its play."""

    def window(faults, play) -> Window:
        actuator = SimulatedActuator()
        actuator.faults = fault_vector(faults)
        plant = degrade(constants(actuator.parameters), actuator.faults)
        actuator.state = at_rest(theta_m=play * plant.mechanics.half_backlash)
        command = np.concatenate([np.zeros(1000), cycle.samples[cycle.start + 1 :]])
        [window] = WindowTrigger(actuator.parameters).feed(actuator.advance(command))
        assert isinstance(window, Window)
        assert window.play is None
        return window

    return window


@pytest.mark.parametrize("play", [-1.0, 0.5])
def test_unknown_place_in_the_play_is_estimated(without_approach, calibration, description, play):
    faults = {"backlash": 0.3, "gain": 0.6}
    estimate = identify(without_approach(faults, play), description, calibration)
    assert estimate.valid
    # Measured to 0.04 half-widths, at an error of 0.5 %.
    assert estimate.play == pytest.approx(play, abs=0.1)
    assert estimation_error(estimate.faults, fault_vector(faults)) < LIMIT
    assert estimate.covariance.shape == (8, 8)


def test_unknown_place_in_a_small_play_harms_no_other_fault(
    without_approach, calibration, description
):
    faults = {"friction": 0.25}
    estimate = identify(without_approach(faults, -1.0), description, calibration)
    assert -1.0 <= estimate.play <= 1.0
    assert estimation_error(estimate.faults, fault_vector(faults)) < LIMIT


@pytest.mark.parametrize("algorithm", ["least_squares", "pso"])
def test_progress_falls_to_the_estimate(windows_of, calibration, description, algorithm):
    [window] = windows_of(CASES["gain high"])
    settings = Settings(algorithm, termination=Termination(budget=1000))
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
    assert estimate.fitness == generations[-1].fitness
    assert generations[-1].evaluations <= 1000
    # Two difference windows for each component, and the estimate itself, for the uncertainty.
    assert estimate.evaluations == generations[-1].evaluations + 2 * 8 + 1
    known = ~estimate.unobservable
    assert estimate.faults[known] == pytest.approx(generations[-1].faults[known], abs=1e-12)


def test_cancelled_identification_has_no_estimate(windows_of, calibration, description):
    [window] = windows_of(CASES["gain high"])
    identification = Identification(window, description, calibration, Settings())
    for generation in identification:
        assert np.all(np.isfinite(generation.faults))
        break
    assert identification.estimate is None


def test_unmodelled_trouble_is_told(windows_of, calibration, description):
    """A slow oscillation of 0.5 A that none of the eight faults can make."""
    [window] = windows_of({})
    t = window.sample_period * np.arange(len(window) + 1)
    current = window.telemetry.current + 0.5 * np.sin(2 * np.pi * 37.0 * t)
    troubled = replace(window, telemetry=replace(window.telemetry, current=current))
    estimate = identify(troubled, description, calibration)
    assert estimate.valid
    assert estimate.goodness_of_fit > 5.0
    assert f"{estimate.goodness_of_fit:.1f} times that of a healthy actuator" in estimate.reason


def test_sigma_is_that_of_the_faults_themselves(windows_of, calibration, description):
    """The same from derivatives by eccentricity and phase, without the plane between.

    With noise of 1 A, so that it outweighs what is put aside for the mismatch of the model.
    """
    [window] = windows_of(CASES["eccentricity high"])
    noise = np.random.default_rng(12).normal(0.0, 1.0, len(window) + 1)
    noisy = replace(window.telemetry, current=window.telemetry.current + noise)
    window = replace(window, telemetry=noisy)
    settings = Settings(fitness="least_squares")
    estimate = identify(window, description, calibration, settings)

    step = 2.5e-3
    inside = np.clip(estimate.faults, step, 1.0 - step)
    points = np.concatenate([inside + step * np.eye(8), inside - step * np.eye(8)])
    model = calibration.model()
    above, below = np.split(calibration.apply(model.respond(window, points, estimate.play)), 2)
    at = calibration.apply(model.respond(window, estimate.faults, estimate.play))[0]
    covariance = sandwich_covariance((above - below).T / (2 * step), window.current - at, 50)
    expected = np.diag(covariance) + MISMATCH_SIGMA**2
    around = 2 * np.pi * estimate.faults[ECCENTRICITY]
    expected[ECCENTRICITY_PHASE] += (1 / around**2 - 1) * MISMATCH_SIGMA**2
    # Derivatives over other steps, of a model with dry friction, differ by some percent.
    assert estimate.sigma == pytest.approx(np.sqrt(expected), rel=0.15)
    assert estimate.sigma[ECCENTRICITY] > 3 * MISMATCH_SIGMA


def test_single_window_calibration_does_not_tell_the_fit(windows_of, healthy_windows, description):
    [window] = windows_of(CASES["friction low"])
    estimate = identify(window, description, calibrate(healthy_windows[:1], description))
    assert estimate.valid
    assert estimate.reason == ""
    assert np.isnan(estimate.goodness_of_fit)


@pytest.mark.parametrize("windows", [2, 5])
def test_calibration_from_equal_windows_can_be_used(
    windows_of, healthy_windows, description, windows
):
    """A noiseless simulation that starts from rest every time scatters by nothing."""
    [window] = windows_of(CASES["friction low"])
    equal = calibrate([healthy_windows[0]] * windows, description)
    estimate = identify(window, description, equal)
    assert estimate.valid
    assert estimation_error(estimate.faults, fault_vector(CASES["friction low"])) < LIMIT
    # Nothing is known of the scatter of healthy windows, so nothing is wrong beside the fault.
    assert estimate.reason == ""


def test_budget_below_one_generation_is_refused(windows_of, calibration, description):
    [window] = windows_of(CASES["friction low"])
    with pytest.raises(ValueError, match="budget = 7 evaluations"):
        identify(window, description, calibration, Settings(termination=Termination(budget=7)))


def test_description_of_another_place_is_no_objection(windows_of, calibration, estimates):
    """The unit counts, not where it is fitted."""
    [window] = windows_of(CASES["multiple"])
    estimate = identify(window, ActuatorDescription(actuator_id="rudder"), calibration)
    assert same(estimate, estimates("multiple"))
