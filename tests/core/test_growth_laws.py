# SPDX-License-Identifier: Apache-2.0
"""Growth laws: increments compared with Runge-Kutta, and the hours until a limit."""

import numpy as np
import pytest

from ema_core.growth_laws import hours_until, increment

RATES_OF_CHANGE = {
    "linear": lambda x, a, b: a,
    "drift": lambda x, a, b: a,
    "exponential": lambda x, a, b: a * (x + b),
    "archard": lambda x, a, b: a * (1.0 + b * x),
    "self_heating": lambda x, a, b: a * np.exp(b * x),
    "power": lambda x, c, p: p / c * x ** (1.0 - 1.0 / p),
}
FIGURES = [
    ("linear", 1e-3, 0.0),
    ("drift", 1e-3, 0.0),
    ("exponential", 2e-3, 0.05),
    ("archard", 3e-4, 3.0),
    ("archard", 3e-4, 0.0),
    ("self_heating", 1.5e-4, 6.0),
    ("self_heating", 1.5e-4, 0.0),
    ("power", 2000.0, 1.6),
]
X = np.array([0.01, 0.1, 0.2])


@pytest.mark.parametrize(("law", "rate", "shape"), FIGURES)
def test_increment_solves_the_equation_of_its_law(law, rate, shape):
    n, hours = 1000, 200.0
    h, x = hours / n, X.copy()
    slope = RATES_OF_CHANGE[law]
    for _ in range(n):
        k1 = slope(x, rate, shape)
        k2 = slope(x + h / 2 * k1, rate, shape)
        k3 = slope(x + h / 2 * k2, rate, shape)
        k4 = slope(x + h * k3, rate, shape)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    # Fourth order with steps of 0.2 h and time scales above 100 h: truncation far below 1e-10.
    np.testing.assert_allclose(increment(law, X, rate, shape, hours), x - X, rtol=0, atol=1e-10)


@pytest.mark.parametrize(("law", "rate", "shape"), FIGURES)
def test_growth_over_the_hours_until_a_limit_reaches_the_limit(law, rate, shape):
    limit = 0.25
    hours = hours_until(law, X, rate, shape, limit)
    assert np.all(hours > 0.0)
    np.testing.assert_allclose(X + increment(law, X, rate, shape, hours), limit, rtol=1e-12)


def test_self_heating_runs_away_within_finite_hours():
    a, b = 1.5e-4, 6.0
    assert increment("self_heating", 0.0, a, b, 1.0 / (a * b)) == np.inf
    assert np.isfinite(increment("self_heating", 0.0, a, b, 0.99 / (a * b)))
