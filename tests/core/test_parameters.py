# SPDX-License-Identifier: Apache-2.0
"""Settings and actuator parameters: impossible values are refused, and coupled ones are named."""

import dataclasses
import math
from dataclasses import dataclass, field, fields, replace
from typing import Any, cast

import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters, constants
from ema_core.quantity import Checked, flag, quantity, text

FIELDS = {item.name: item for item in dataclasses.fields(ActuatorParameters)}


@pytest.mark.parametrize("name", FIELDS)
def test_value_out_of_range_is_refused_by_name_value_unit_and_range(name):
    metadata = FIELDS[name].metadata
    lowest, highest = metadata["range"]
    for value in (lowest - 7.0, 3.0 * highest):
        with pytest.raises(ValueError, match="outside") as refused:
            ActuatorParameters().replace({name: value})
        printed, unit = str(refused.value), f" {metadata['unit']}".removesuffix(" -")
        assert printed.startswith(f"{name} = {value:g}{unit} is")
        assert f"[{lowest:g}, {highest:g}]{unit}" in printed
        assert metadata["description"] in printed


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
def test_plausible_mistakes_of_unit_or_ratio_are_named(name, value, meant):
    with pytest.raises(ValueError, match="is outside") as refused:
        ActuatorParameters().replace({name: value})
    assert meant in str(refused.value)


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


@dataclass(frozen=True)
class Oven(Checked):
    temperature: float = quantity(180.0, "degC", 20.0, 300.0, "temperature inside")
    trays: int = quantity(2, "-", 0, 4, "trays in use")
    mode: str = text("fan", "where the heat comes from", ("fan", "grill"))
    label: str = text("", "what is in it")
    notes: list[str] = field(default_factory=list)


def test_defaults_are_valid_and_fields_carry_their_documentation():
    oven = Oven()
    assert (oven.temperature, oven.trays, oven.mode, oven.label) == (180.0, 2, "fan", "")
    metadata = {item.name: dict(item.metadata) for item in fields(Oven)}
    assert metadata["temperature"] == {
        "unit": "degC",
        "range": (20.0, 300.0),
        "description": "temperature inside",
        "named": "",
        "usual": None,
        "shown": None,
    }
    assert metadata["mode"]["choices"] == ("fan", "grill")
    assert metadata["notes"] == {}


@pytest.mark.parametrize("value", [20, 20.0, np.float32(20.0), np.int64(20)])
def test_number_is_converted_to_the_type_of_its_default(value: Any):
    oven = Oven(temperature=value, trays=float(value) / 5)  # type: ignore[arg-type]
    assert type(oven.temperature) is float
    assert type(oven.trays) is int
    assert (oven.temperature, oven.trays) == (20.0, 4)


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ({"temperature": 300.1}, ["temperature = 300.1 degC", "[20, 300] degC", "inside"]),
        ({"temperature": math.nextafter(20.0, 0.0)}, ["temperature", "outside", "[20, 300] degC"]),
        ({"temperature": math.nan}, ["temperature = nan", "finite number in [20, 300] degC"]),
        ({"temperature": math.inf}, ["temperature = inf", "finite"]),
        ({"temperature": "hot"}, ["temperature = 'hot'", "finite number"]),
        ({"temperature": None}, ["temperature = None", "finite number"]),
        ({"temperature": 1j}, ["temperature = 1j", "finite number"]),
        ({"temperature": [2.0]}, ["temperature = [2.0]", "finite number"]),
        ({"temperature": 10**400}, ["temperature", "finite number"]),
        ({"trays": True}, ["trays = True", "finite number"]),
        ({"trays": 2.5}, ["trays = 2.5", "whole number"]),
        ({"trays": -1}, ["trays = -1", "[0, 4]"]),
        ({"mode": "steam"}, ["mode = 'steam'", "fan, grill"]),
        ({"mode": ""}, ["mode = ''", "fan, grill"]),
        ({"label": 3}, ["label = 3", "string"]),
    ],
)
def test_impossible_value_is_refused_by_name_value_unit_and_range(
    values: dict[str, Any], texts: list[str]
):
    with pytest.raises(ValueError, match="=") as refused:
        Oven(**values)
    assert all(item in str(refused.value) for item in texts), refused.value
    with pytest.raises(ValueError, match="="):
        replace(Oven(), **values)


@dataclass(frozen=True)
class Switch(Checked):
    on: bool = flag(False, "whether it is on")


def test_flag_accepts_only_true_and_false():
    assert Switch().on is False
    assert Switch(True).on is True
    for value in (1, "yes", None):
        with pytest.raises(ValueError, match=r"on = .*: expected true or false"):
            Switch(cast(bool, value))


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
def test_parameter_changed_without_its_coupled_parameters_is_named(changed, named):
    remarks = described(**changed).remarks
    assert {remark.split(" = ")[0] for remark in remarks} == named
    assert all("usually " in remark for remark in remarks)


def test_torque_and_voltage_constant_of_a_sinusoidal_motor_differ_by_half_of_root_three():
    """k_t = 3/2 P lambda for the amplitude, k_e = sqrt(3) P lambda between two terminals."""
    ratio = 1.5 / math.sqrt(3.0)
    k_t = ratio * BUILT_IN.parameters.k_e
    assert described("field_oriented", k_t=k_t, T_max=22.5 * k_t).remarks == ()
    [remark] = described("field_oriented").remarks
    assert remark.startswith("k_t / k_e = 1, usually 0.779 to 0.953")


def test_motor_that_cannot_overcome_its_friction_is_refused_with_its_torque():
    """V_max / R_s exceeds I_max, and I_max k_t = 22.5 A * 0.0752 N.m/A exceeds T_max."""
    with pytest.raises(ValueError, match=r"f_sm \+ f_su = 2.07 N.m: .* produces at most 1.69 N.m"):
        described(f_sm=2.0)
