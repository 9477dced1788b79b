"""What the monitor model does as a whole: rest, steady motion, steps, many individuals."""

import itertools
import math
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from ema_core.commands import THESIS_CHIRP
from ema_core.dynamics import next_speed
from ema_core.faults import fault_vector, healthy_faults, random_faults
from ema_core.parameters import ActuatorParameters, constants
from ema_core.simd import LANES
from ema_monitor.model.kernel import next_speed_of_lanes, rotate
from ema_monitor.model.monitor_model import FORMS, MonitorModel, Response
from ema_monitor.windows.band import rms

from .windows import window_from

PARAMETERS = ActuatorParameters()
CHIRP = np.concatenate([[0.0], THESIS_CHIRP.sample(1e-4)])


def one(window, faults=None, *, form="fast", parameters=PARAMETERS, dt=None, play=0.0):
    """Current of one individual."""
    response = MonitorModel(parameters, form, dt).respond(window, fault_vector(faults or {}), play)
    return response.current[0]


def equal(a: Response, b: Response) -> bool:
    """Whether two responses agree to the last bit."""
    return all(np.array_equal(x, y, equal_nan=True) for x, y in zip(a, b, strict=True))


def part(response: Response, rows) -> Response:
    return Response(response.current[rows], response.speed[rows])


@pytest.mark.parametrize("gain", [0.0, 0.5, 1.0])
@pytest.mark.parametrize(("form", "tolerance"), [("fast", 1e-12), ("source", 0.067)])
def test_held_shaft_draws_the_reference_current(form, tolerance, gain):
    """An offset that friction holds is an exact I_ref; the source form chatters about it.

    Its tolerance is what the full supply adds in a step of 1 us, 48 V / 0.72 mH.
    """
    p, offset = PARAMETERS, 8e-6
    I_ref = p.GAP * p.G_prop * (0.5 + gain) * offset / p.k_t
    current = one(window_from(np.full(200, offset)), {"gain": gain}, form=form)
    assert current[20:] == pytest.approx(I_ref, rel=1e-12, abs=tolerance)
    if form == "fast":
        assert current[0] == pytest.approx(I_ref, rel=1e-12)


@pytest.mark.parametrize("form", FORMS)
def test_reference_current_is_limited(form):
    p = PARAMETERS.replace({"f_sm": 10.0, "R_s": 1.0, "T_max": 5.0})
    current = one(window_from(np.full(200, -1.0)), form=form, parameters=p)
    # 0.067 A: the chatter of the source form, as above.
    assert current[-50:] == pytest.approx(-p.I_max, abs=0.067)


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("rate", [0.1, -0.6])
@pytest.mark.parametrize(("form", "torque_constant"), [("fast", "k_e"), ("source", "G_M")])
def test_steady_motion_draws_what_friction_needs(form, torque_constant, rate, friction):
    p, h = PARAMETERS, 1e-4
    n = 2000 if form == "fast" else 600
    command = rate * h * np.arange(n + 1)
    omega = rate / p.tau
    # The position lags until the position loop asks for the speed: a start without transient.
    window = window_from(command, speed=omega, position=-omega / p.G_prop)
    torque = (p.C_m + p.C_u) * abs(omega) + (1 + 2 * friction) * p.f_ratio * (p.f_sm + p.f_su)
    expected = np.sign(rate) * torque / getattr(p, torque_constant)
    current = one(window, {"friction": friction}, form=form)[n // 2 :]
    if form == "fast":
        # The loop settles with a time constant of some ms: 1e-6 of what is left of its start.
        assert current == pytest.approx(expected, rel=1e-6)
    else:
        # Chatter: a sample of 100 steps of up to 0.13 A, and their mean over 300 samples.
        assert current == pytest.approx(expected, abs=0.13)
        assert np.mean(current) == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(("offset_in_band", "moves"), [(-0.01, False), (0.01, True)])
def test_ripple_breaks_the_motor_away_below_static_friction(offset_in_band, moves):
    """(M12): it takes f_s less what the hysteresis band is worth in torque, k_e h_b."""
    p = PARAMETERS
    breakaway = p.f_sm + p.f_su - p.k_e * p.h_b
    I = (breakaway + offset_in_band * p.k_e * p.h_b) / p.k_e
    command = np.full(400, I * p.k_t / (p.GAP * p.G_prop))
    current = one(window_from(command))
    # Where the shaft yields, the error of position and with it the current fall.
    assert (current[-1] < 0.9 * current[0]) == moves
    if not moves:
        assert current == pytest.approx(I, rel=1e-12)


def test_ripple_leaves_the_dynamic_friction():
    """However wide the band, what brakes the motion also holds the rest."""
    p = PARAMETERS.replace({"h_b": 5.0})
    for share, moves in ((0.99, False), (1.01, True)):
        I = share * p.f_ratio * (p.f_sm + p.f_su) / p.k_e
        current = one(
            window_from(np.full(400, I * p.k_t / (p.GAP * p.G_prop))), parameters=p, play=1.0
        )
        assert (current[-1] < (1 - 1e-6) * current[0]) == moves
        if not moves:
            assert current == pytest.approx(I, rel=1e-12)


@pytest.mark.parametrize(
    "faults",
    [
        {},
        {"friction": 0.5},
        {"backlash": 0.3},
        {"short_circuit_a": 0.7},
        {"eccentricity": 0.7},
        {"friction": 0.25, "short_circuit_a": 0.2, "eccentricity": 0.3, "gain": 0.3},
    ],
)
def test_fast_form_converges_with_its_step(faults):
    window = window_from(CHIRP)
    finest = one(window, faults, dt=1e-6)
    steps = np.array([5e-5, 2e-5, 1e-5, 5e-6, 2.5e-6])
    errors = [rms(one(window, faults, dt=dt) - finest) for dt in steps]
    # First order; stops at zero speed and the edges of the pairs scatter it.
    assert 0.7 < np.polyfit(np.log(steps), np.log(errors), 1)[0] < 1.5
    # The default step is well below the PWM's ripple of 0.1 A.
    assert errors[1] < 0.02
    assert FORMS["fast"] == steps[1]


@pytest.mark.parametrize("form", FORMS)
def test_individuals_of_one_call_do_not_know_each_other(form):
    """Alone, in another order, in another lane or beside the padding: the same to the last bit."""
    rng = np.random.default_rng(5)
    n = 2 * LANES + 3
    faults = np.stack([random_faults(rng) for _ in range(n)])
    play = rng.uniform(-1.0, 1.0, n)
    model = MonitorModel(PARAMETERS, form)
    window = window_from(CHIRP[1500:2000], position=CHIRP[1500], speed=30.0)
    together = model.respond(window, faults, play)
    for rows in together:
        assert len({row.tobytes() for row in rows}) == n
    for i in range(n):
        assert equal(part(together, [i]), model.respond(window, faults[i], play[i]))
    order = rng.permutation(n)
    assert equal(part(together, order), model.respond(window, faults[order], play[order]))
    for m in (0, LANES - 1, LANES, LANES + 1):
        assert equal(part(together, slice(m)), model.respond(window, faults[:m], play[:m]))


@pytest.mark.parametrize("form", FORMS)
def test_undefined_individual_spoils_no_other(form):
    rng = np.random.default_rng(6)
    n, undefined = LANES + 3, [2, LANES + 2]
    faults = np.stack([random_faults(rng) for _ in range(n)])
    model, play = MonitorModel(PARAMETERS, form), np.zeros(n)
    window = window_from(CHIRP[1500:1600], speed=30.0)
    expected = model.respond(window, faults, play)
    play[undefined] = np.nan
    found = model.respond(window, faults, play)
    for rows, unspoilt in zip(found, expected, strict=True):
        others = np.setdiff1d(np.arange(n), undefined)
        assert np.array_equal(rows[others], unspoilt[others])
        assert np.all(np.isfinite(rows[others]))
    assert np.all(np.isnan(found.current[undefined]))


def test_threads_may_run_the_model_at_once():
    rng = np.random.default_rng(7)
    batches = [np.stack([random_faults(rng) for _ in range(3 * LANES)]) for _ in range(8)]
    window, model = window_from(CHIRP[:1000]), MonitorModel(PARAMETERS)
    with ThreadPoolExecutor(4) as pool:
        at_once = list(pool.map(lambda faults: model.respond(window, faults), batches))
    for faults, response in zip(batches, at_once, strict=True):
        assert equal(response, model.respond(window, faults))


@pytest.mark.slow
def test_another_process_finds_the_kernels_in_the_cache():
    code = (
        "from ema_monitor.model.monitor_model import compile_kernels, run_lanes; compile_kernels();"
        "print(sum(run_lanes.stats.cache_hits.values()), len(run_lanes.stats.cache_misses))"
    )
    _, second = (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
        )
        for _ in range(2)
    )
    assert second.stdout.split() == [str(len(FORMS)), "0"]


def test_speed_without_branches_is_that_with_them():
    rng = np.random.default_rng(9)
    m = constants(PARAMETERS).mechanics
    # Moving, about to stop, at rest; driven, held, just held and just not.
    speeds = [*rng.normal(0.0, 50.0, 20), *rng.normal(0.0, 0.05, 20), 0.0, -0.0]
    torques = [*rng.normal(0.0, 0.3, 20), 0.0, m.f_s, -m.f_s, m.f_s * (1 + 1e-15)]
    for omega, torque in itertools.product(speeds, torques):
        for breakaway in (m.f_s, m.f_d):
            lanes = next_speed_of_lanes(m, omega, torque, breakaway, m.f_d, 2e-5)
            assert lanes == next_speed(m, omega, torque, breakaway, 2e-5)


def test_angle_turned_in_steps_is_the_whole_angle():
    """Half a second at the highest speed, 8000 rpm, in the steps of the fast form."""
    angle, steps = 8000 * 2 * math.pi / 60 * FORMS["fast"], round(0.5 / FORMS["fast"])
    cos, sin = 1.0, 0.0
    for _ in range(steps):
        cos, sin = rotate(cos, sin, angle)
    # The first terms left out, angle^6 / 720 and angle^7 / 5040, add up over all steps.
    bound = 1.1 * steps * angle**6 / 720
    assert cos == pytest.approx(math.cos(steps * angle), abs=bound)
    assert sin == pytest.approx(math.sin(steps * angle), abs=bound)
    assert bound < 1e-9


def test_run_starts_with_the_state_of_the_window():
    """What the speed loop holds at the start is the measured current less what the error asks."""
    p = PARAMETERS.replace({"GAI": 0.5})
    # Held by friction at zero error, so that only the integrator drives.
    current = one(window_from(np.zeros(50), current=0.7), parameters=p)
    assert current == pytest.approx(0.7, rel=1e-12)


def test_step_that_does_not_divide_the_sample_period_is_refused():
    model = MonitorModel(PARAMETERS, dt=3e-5)
    with pytest.raises(ValueError, match=r"sample period 0\.0001 s .* dt = 3e-05 s"):
        model.respond(window_from(np.zeros(10)), healthy_faults())
    with pytest.raises(ValueError, match=r"sample period 1e-05 s .* dt = 2e-05 s"):
        MonitorModel(PARAMETERS).respond(
            window_from(np.zeros(10), sample_period=1e-5), healthy_faults()
        )


def test_unknown_form_is_refused():
    with pytest.raises(ValueError, match="'exact' is unknown; known: fast, source"):
        MonitorModel(PARAMETERS, "exact")


@pytest.mark.parametrize("dt", [0.0, -1e-6, 2e-3, float("nan")])
def test_impossible_step_is_refused(dt):
    with pytest.raises(ValueError, match="monitor step dt = "):
        MonitorModel(PARAMETERS, dt=dt)
