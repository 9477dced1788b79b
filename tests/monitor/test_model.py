# SPDX-License-Identifier: Apache-2.0
"""The monitor model as a whole: steps, symmetry, many individuals, and its kernels."""

import itertools
import math
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from ema_core.commands import THESIS_CHIRP
from ema_core.dynamics import next_speed
from ema_core.faults import FAULT_NAMES, fault_vector, healthy_faults, random_faults
from ema_core.parameters import ActuatorParameters, constants
from ema_core.simd import LANES
from ema_monitor.model import drives
from ema_monitor.model.deviations import Deviations
from ema_monitor.model.kernel import next_speed_of_lanes, rotate
from ema_monitor.model.monitor_model import FORMS, MonitorModel, Response, compile_kernels
from ema_monitor.windows.band import rms

from .windows import window_from

PARAMETERS = ActuatorParameters()
CHIRP = np.concatenate([[0.0], THESIS_CHIRP.sample(1e-4)])


def equal(a: Response, b: Response) -> bool:
    """Return whether two responses are bit-identical."""
    return all(np.array_equal(x, y, equal_nan=True) for x, y in zip(a, b, strict=True))


def part(response: Response, rows) -> Response:
    return Response(response.current[rows], response.speed[rows])


@pytest.mark.parametrize(
    "faults", [{"backlash": 0.3}, {"friction": 0.25, "short_circuit_a": 0.2, "eccentricity": 0.3}]
)
def test_fast_form_converges_with_its_step(faults):
    window, vector = window_from(CHIRP), fault_vector(faults)
    steps = np.array([5e-5, 2e-5, 1e-5, 5e-6, 2.5e-6])
    *coarse, finest = (
        MonitorModel(PARAMETERS, dt=dt).respond(window, vector).current for dt in (*steps, 1e-6)
    )
    errors = [rms(current - finest) for current in coarse]
    # The error is of first order; stops at zero speed and the edges of the pairs scatter it.
    assert 0.7 < np.polyfit(np.log(steps), np.log(errors), 1)[0] < 1.5
    # The error of the default step is well below the PWM ripple of 0.1 A.
    assert errors[1] < 0.02
    assert FORMS["fast"] == steps[1]


@pytest.mark.parametrize("form", FORMS)
def test_individuals_of_a_call_do_not_affect_each_other(form):
    """Alone, in another order or lane, or next to padding, results are bit-identical."""
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
def test_undefined_individual_affects_no_other(form):
    rng = np.random.default_rng(6)
    n, undefined = LANES + 3, [2, LANES + 2]
    faults = np.stack([random_faults(rng) for _ in range(n)])
    model, play = MonitorModel(PARAMETERS, form), np.zeros(n)
    window = window_from(CHIRP[1500:1600], speed=30.0)
    expected = model.respond(window, faults, play)
    play[undefined] = np.nan
    actual = model.respond(window, faults, play)
    for rows, unspoilt in zip(actual, expected, strict=True):
        defined = np.setdiff1d(np.arange(n), undefined)
        assert np.array_equal(rows[defined], unspoilt[defined])
        assert np.all(np.isfinite(rows[defined]))
    assert np.all(np.isnan(actual.current[undefined]))


def test_threads_may_run_the_model_concurrently():
    rng = np.random.default_rng(7)
    batches = [np.stack([random_faults(rng) for _ in range(3 * LANES)]) for _ in range(8)]
    window, model = window_from(CHIRP[:1000]), MonitorModel(PARAMETERS)
    with ThreadPoolExecutor(4) as pool:
        at_once = list(pool.map(lambda faults: model.respond(window, faults), batches))
    for faults, response in zip(batches, at_once, strict=True):
        assert equal(response, model.respond(window, faults))


# The simulator shares functions with the monitor. Their cache index names the argument types of
# each compiled version, and reading it imports the modules of these types: they must belong to
# neither package.
USE = """
import sys
from ema_sim.actuator import SimulatedActuator
SimulatedActuator().advance([0.0])
assert not [name for name in sys.modules if name.split(".")[0] == "ema_monitor"]

from ema_monitor.model.kernel import run_lanes
from ema_monitor.model.monitor_model import compile_kernels
compile_kernels()
print(sum(run_lanes.stats.cache_hits.values()), len(run_lanes.stats.cache_misses))
"""


@pytest.mark.slow
def test_another_process_loads_the_kernels_from_the_cache_and_only_those_it_uses():
    compile_kernels()
    done = subprocess.run(
        [sys.executable, "-c", USE], capture_output=True, text=True, check=True, timeout=100
    )
    assert done.stdout.split() == [str(len(FORMS)), "0"]


@pytest.mark.parametrize(
    ("from_degrees", "pair"),
    # Eq. 4.12, and the next two half turns: the pair does not depend on the direction of the
    # current.
    [(-30, "BC"), (30, "AB"), (90, "AC"), (150, "BC"), (210, "AB"), (-90, "AC")],
)
def test_pair_follows_equation_4_12_up_to_the_beginning_of_the_next_one(from_degrees, pair):
    """This holds after any number of turns of the motor."""
    motor = constants(PARAMETERS).motor._replace(N_a=0.9, N_b=0.7, N_c=0.4)
    drive, width = drives.fast_constants(motor, 2e-5), math.pi / 3.0 / motor.P
    for turns in (-7, 0, 500):
        lowest = math.radians(from_degrees + 360 * turns) / motor.P
        # 1e-9 rad is far beyond rounding; exactly on the edge, either pair is right.
        for within in (1e-9, width / 2, width - 1e-9):
            pair_found = drives.pair_at(drive, lowest + within)
            assert drive.R[("BC", "AB", "AC").index(pair)] == pair_found.R
            assert (pair_found.lowest, pair_found.highest) == pytest.approx(
                (lowest, lowest + width), abs=1e-9
            )


def test_branchless_speed_equals_that_with_branches():
    rng = np.random.default_rng(9)
    m = constants(PARAMETERS).mechanics
    # Moving, about to stop, at rest; driven, held, barely held and barely not held.
    speeds = [*rng.normal(0.0, 50.0, 20), *rng.normal(0.0, 0.05, 20), 0.0, -0.0]
    torques = [*rng.normal(0.0, 0.3, 20), 0.0, m.f_s, -m.f_s, m.f_s * (1 + 1e-15)]
    for omega, torque in itertools.product(speeds, torques):
        for breakaway in (m.f_s, m.f_d):
            lanes = next_speed_of_lanes(m, omega, torque, 0.0, breakaway, m.f_d, 2e-5)
            expected = next_speed(m, omega, torque, breakaway, 2e-5)
            assert lanes == pytest.approx(expected, rel=1e-12, abs=1e-12)
            assert (lanes == 0.0) == (expected == 0.0)


def test_angle_turned_in_steps_equals_the_whole_angle():
    """Half a second at the highest speed, 8000 rpm, in steps of the fast form."""
    angle, steps = 8000 * 2 * math.pi / 60 * FORMS["fast"], round(0.5 / FORMS["fast"])
    cos, sin = 1.0, 0.0
    for _ in range(steps):
        cos, sin = rotate(cos, sin, angle)
    # The first omitted terms, angle^6 / 720 and angle^7 / 5040, add up over all steps.
    bound = 1.1 * steps * angle**6 / 720
    assert cos == pytest.approx(math.cos(steps * angle), abs=bound)
    assert sin == pytest.approx(math.sin(steps * angle), abs=bound)
    assert bound < 1e-9


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


# The source form with its own step of 1 us costs twenty times as much.
SAMPLES = {"fast": 5000, "source": 1500}
FAULTS = {
    "friction": 0.1,
    "backlash": 0.01,
    "short_circuit_a": 0.3,
    "short_circuit_b": 0.1,
    "gain": 0.7,
}
ECCENTRIC = FAULTS | {"eccentricity": 0.4, "eccentricity_phase": 0.2}
# Rounding of angles a third of a turn apart, times the position gain: about 1e-12 A.
ROUNDING = 1e-9


def relabelled(faults, names):
    """Return faults that move the state of phases A, B, C to the named phases, in that order."""
    k = fault_vector(faults)
    short = {phase: FAULT_NAMES.index(f"short_circuit_{phase}") for phase in "abc"}
    moved = k.copy()
    for old, new in zip("abc", names, strict=True):
        moved[short[new]] = k[short[old]]
    return moved


def current(form, command, faults, play, position=0.0):
    window = window_from(command[: SAMPLES[form] + 1], position=position)
    model = MonitorModel(PARAMETERS, form, unit=Deviations(lift=0.3))
    return model.respond(window, faults, play).current[0]


@pytest.mark.parametrize(
    ("form", "faults", "turn"),
    [
        # A third of an electrical turn: phase B now does what phase A did.
        ("fast", FAULTS, 2 * math.pi / 3 / PARAMETERS.P),
        ("source", FAULTS, 2 * math.pi / 3 / PARAMETERS.P),
        # The air gap depends only on mechanical turns: a third of one back is two thirds of an
        # electrical turn back, which for two pole pairs equals a third ahead.
        ("fast", ECCENTRIC, -2 * math.pi / 3),
    ],
)
def test_turning_the_rotor_relabels_the_phases(form, faults, turn):
    offset = turn * PARAMETERS.tau
    original = current(form, CHIRP, fault_vector(faults), 0.4)
    turned = current(form, CHIRP + offset, relabelled(faults, "bca"), 0.4, offset)
    assert np.max(np.abs(turned - original)) < ROUNDING
    # The faults must have an effect at all: without relabelling, the current differs.
    unchanged = current(form, CHIRP + offset, fault_vector(faults), 0.4, offset)
    assert np.max(np.abs(unchanged - original)) > 0.1


@pytest.mark.parametrize(("form", "faults"), [("fast", ECCENTRIC), ("source", FAULTS)])
def test_mirroring_the_motion_mirrors_the_current(form, faults):
    mirrored = relabelled(faults, "acb")
    phase = FAULT_NAMES.index("eccentricity_phase")
    mirrored[phase] = 1.0 - mirrored[phase]
    original = current(form, CHIRP, fault_vector(faults), 0.4)
    # Only the cosine of the phase is rounded differently.
    assert np.max(np.abs(current(form, -CHIRP, mirrored, -0.4) + original)) < ROUNDING
