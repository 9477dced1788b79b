# SPDX-License-Identifier: Apache-2.0
"""Linear actuators: parameters and results in mm and N."""

import math
from dataclasses import replace

import pytest

from ema_core.description import ActuatorDescription
from ema_core.linear import in_si, motor_shown, physical, travel_shown
from ema_core.parameters import ActuatorParameters

SCREW = {"lead": 0.005, "tau": 0.1}


def test_parameters_in_mm_and_n_equal_those_of_the_rotary_motor():
    parameters = {"theta_stop": "60 mm", "omega_max": "100 mm/s", "f_su": "200 N", "BLK": "0.02 mm"}
    converted = in_si(SCREW | parameters | {"C_u": "50 N.s/m", "J_u": "12 kg"})
    # 5 mm are 1 turn of the screw and 10 turns of the motor.
    assert converted["theta_stop"] == pytest.approx(12.0 * 2.0 * math.pi)
    assert converted["omega_max"] == pytest.approx(200.0 * 2.0 * math.pi)
    assert in_si({"lead": "5 mm"}) == {"lead": 0.005}
    assert converted["BLK"] == pytest.approx(0.04 * 2.0 * math.pi)
    # The work of a force along the lead equals the work of the torque over ten turns.
    assert converted["f_su"] * 10.0 * 2.0 * math.pi == pytest.approx(200.0 * 0.005)
    # The same holds for the kinetic energy, and for the power lost to damping.
    assert 0.5 * converted["J_u"] * converted["omega_max"] ** 2 == pytest.approx(
        0.5 * 12.0 * 0.1**2
    )
    assert converted["C_u"] * converted["omega_max"] ** 2 == pytest.approx(50.0 * 0.1**2)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"theta_stop": "60 mm"}, r"theta_stop = 60 mm needs the travel .* lead = $"),
        ({"lead": 0.0, "f_su": "40N"}, r"f_su = 40N needs the travel .* lead = 0.0$"),
        ({"lead": "5 mm", "J_u": "2 kg"}, r"J_u = 2 kg needs the gear ratio: tau = $"),
        (SCREW | {"f_su": "60 mm"}, r"f_su = 60 mm: expected a value in N.m$"),
    ],
)
def test_unit_of_the_wrong_kind_is_refused_by_name(values, words):
    with pytest.raises(ValueError, match=words):
        in_si(values)


def test_results_of_an_actuator_with_a_lead_are_in_mm_and_n():
    values = in_si(SCREW | {"f_sm": 0.0, "f_su": "200 N", "BLK": "0.02 mm"})
    screw = ActuatorDescription(parameters=ActuatorParameters().replace(values))
    assert travel_shown(screw.parameters).text(math.pi) == "2.5 mm"
    assert motor_shown(screw.parameters).text(math.pi) == "0.25 mm"
    # At k = 1, friction grows by twice its nominal value, and play by 99 times.
    assert physical("friction", 0.25, screw) == "dry friction 1.500 × nominal, +100 N"
    assert physical("backlash", 0.1, screw) == "backlash 10.900 × nominal, +0.198 mm"
    no_motor = replace(screw, drive="unknown")
    assert physical("friction", 0.25, no_motor) == "dry friction 1.500 × nominal"
    rotary = ActuatorDescription()
    assert travel_shown(rotary.parameters).text(0.0025) == "2.5 mrad"
    assert physical("friction", 0.25, rotary) == "dry friction 1.500 × nominal"
    assert physical("tracking_error", 0.25, screw) == ""
