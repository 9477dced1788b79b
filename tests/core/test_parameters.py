"""The definition of an actuator: values, what is refused, and what kernels get."""

import dataclasses
import math

import numpy as np
import pytest

from ema_core.parameters import ActuatorParameters, constants

FIELDS = {item.name: item for item in dataclasses.fields(ActuatorParameters)}


@pytest.mark.parametrize("name", FIELDS)
def test_value_out_of_range_is_refused_by_name_value_unit_and_range(name):
    metadata = FIELDS[name].metadata
    lowest, highest = metadata["range"]
    for value in (lowest - 7.0, 3.0 * highest):
        with pytest.raises(ValueError, match="outside") as refused:
            ActuatorParameters().replace({name: value})
        message = str(refused.value)
        assert message.startswith(f"{name} = {value:g} {metadata['unit']} ")
        assert f"[{lowest:g}, {highest:g}] {metadata['unit']}" in message
        assert metadata["description"] in message


@pytest.mark.parametrize(
    ("name", "value", "meant"),
    [
        ("tau", 500, "usually 0.0001 to 0.1: 0.002 = 1/500 was probably meant"),
        ("L_s", 0.72, "usually 1e-05 to 0.02 H: 0.00072 H = 0.72 mH was probably meant"),
        ("omega_max", 8000, "837.8 rad/s = 8000 rpm was probably meant"),
        ("R_s", 2130, "2.13 ohm = 2130 mohm was probably meant"),
        ("k_t", 75.2, "0.0752 N.m/A = 75.2 mN.m/A was probably meant"),
        ("J_m", 130, "1.3e-05 kg.m^2 = 130 g.cm^2 was probably meant"),
        ("J_u", 0.12, "1.2e-05 kg.m^2 = 0.12 kg.cm^2 was probably meant"),
    ],
)
def test_plausible_slips_of_unit_or_ratio_are_named(name, value, meant):
    with pytest.raises(ValueError, match="is outside") as refused:
        ActuatorParameters().replace({name: value})
    assert meant in str(refused.value)


@pytest.mark.parametrize(
    ("name", "value"),
    [(name, math.nan) for name in FIELDS]
    + [
        (name, value)
        for name in ("R_s", "P")
        for value in (math.inf, -math.inf, np.nan, "2", None, True, 1j, [2.0])
    ],
)
def test_what_is_no_finite_number_is_refused(name, value):
    lowest, highest = FIELDS[name].metadata["range"]
    with pytest.raises(ValueError, match="expected a finite number") as refused:
        ActuatorParameters().replace({name: value})
    message = str(refused.value)
    assert message.startswith(f"{name} = {value!r}")
    assert f"[{lowest:g}, {highest:g}] {FIELDS[name].metadata['unit']}" in message


def test_constants_are_referred_to_the_motor_shaft():
    p = ActuatorParameters()
    control, motor, mechanics = constants(p)
    C = 30 / math.pi * 1e-6 + 4.5e-7
    # J, C, f_s, f_d, half backlash, tau, end stop
    assert mechanics == pytest.approx(
        (2.5e-5, C, 0.1689, 0.1689 / 2, 2.5e-3, 0.002, 600.0), rel=1e-15
    )
    assert control == (1e5, 0.05, 0.0, 0.0, p.omega_max, 0.0752, 22.5)
    assert (motor.N_a, motor.N_b, motor.N_c, motor.zeta, motor.phi) == (1.0, 1.0, 1.0, 0.0, 0.0)
