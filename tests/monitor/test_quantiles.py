# SPDX-License-Identifier: Apache-2.0
"""Quantiles stated by an estimate."""

from statistics import NormalDist

import numpy as np
import pytest

from ema_core.faults import ECCENTRICITY_PHASE, N_FAULTS
from ema_monitor.identification.quantiles import LEVELS, quantiles_of

WIDTH = np.full(N_FAULTS, 0.01)


def test_quantiles_of_one_explanation_are_normal():
    """The distribution is divided into 200 parts, which costs 0.3 % of sigma at 5 %."""
    quantiles = quantiles_of(np.ones(1), np.full((1, N_FAULTS), 0.5), WIDTH[None])
    expected = [NormalDist(0.5, 0.01).inv_cdf(level) for level in LEVELS]
    assert quantiles[:, 0] == pytest.approx(expected, abs=3e-5)


def test_quantiles_of_two_explanations_have_their_probability():
    """Each explanation has two equally likely widths."""
    weights, places = np.array([0.7, 0.3]), np.array([0.48, 0.51])
    quantiles = quantiles_of(
        weights, np.tile(places[:, None], N_FAULTS), np.stack([WIDTH, 3.0 * WIDTH])
    )
    sums = [
        [NormalDist(p, s).cdf(x) for p in places for s in (0.01, 0.03)] for x in quantiles[:, 0]
    ]
    below = np.array(sums) @ np.repeat(weights / 2.0, 2)
    assert below == pytest.approx(LEVELS, abs=1e-3)


def test_interval_is_limited_by_the_range():
    quantiles = quantiles_of(np.ones(1), np.zeros((1, N_FAULTS)), WIDTH[None])
    assert np.all(np.delete(quantiles, ECCENTRICITY_PHASE, axis=1)[0] == 0.0)
    assert quantiles[0, ECCENTRICITY_PHASE] == pytest.approx(-0.01645, abs=3e-5)
