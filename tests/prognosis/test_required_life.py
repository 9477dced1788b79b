"""When samples of the faults to come end a life."""

import numpy as np

from ema_core.faults import FAULT_NAMES, healthy_faults
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.requirements.required_life import limit_passage


def test_sample_reaches_a_fault_limit_where_its_first_component_does():
    hours = np.linspace(0.0, 100.0, 33)
    rng = np.random.default_rng(0)
    paths = np.tile(healthy_faults(), (200, 33, 1))
    ends = rng.uniform(20.0, 80.0, (2, 200))
    paths[..., FAULT_NAMES.index("gain")] -= 0.25 * hours / ends[0, :, None]
    paths[..., FAULT_NAMES.index("friction")] += 0.5 * hours / ends[1, :, None]
    found = limit_passage(paths, hours, HealthLimits())
    np.testing.assert_allclose(found, ends.min(axis=0), rtol=1e-9)
    still = np.tile(healthy_faults(), (3, 33, 1))
    assert np.all(np.isinf(limit_passage(still, hours, HealthLimits())))
    gone = still + 0.0
    gone[0, :, FAULT_NAMES.index("friction")] = 0.6
    np.testing.assert_array_equal(limit_passage(gone, hours, HealthLimits()), [0.0, np.inf, np.inf])
