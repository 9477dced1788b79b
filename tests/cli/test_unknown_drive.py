"""A drive whose controller is unknown on the command line, from calibration to prognosis."""

import json
from pathlib import Path

import pytest

ACTUATOR = "serial_number: U-1\nsample_period: 1e-3\ndrive: unknown\n"


@pytest.fixture
def folder(ema, tmp_path: Path) -> Path:
    (tmp_path / "unit.yaml").write_text(ACTUATOR)
    of_unit = ("--actuator", tmp_path / "unit.yaml", "--current-noise", "0.05")
    healthy, case = tmp_path / "healthy.mcap", tmp_path / "case.mcap"
    assert ema("simulate", *of_unit, "--cycles", "4", "-o", healthy).exit_code == 0
    worn = ("--fault", "friction=0.4", "--cause", "torque_constant=-0.15", "--cycles", "2")
    assert ema("simulate", *of_unit, *worn, "--seed", "1", "-o", case).exit_code == 0
    made = ema("calibrate", healthy, "-o", tmp_path / "calibration.yaml")
    assert made.exit_code == 0
    assert "drive unknown" in made.stdout
    return tmp_path


@pytest.mark.slow
def test_estimate_and_prognosis_of_an_unknown_drive(ema, folder: Path):
    case, calibration = folder / "case.mcap", ("--calibration", folder / "calibration.yaml")
    result = ema("estimate", case, *calibration, "--json")
    assert result.exit_code == 0
    for one in json.loads(result.stdout):
        assert one["faults"]["friction"] == pytest.approx(0.4, abs=0.02)
        assert one["faults"]["gain"] is None
        torque = next(cause for cause in one["causes"] if cause["name"] == "torque_constant")
        assert torque["value"] == pytest.approx(-0.15, abs=0.02)
    told = ema("prognose", case, *calibration, "--hours-per-cycle", "10")
    assert told.exit_code == 0
    assert "torque per ampere" in told.stdout
    assert ema("report", case, *calibration, "-o", folder / "report.html").exit_code == 0


@pytest.mark.slow
def test_what_has_no_model_is_refused_and_a_known_drive_does_not_serve(ema, folder: Path):
    case, calibration = folder / "case.mcap", ("--calibration", folder / "calibration.yaml")
    drawn = ema("plot", case, *calibration, "--window", "0", "-o", folder / "fit.png")
    assert drawn.exit_code == 1
    assert "calibration of an unknown drive, which has no model" in drawn.stderr
    (folder / "calibration.yaml").rename(folder / "elsewhere.yaml")
    refused = ema("estimate", case)
    assert refused.exit_code == 3
    assert "drive = unknown" in refused.stdout
