# SPDX-License-Identifier: Apache-2.0
"""A healthy record is doubtful as rarely as stated, even if the scatter is poorly known."""

import numpy as np
import pytest

from ema_monitor.joint.single import DOUBT, SIGNIFICANCE, Observation, SingleTest, scatter_of


@pytest.mark.parametrize("days", [1, 2, 3, 8])
def test_healthy_records_are_doubtful_as_rarely_as_their_probability_states(days):
    """This holds also after one day, when the prediction has wide tails."""
    rng = np.random.default_rng(days)
    healthy = [
        Observation(float(value), 0.004, day)
        for day in range(days)
        for value in 0.01 * rng.standard_normal() + 0.006 * rng.standard_normal(3)
    ]
    scatter = scatter_of(healthy, 0.01)
    prediction = scatter.predict(0.004**2)
    # Equally probable records.
    values = [prediction.quantile(share) for share in (np.arange(2000) + 0.5) / 2000]
    tests = [SingleTest(value, prediction) for value in values]
    doubtful, significant = (
        np.mean([getattr(test, name) for test in tests])
        for name in ("is_doubtful", "is_significant")
    )
    assert doubtful == pytest.approx(DOUBT - SIGNIFICANCE, abs=1e-3)
    assert significant == pytest.approx(SIGNIFICANCE, abs=1e-3)
