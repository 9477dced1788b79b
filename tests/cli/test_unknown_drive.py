# SPDX-License-Identifier: Apache-2.0
"""A drive with an unknown controller on the command line, from calibration to prognosis."""

import json
from pathlib import Path
from typing import Any

import pytest

ACTUATOR = "serial_number: U-1\nsample_period: 1e-3\ndrive: unknown\n"
CASES = {
    "healthy": (),
    "worn": ("--fault", "friction=0.4"),
    "weak": ("--cause", "torque_constant=-0.15"),
}


@pytest.fixture(scope="module")
def folder(ema, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return calibrated healthy bags of three days, and a test of each case a month later."""
    path = tmp_path_factory.mktemp("unknown")
    (path / "unit.yaml").write_text(ACTUATOR)
    of_unit = ("--actuator", path / "unit.yaml", "--current-noise", "0.05", "--cycles", "4")
    days = [path / f"day{day}.mcap" for day in (1, 2, 3)]
    for day, bag in enumerate(days, 1):
        dated = ("--start", f"2026-01-0{day}", "--seed", day, "-o", bag)
        assert ema("simulate", *of_unit, *dated).exit_code == 0
    for number, (name, change) in enumerate(CASES.items(), 1):
        dated = ("--start", f"2026-02-0{number}", "--seed", 10 + number)
        output = ("-o", path / f"{name}.mcap")
        assert ema("simulate", *of_unit, *change, *dated, *output).exit_code == 0
    made = ema("calibrate", *days, "-o", path / "calibration.yaml")
    assert made.exit_code == 0
    assert "of flap (controller not modelled) from 3 records on 3 days" in made.stdout
    assert "would show on a day that has healthy records" in made.stdout
    return path


def options(folder: Path) -> tuple[str, Path]:
    return "--calibration", folder / "calibration.yaml"


def quantities(estimate: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {quantity["name"]: quantity for quantity in estimate["comparison"]["quantities"]}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "exit_code", "verdict"),
    [("healthy", 0, "valid"), ("worn", 3, "departed"), ("weak", 3, "departed")],
)
def test_record_ends_with_3_if_anything_has_changed(ema, folder, case, exit_code, verdict):
    result = ema("estimate", folder / f"{case}.mcap", *options(folder), "--json")
    assert result.exit_code == exit_code
    (estimate,) = json.loads(result.stdout)
    assert (estimate["verdict"], estimate["valid"]) == (verdict, True)
    assert estimate["faults"]["gain"] is None


@pytest.mark.slow
def test_friction_and_torque_per_ampere_are_estimated(ema, folder):
    (worn,), (weak,) = (
        json.loads(ema("estimate", folder / f"{name}.mcap", *options(folder), "--json").stdout)
        for name in ("worn", "weak")
    )
    # Friction of 1.8 times the healthy one, within the 10 % promised for any joint: the cycles of
    # one second are short, and part of the friction of this drive follows the load.
    assert worn["faults"]["friction"] == pytest.approx(0.4, abs=0.09)
    assert quantities(worn)["torque_per_ampere"]["judgement"] == "unchanged"
    assert quantities(weak)["torque_per_ampere"]["change"] == pytest.approx(-0.15, abs=0.02)
    assert quantities(weak)["friction"]["judgement"] == "unchanged"
    (cause,) = weak["causes"]
    assert cause["name"] == "torque_constant"
    assert cause["value"] == pytest.approx(-0.15, abs=0.02)


@pytest.mark.slow
def test_prognosis_and_report_name_what_has_changed(ema, folder):
    for case, words in (
        ("worn", "Coulomb friction rose"),
        ("weak", "Torque per unit of effort fell"),
    ):
        bag = folder / f"{case}.mcap"
        result = ema("predict", bag, *options(folder), "--hours-per-cycle", "10")
        assert result.exit_code == 3
        assert words in result.stdout
        result = ema("report", bag, *options(folder), "-o", folder / f"{case}.html")
        assert result.exit_code == 3
        assert "Well" not in result.stdout
        assert words in (folder / f"{case}.html").read_text()
    healthy = folder / "healthy.mcap"
    result = ema("predict", healthy, *options(folder), "--hours-per-cycle", "10")
    assert result.exit_code == 0
    assert "level OK" in result.stdout
    result = ema("report", healthy, *options(folder), "-o", folder / "healthy.html")
    assert result.exit_code == 0
    assert result.stdout.startswith("Well: No quantity has changed")


@pytest.mark.slow
def test_archive_gives_the_same_estimates_as_the_command(ema, folder, tmp_path):
    for name in ("calibration.yaml", "worn.mcap", "healthy.mcap"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    archive = tmp_path / "archive"
    assert ema("archive", "scan", archive, tmp_path).exit_code == 0
    ran = ema("archive", "run", archive, "--executor", "threads", "--workers", "1")
    assert ran.exit_code == 0, ran.output
    sql = "select start_ns, verdict, friction from estimates order by start_ns"
    rows = json.loads(ema("archive", "query", archive, sql, "--json").stdout)
    estimates = [
        json.loads(ema("estimate", folder / f"{name}.mcap", *options(folder), "--json").stdout)[0]
        for name in ("healthy", "worn")
    ]
    assert [item["verdict"] for item in rows] == [item["verdict"] for item in estimates]
    assert [item["friction"] for item in rows] == [item["faults"]["friction"] for item in estimates]


@pytest.mark.slow
def test_plot_is_refused_because_there_is_no_model(ema, folder):
    bag = folder / "worn.mcap"
    drawn = ema("plot", bag, *options(folder), "--window", "0", "-o", folder / "fit.png")
    assert drawn.exit_code == 1
    assert (
        "a calibration for an unknown drive, which has no model to compare or draw" in drawn.stderr
    )
    assert "use `ema estimate` or `ema report`" in drawn.stderr


@pytest.mark.slow
def test_calibration_of_a_modelled_drive_is_refused(ema, folder, tmp_path):
    (tmp_path / "worn.mcap").write_bytes((folder / "worn.mcap").read_bytes())
    refused = ema("estimate", tmp_path / "worn.mcap")
    assert refused.exit_code == 3
    assert "drive = unknown, but the calibration is of a known drive" in refused.stdout
    assert "`ema calibrate HEALTHY_BAG -o FILE`" in refused.stdout
