# SPDX-License-Identifier: Apache-2.0
"""``ema new-actuator``: a description from the values of a data sheet."""

import math

import pytest

from ema_core.description import ActuatorDescription
from ema_core.parameters import RPM
from ema_ros.actuator_file import load_description

# The spoiler of docs/describe-actuator.md; - stands for a value missing from its data sheet.
FIGURES = {
    "gear": "800", "lead": "-", "supply": "270",
    "kv": "28", "torque-constant": "0.34", "resistance": "1.6",
    "inductance": "4.2", "pole-pairs": "4", "current": "15", "speed": "7000",
    "inertia": "-", "sample-rate": "2000",
}  # fmt: skip
OPTIONS = [
    word
    for name, value in FIGURES.items()
    for word in (f"--{name}", value)
    if value != "-" and name != "torque-constant"
]


def test_answers_and_options_give_a_description_with_sources(ema, tmp_path):
    asked, by_options = tmp_path / "asked.yaml", tmp_path / "given.yaml"
    answers = "".join(f"{value}\n" for value in FIGURES.values())
    result = ema("new-actuator", "--serial-number", "0815", "-o", asked, typed=answers)
    assert result.exit_code == 0, result.output
    printed = ema("new-actuator", "--serial-number", "0815", *OPTIONS, "-o", by_options)
    assert printed.exit_code == 0, printed.output
    unknown = printed.stdout.partition("from the example: ")[2].strip().split(", ")
    example = ActuatorDescription().parameters
    for file, k_t in ((asked, 0.34), (by_options, 1.0 / (28.0 * RPM))):
        description = load_description(file)
        p = description.parameters
        assert (description.serial_number, description.sample_period, p.V_max, p.P) == (
            "0815",
            5e-4,
            270.0,
            4,
        )
        assert (p.k_t, p.k_e, p.G_M) == pytest.approx((k_t, k_t, k_t))
        # The limit of the torque is derived from values that are given.
        assert (p.T_max, p.tau, p.L_s) == pytest.approx((15.0 * k_t, 1.0 / 800.0, 4.2e-3))
        assert p.J_m == example.J_m
        assert "ohm, resistance 1.6 ohm: " in file.read_text()
        assert "kg.m^2, example: inertia of the motor" in file.read_text()
    assert {"J_m", "f_sm"} <= set(unknown)
    assert "GAP / (J_m + J_u)" not in printed.stderr


def test_linear_actuator_is_described_in_mm_and_n(ema, tmp_path):
    file = tmp_path / "screw.yaml"
    figures = ["--gear=1", "--lead=5", "--stroke=120", "--rod-friction=40", "--mass=20"]
    figures.append("--rod-play=0.02")
    result = ema("new-actuator", *figures, "-o", file)
    assert result.exit_code == 0, result.output
    p = load_description(file).parameters
    turn = 2.0 * math.pi
    assert (p.lead, p.theta_stop / turn, p.BLK / turn) == pytest.approx((0.005, 12.0, 0.004))
    assert (p.f_sm, p.f_su * turn, p.J_u * turn**2) == pytest.approx((0.0, 0.2, 20.0 * 0.005**2))
    assert "rod-friction 40 N: static friction, user" in file.read_text()
    result = ema("new-actuator", "--stroke", "120", "--replace", "-o", file)
    assert (result.exit_code, "needs the travel [m]" in result.stderr) == (1, True)


def test_contradicting_values_are_refused(ema, tmp_path):
    file = tmp_path / "wrong.yaml"
    result = ema("new-actuator", "--kv", "28", "--torque-constant", "0.5", "-o", file)
    assert (result.exit_code, file.exists()) == (1, False)
    assert "kv 28 rpm/V gives 0.341" in result.stderr
