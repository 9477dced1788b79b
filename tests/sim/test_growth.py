# SPDX-License-Identifier: Apache-2.0
"""Growth of simulated faults, and simulated lives: laws, steps, noise, limits, lengths, seeds."""

import math
from functools import cache

import numpy as np
import pytest

from ema_core.faults import FAULT_NAMES, TYPICAL, fault_vector, healthy_faults
from ema_core.growth_laws import hours_until
from ema_sim.growth import Growth, grow
from ema_sim.lives import LifeSettings, constant_life, run_to_failure


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def friction_after(growth: Growth, x: float, before: float, hours: float, seed: int = 0) -> float:
    return grow({"friction": x}, {"friction": growth}, before, hours, rng(seed))[0]


@pytest.mark.parametrize(
    "growth",
    [Growth("archard", 3e-4, 3.0), Growth("drift", 1.5e-4), Growth("power", 900.0, 1.6)],
    ids=lambda growth: growth.law,
)
def test_growth_does_not_depend_on_the_length_of_steps(growth):
    whole = friction_after(growth, 0.02, 0.0, 400.0)
    x = 0.02
    for i in range(40):
        x = friction_after(growth, x, 10.0 * i, 10.0)
    assert x == pytest.approx(whole, rel=1e-12)


@pytest.mark.parametrize("law", ["constant", "linear", "exponential", "archard", "drift"])
def test_constant_growth_changes_nothing_and_draws_no_random_numbers(law):
    generator = rng()
    k = fault_vector({"friction": 0.2, "gain": 0.4})
    rate = 0.3 if law == "constant" else 0.0
    noise = 0.0 if law == "drift" else 0.3
    growths = {"friction": Growth(law, rate, 2.0, noise), "gain": Growth(law, rate, 2.0, noise)}
    np.testing.assert_array_equal(grow(k, growths, 0.0, 1e3, generator), k)
    assert generator.random() == rng().random()


def test_drift_diffuses_with_the_square_root_of_time():
    a, s, hours, n = 1e-4, 1e-3, 400.0, 4000
    generator = rng(3)
    growth = {"gain": Growth("drift", a, noise=s)}
    ends = np.array([grow(healthy_faults(), growth, 0.0, hours, generator)[-1] for _ in range(n)])
    sigma = s * math.sqrt(hours)
    # Five standard deviations of the mean and of the standard deviation of n Gaussian numbers.
    assert ends.mean() == pytest.approx(0.5 + a * hours, abs=5 * sigma / math.sqrt(n))
    assert ends.std() == pytest.approx(sigma, rel=5 / math.sqrt(2 * n))


def test_increments_have_a_lognormal_factor_of_mean_one():
    """As the tracker assumes, the rate of a law is the mean rate of growth for any noise."""
    sigma, n = 0.3, 4000
    generator = rng(4)
    growth = {"friction": Growth("archard", 3e-4, 3.0, sigma)}
    start = fault_vector({"friction": 0.1})
    noiseless = friction_after(Growth("archard", 3e-4, 3.0), 0.1, 0.0, 10.0) - 0.1
    steps = np.array([grow(start, growth, 0.0, 10.0, generator)[0] for _ in range(n)]) - 0.1
    logs = np.log(steps / noiseless)
    assert logs.mean() == pytest.approx(-(sigma**2) / 2.0, abs=5 * sigma / math.sqrt(n))
    # A lognormal factor of mean 1 has a scatter of sqrt(exp(sigma^2) - 1) = 0.31: 5 standard
    # errors.
    assert (steps / noiseless).mean() == pytest.approx(1.0, abs=5 * 0.31 / math.sqrt(n))
    assert logs.std() == pytest.approx(sigma, rel=5 / math.sqrt(2 * n))


def test_same_seed_gives_the_same_life_in_any_order_of_the_growths():
    growths = {"gain": Growth("drift", 0.0, noise=1e-2), "friction": Growth("linear", 1e-3, 0, 0.3)}
    forward = grow(healthy_faults(), growths, 0.0, 10.0, rng(1))
    backward = grow(healthy_faults(), dict(reversed(growths.items())), 0.0, 10.0, rng(1))
    np.testing.assert_array_equal(forward, backward)
    assert np.any(forward != grow(healthy_faults(), growths, 0.0, 10.0, rng(2)))


@pytest.mark.parametrize(
    ("figures", "message"),
    [
        ({"law": "rust"}, "law = 'rust' is unknown; known: constant, linear"),
        ({"rate": math.nan}, "rate = nan"),
        ({"rate": 1e7}, r"rate = 1e\+07 1/h"),
        ({"shape": -1.0}, "shape = -1 is outside"),
        ({"noise": -0.1}, "noise = -0.1"),
        ({"onset": -5.0}, "onset = -5 h"),
        ({"law": "power", "shape": 1.6}, "rate = 0 h: the law power"),
        ({"law": "power", "rate": 2000.0}, "shape = 0: the law power"),
    ],
)
def test_impossible_growth_is_refused(figures, message):
    with pytest.raises(ValueError, match=message):
        Growth(**figures)


def test_growth_that_does_not_fit_its_component_is_refused():
    with pytest.raises(ValueError, match="unknown fault 'rust'; known: friction"):
        grow(healthy_faults(), {"rust": Growth()}, 0.0, 1.0, rng())
    with pytest.raises(ValueError, match=r"growth of friction: rate = -0\.001"):
        grow(healthy_faults(), {"friction": Growth("linear", -1e-3)}, 0.0, 1.0, rng())
    with pytest.raises(ValueError, match="hours_step = -1 h"):
        grow(healthy_faults(), {}, 0.0, -1.0, rng())


LIMITS = {
    "friction": 0.5,
    "backlash": 0.5,
    "short_circuit_a": 0.25,
    "short_circuit_b": 0.25,
    "short_circuit_c": 0.25,
    "eccentricity": 0.6,
    "gain": 0.25,
}
REACH = np.array([LIMITS.get(name, np.inf) for name in FAULT_NAMES])


def away(faults):
    return np.abs(faults - healthy_faults())


@cache
def life_of(kind, seed, with_repair=False):
    return run_to_failure(LIMITS, np.random.default_rng(seed), kind, with_repair=with_repair)


def lives_of(kind, count=12, with_repair=False):
    return [life_of(kind, seed, with_repair) for seed in range(count)]


@pytest.mark.parametrize("kind", TYPICAL)
def test_lives_last_from_60_to_200_tests(kind):
    for life in lives_of(kind):
        assert 60 <= len(life.hours) <= 200
        assert life.hours[-1] <= life.end_hours <= life.hours[-1] + 10.0
        assert np.array_equal(life.hours, 10.0 * np.arange(len(life.hours)))


@pytest.mark.parametrize("kind", TYPICAL)
def test_only_the_dominant_fault_reaches_its_limit_and_only_at_the_end(kind):
    for life in lives_of(kind):
        name = life.dominant
        assert name.startswith("short_circuit_") if kind == "short_circuit" else name == kind
        share = away(life.faults) / REACH
        assert np.all(share < 1.0)
        assert int(np.argmax(share[-1])) == FAULT_NAMES.index(name)


def test_without_noise_life_ends_where_the_law_reaches_the_limit():
    settings = LifeSettings(process_noise=0.0)
    for kind in ("friction", "backlash", "short_circuit", "eccentricity"):
        life = run_to_failure(LIMITS, np.random.default_rng(3), kind, settings)
        growth = life.growths[life.dominant]
        limit = LIMITS[life.dominant]
        law = float(hours_until(growth.law, 0.0, growth.rate, growth.shape, limit))
        # Between tests, the end is interpolated linearly.
        assert life.end_hours == pytest.approx(growth.onset + law, abs=1.0)


@pytest.mark.slow
def test_other_faults_grow_at_a_fifth_of_their_rates():
    lives = [*lives_of("backlash", 60), *lives_of("gain", 60)]
    for name, kind in (("friction", "friction"), ("eccentricity", "eccentricity")):
        rates = [life.growths[name].rate / TYPICAL[kind].rate for life in lives]
        expected = 5.0 if kind == "eccentricity" else 0.2
        assert np.exp(np.mean(np.log(rates))) == pytest.approx(expected, rel=0.12)


def _constant(seed):
    return constant_life(LIMITS, np.random.default_rng(seed))


def test_nothing_grows_in_a_constant_life():
    levels = []
    for seed in range(40):
        life = _constant(seed)
        assert np.all(life.faults == life.faults[0])
        assert life.end_hours == math.inf
        assert life.dominant == ""
        levels.append(away(life.faults[0]) / REACH)
    assert 0.0 < np.max(levels) < 0.6 + 1e-12
    assert min(np.count_nonzero(level) for level in levels) <= 1


def test_repair_restores_the_dominant_fault_and_restarts_life():
    for kind in TYPICAL:
        for life in lives_of(kind, 3, with_repair=True):
            column = FAULT_NAMES.index(life.dominant)
            value = away(life.faults)[:, column]
            at = int(life.repair_hours / 10.0)
            assert value[at] == 0.0
            assert value[at - 1] > 0.0
            assert 60 <= len(life.hours) - at <= 200
            other_faults = np.delete(away(life.faults), column, axis=1)
            assert np.all(other_faults[at] >= 0.5 * other_faults[at - 1])


def test_same_seed_gives_the_same_life():
    first, second = (run_to_failure(LIMITS, np.random.default_rng(9)) for _ in range(2))
    assert np.array_equal(first.faults, second.faults)
    assert (first.windows, first.end_hours) == (second.windows, second.end_hours)
    different_seed = run_to_failure(LIMITS, np.random.default_rng(10))
    assert different_seed.end_hours != first.end_hours


@pytest.mark.parametrize(
    ("limits", "kind", "settings", "parts"),
    [
        ({**LIMITS, "gain": 0.0}, None, None, ("gain", "0.0")),
        ({"gain": 0.2}, None, None, ("friction", "None")),
        (LIMITS, "rust", None, ("'rust'", "backlash")),
        (LIMITS, "gain", LifeSettings(interval_hours=1000.0), ("1000 drawn lives", "60 to 200")),
    ],
)
def test_impossible_lives_are_refused(limits, kind, settings, parts):
    with pytest.raises(ValueError, match=parts[0]) as refused:
        run_to_failure(limits, np.random.default_rng(0), kind, settings)
    assert parts[1] in str(refused.value)
