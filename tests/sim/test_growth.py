"""Growth of simulated faults: the laws, their steps, their noise and their limits."""

import math

import numpy as np
import pytest

from ema_core.faults import fault_vector, healthy_faults
from ema_sim.growth import Growth, grow

CASES = [
    Growth("linear", 1e-3),
    Growth("exponential", 2e-3, 0.05),
    Growth("archard", 3e-4, 3.0),
    Growth("archard", 3e-4, 0.0),
    Growth("self_heating", 1.5e-4, 6.0),
    Growth("self_heating", 1.5e-4, 0.0),
    Growth("drift", 1.5e-4),
]


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def friction_after(growth: Growth, x: float, before: float, hours: float, seed: int = 0) -> float:
    return grow({"friction": x}, {"friction": growth}, before, hours, rng(seed))[0]


@pytest.mark.parametrize("growth", [*CASES, Growth("power", 900.0, 1.6)], ids=lambda g: g.law)
def test_length_of_the_steps_does_not_show(growth):
    whole = friction_after(growth, 0.02, 0.0, 400.0)
    x = 0.02
    for i in range(40):
        x = friction_after(growth, x, 10.0 * i, 10.0)
    assert x == pytest.approx(whole, rel=1e-12)


@pytest.mark.parametrize("law", ["constant", "linear", "exponential", "archard", "drift"])
def test_constant_growth_changes_nothing_and_draws_nothing(law):
    generator = rng()
    k = fault_vector({"friction": 0.2, "gain": 0.4})
    rate = 0.3 if law == "constant" else 0.0
    noise = 0.0 if law == "drift" else 0.3
    growths = {"friction": Growth(law, rate, 2.0, noise), "gain": Growth(law, rate, 2.0, noise)}
    np.testing.assert_array_equal(grow(k, growths, 0.0, 1e3, generator), k)
    assert generator.random() == rng().random()


def test_drift_diffuses_with_the_root_of_the_time():
    a, s, hours, n = 1e-4, 1e-3, 400.0, 4000
    generator = rng(3)
    growth = {"gain": Growth("drift", a, noise=s)}
    ends = np.array([grow(healthy_faults(), growth, 0.0, hours, generator)[-1] for _ in range(n)])
    sigma = s * math.sqrt(hours)
    # Five standard deviations of the mean and of the deviation of n Gaussian numbers.
    assert ends.mean() == pytest.approx(0.5 + a * hours, abs=5 * sigma / math.sqrt(n))
    assert ends.std() == pytest.approx(sigma, rel=5 / math.sqrt(2 * n))


def test_increments_have_a_lognormal_factor_of_mean_one():
    """As the tracker assumes: the rate of a law is the mean rate of growth, whatever the noise."""
    sigma, n = 0.3, 4000
    generator = rng(4)
    growth = {"friction": Growth("archard", 3e-4, 3.0, sigma)}
    start = fault_vector({"friction": 0.1})
    noiseless = friction_after(Growth("archard", 3e-4, 3.0), 0.1, 0.0, 10.0) - 0.1
    steps = np.array([grow(start, growth, 0.0, 10.0, generator)[0] for _ in range(n)]) - 0.1
    logs = np.log(steps / noiseless)
    assert logs.mean() == pytest.approx(-(sigma**2) / 2.0, abs=5 * sigma / math.sqrt(n))
    # A lognormal factor of mean 1 scatters by sqrt(exp(sigma^2) - 1) = 0.31: 5 standard errors.
    assert (steps / noiseless).mean() == pytest.approx(1.0, abs=5 * 0.31 / math.sqrt(n))
    assert logs.std() == pytest.approx(sigma, rel=5 / math.sqrt(2 * n))


def test_same_seed_same_life_whatever_the_order_of_the_growths():
    growths = {"gain": Growth("drift", 0.0, noise=1e-2), "friction": Growth("linear", 1e-3, 0, 0.3)}
    one = grow(healthy_faults(), growths, 0.0, 10.0, rng(1))
    other = grow(healthy_faults(), dict(reversed(growths.items())), 0.0, 10.0, rng(1))
    np.testing.assert_array_equal(one, other)
    assert np.any(one != grow(healthy_faults(), growths, 0.0, 10.0, rng(2)))


@pytest.mark.parametrize(
    ("figures", "message"),
    [
        ({"law": "rust"}, "law = 'rust' is unknown; known: constant, linear"),
        ({"rate": math.nan}, "rate = nan"),
        ({"rate": 1e7}, r"rate = 1e\+07 1/h"),
        ({"shape": -1.0}, "shape = -1 -"),
        ({"noise": -0.1}, "noise = -0.1"),
        ({"onset": -5.0}, "onset = -5 h"),
        ({"law": "power", "shape": 1.6}, "rate = 0 h: law power"),
        ({"law": "power", "rate": 2000.0}, "shape = 0: law power"),
    ],
)
def test_impossible_growth_is_refused(figures, message):
    with pytest.raises(ValueError, match=message):
        Growth(**figures)


def test_growth_that_fits_no_component_is_refused():
    with pytest.raises(ValueError, match="unknown fault 'rust'; known: friction"):
        grow(healthy_faults(), {"rust": Growth()}, 0.0, 1.0, rng())
    with pytest.raises(ValueError, match=r"growth of friction: rate = -0\.001"):
        grow(healthy_faults(), {"friction": Growth("linear", -1e-3)}, 0.0, 1.0, rng())
    with pytest.raises(ValueError, match="hours_step = -1 h"):
        grow(healthy_faults(), {}, 0.0, -1.0, rng())
