"""Coupled parameters: a change of one that leaves the others is named, a whole actuator is not."""

import math
from dataclasses import replace

import pytest

from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters

BUILT_IN = ActuatorDescription()


def described(drive: str = "six_step", **parameters: float) -> ActuatorDescription:
    return replace(BUILT_IN, drive=drive, parameters=ActuatorParameters().replace(parameters))


def test_built_in_actuator_has_no_remarks():
    assert BUILT_IN.remarks == ()


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"k_t": 0.03}, {"k_t / k_e", "T_max / (k_t I_max)", "G_M / k_t"}),
        ({"k_t": 0.03, "k_e": 0.03}, {"T_max / (k_t I_max)", "G_M / k_t"}),
        (
            {"J_m": 2e-3},
            {"(J_m + J_u) omega_max / T_max", "GAP / (J_m + J_u)", "G_prop tau (J_m + J_u) / GAP"},
        ),
        ({"V_max": 12.0}, {"V_max / (k_e omega_max)", "R_s I_max / V_max"}),
        ({"V_max": 270.0}, {"V_max / (k_e omega_max)"}),
        ({"h_b": 5.0}, {"h_b / I_max", "k_e h_b / (f_sm + f_su)"}),
        ({"tau": 0.02}, {"G_prop tau (J_m + J_u) / GAP"}),
        ({"f_sm": 0.8}, {"(f_sm + f_su) / T_max"}),
        ({"C_m": 1e-2}, {"(C_m + C_u) omega_max / T_max"}),
        ({"L_s": 5e-5}, {"V_max / (8 L_s h_b)"}),
    ],
)
def test_parameter_that_is_changed_alone_is_named_with_its_couplings(changed, named):
    found = described(**changed).remarks
    assert {remark.split(" = ")[0] for remark in found} == named
    assert all("usually " in remark for remark in found)


def test_torque_and_voltage_constant_of_a_sinusoidal_motor_differ_by_half_of_root_three():
    """k_t = 3/2 P lambda for the amplitude, k_e = sqrt(3) P lambda between two terminals."""
    ratio = 1.5 / math.sqrt(3.0)
    k_t = ratio * BUILT_IN.parameters.k_e
    assert described("field_oriented", k_t=k_t, T_max=22.5 * k_t).remarks == ()
    [remark] = described("field_oriented").remarks
    assert remark.startswith("k_t / k_e = 1, usually 0.779 to 0.953")


def test_motor_that_is_too_weak_for_its_friction_is_refused_with_its_torque():
    """V_max / R_s = 22.54 A is more than I_max here: 22.5 A of 0.0752 N.m/A, and T_max is less."""
    with pytest.raises(ValueError, match=r"f_sm \+ f_su = 2.07 N.m: .* makes 1.69 N.m at most"):
        described(f_sm=2.0)
