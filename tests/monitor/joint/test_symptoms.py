# SPDX-License-Identifier: Apache-2.0
"""Model-free figures depart only beyond the scatter of the healthy records."""

import numpy as np
import pytest

from ema_monitor.joint.symptoms import SymptomComparer

from .baselines import HEALTHY, SEPARATE, baseline_of, record_of


@pytest.mark.parametrize("scatter", [0.005, 0.02, 0.1, 0.3])
def test_healthy_figures_do_not_depart_for_any_scatter(scatter):
    """The scatter is up to 20 times the prior median of the tracking error of repeating motion."""
    rng = np.random.default_rng(11)
    alarms = 0
    for _ in range(10):
        records = [{"figures": drawn_figures(rng, scatter)} for _ in range(9)]
        comparer = SymptomComparer(baseline_of(records=records))
        assert comparer.baseline.repeats
        for number in range(20):
            record = record_of(HEALTHY, day=SEPARATE + number, figures=drawn_figures(rng, scatter))
            alarms += bool(comparer.figures(record, 0.0).figures)
    # Two figures at 0.1 % each in 200 records are 0.4 alarms.
    assert alarms <= 2


def test_figure_beyond_the_scatter_of_the_healthy_records_departs():
    rng = np.random.default_rng(12)
    records = [{"figures": drawn_figures(rng, 0.01)} for _ in range(9)]
    comparer = SymptomComparer(baseline_of(records=records))
    record = record_of(HEALTHY, figures={"error_scatter": -2.8, "error_roughness": -5.0})
    (figure,) = comparer.figures(record, 0.0).figures
    assert figure.name == "error_scatter"
    assert figure.ratio == pytest.approx(np.exp(0.2), rel=0.02)


def drawn_figures(rng: np.random.Generator, scatter: float) -> dict[str, float]:
    """Return logarithms of scatter and roughness of the tracking error."""
    scattered = scatter * rng.standard_normal(2)
    return {"error_scatter": -3.0 + scattered[0], "error_roughness": -5.0 + scattered[1]}
