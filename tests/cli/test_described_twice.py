# SPDX-License-Identifier: Apache-2.0
"""``--actuator FILE`` and the description in a bag: a warning, or ``--accept-defects``."""

import json
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def bag(ema, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("bag") / "case.mcap"
    assert ema("simulate", "-o", path).exit_code == 0
    return path


@pytest.fixture
def unit(tmp_path: Path) -> Path:
    path = tmp_path / "unit.yaml"
    path.write_text("serial_number: '4711'\nparameters: {R_s: 1.9}\n")
    return path


def test_description_in_the_bag_takes_precedence_and_the_warning_names_the_differences(
    ema, bag, unit
):
    result = ema("info", bag, "--actuator", unit)
    assert result.exit_code == 0
    for part in (
        f"{unit} is ignored",
        "R_s 2.13 ohm in the bag, 1.9 ohm in the file",
        "serial_number SIM-0001 in the bag, 4711 in the file",
        "--accept-defects",
    ):
        assert part in result.output
    assert "tau" not in result.output.splitlines()[-1]


def test_forced_calibration_belongs_to_the_unit_in_the_file(
    ema, bag: Path, unit: Path, tmp_path: Path
):
    output = tmp_path / "c.yaml"
    forced = ("--actuator", unit, "--accept-defects", "-o", output)
    assert ema("calibrate", bag, *forced).exit_code == 0
    assert "'4711'" in output.read_text()
    estimate = ema("estimate", bag, "--calibration", output, "--json")
    assert "4711" in json.loads(estimate.stdout)[0]["reason"]


def test_file_that_agrees_with_the_bag_gives_no_warning(ema, bag: Path, tmp_path: Path):
    same = tmp_path / "same.yaml"
    same.write_text("actuator_id: flap\n")
    result = ema("estimate", bag, "--actuator", same)
    assert (result.exit_code, result.stderr) == (0, "")


@pytest.mark.parametrize(
    "arguments",
    [
        ("simulate", "--actuator", "FILE", "-o", "OUT"),
        ("certify", "--actuator", "FILE", "--command", "circle"),
        ("info", "BAG", "--actuator", "FILE", "--accept-defects"),
        ("calibrate", "BAG", "--actuator", "FILE", "--accept-defects", "-o", "OUT"),
    ],
)
def test_contradicting_parameters_are_named(ema, bag: Path, tmp_path: Path, arguments):
    file = tmp_path / "torque.yaml"
    file.write_text("parameters: {G_M: 0.2}\n")
    output = tmp_path / ("out.yaml" if "calibrate" in arguments else "out.mcap")
    places = {"FILE": file, "BAG": bag, "OUT": output}
    result = ema(*(places.get(argument, argument) for argument in arguments))
    assert "G_M / k_t = 2.66, usually 0.7 to 1.3" in result.output
