"""Identity of an actuator."""

import math

import pytest

from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters


def test_default_is_the_built_in_example():
    description = ActuatorDescription()
    assert description.parameters == ActuatorParameters()
    assert description.sample_period == 1e-4
    assert description.actuator_id
    assert description.serial_number


@pytest.mark.parametrize("period", [0.0, -1e-4, 1.5, math.nan, math.inf])
def test_impossible_period_is_refused(period):
    with pytest.raises(ValueError, match=r"sample_period = .* s is outside \[1e-09, 1\] s"):
        ActuatorDescription(sample_period=period)
