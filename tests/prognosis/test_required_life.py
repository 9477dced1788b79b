"""When samples of the faults to come end a life, and by what."""

import numpy as np
import pytest

from ema_core.faults import FAULT_NAMES, healthy_faults
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.requirements.required_life import limit_passage, lives_by_requirements
from ema_monitor.prognosis.requirements.requirements import REQUIREMENTS, RequirementLimits


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


@pytest.fixture
def failures():
    """Free play fails first in 60 of 100 samples, the torque margin in the others."""
    found = {name: np.full(100, np.inf) for name in REQUIREMENTS}
    found["free_play"] = np.linspace(100.0, 199.0, 100)
    found["torque_margin"] = np.where(np.arange(100) < 60, 500.0, 50.0)
    return found


def test_first_failure_is_the_earliest_in_each_sample(failures):
    lives, overall, dominant = lives_by_requirements(failures, RequirementLimits(), 1000.0)
    assert dominant == "free_play"
    assert overall.criterion == lives["free_play"].criterion == "free play exceeds 0.0005 rad"
    assert (overall.hours_05, overall.hours_50, overall.hours_95) == (50.0, 109.0, 154.0)
    assert (lives["free_play"].hours_50, lives["torque_margin"].hours_50) == (149.0, 500.0)


def test_life_is_not_known_when_less_than_half_of_the_samples_fail(failures):
    failures["free_play"][:] = np.inf
    failures["torque_margin"] = np.where(np.arange(100) < 51, np.inf, 50.0)
    lives, overall, dominant = lives_by_requirements(failures, RequirementLimits(), 1000.0)
    for life in (*lives.values(), overall):
        assert not life.known
        assert np.isnan(life.hours_50)
        assert life.reason == "not within the 1000 h looked ahead"
    assert dominant == ""
