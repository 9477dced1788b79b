# SPDX-License-Identifier: Apache-2.0
"""``ema design``: from the wanted accuracy to a command that reaches it on recorded tests."""

import json

import pytest

from ema_cli.parameters import Parameters, parameters_in
from ema_cli.rig_settings import RigSettings, save_command
from ema_core.commands import Command

RESOLUTIONS = ("current=0.005", "position=1e-6", "speed=0.05")
NOISE = (
    *("--current-noise", "0.02"),
    *(word for value in RESOLUTIONS for word in ("-p", f"resolution.{value}")),
)


@pytest.mark.long
def test_designed_command_gives_the_promised_sigma_on_recorded_tests(ema, tmp_path):
    file, healthy, case, calibration = (
        tmp_path / name for name in ("quick.yaml", "healthy.mcap", "case.mcap", "calibration.yaml")
    )
    limits = ("--travel", "0.03", "--current", "15", "--speed", "400")
    wish = ("--sigma", "friction=0.005,short_circuit_b=0.015,eccentricity=0.01,gain=0.005")
    designed = ema("design", *limits, *wish, *NOISE, "--json", "-o", file)
    assert designed.exit_code == 0
    design = json.loads(designed.stdout)
    assert design["reached"]
    assert design["command"]["duration"] <= 0.3
    for name, demand in design["demands"].items():
        assert demand <= design["limits"][name] * 1.002
    window = command = ("--params", file)
    assert ema("simulate", *command, *NOISE, "--cycles", "12", "-o", healthy).exit_code == 0
    assert ema("calibrate", healthy, *window, "-o", calibration).exit_code == 0
    promised = {item["name"]: item for item in design["certificate"]["faults"]}
    for number, (name, value) in enumerate(
        {"friction": 0.2, "short_circuit_b": 0.1, "eccentricity": 0.2, "gain": 0.6}.items()
    ):
        fault = ("--fault", f"{name}={value}", "--seed", str(100 + number))
        assert ema("simulate", *command, *NOISE, *fault, "--replace", "-o", case).exit_code == 0
        result = ema("estimate", case, *window, "--calibration", calibration, "--json")
        assert result.exit_code == 0
        [estimate] = json.loads(result.stdout)
        # The promise holds for the least favourable actuator; the calibration is of another one.
        assert estimate["sigma"][name] <= 1.25 * promised[name]["sigma"]
        assert estimate["faults"][name] == pytest.approx(
            value, abs=3.0 * max(promised[name]["sigma"], promised[name]["error"])
        )


@pytest.mark.long
def test_next_steps_that_are_printed_work_with_the_acquisition_of_the_design(
    ema, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    described = tmp_path / "blind.yaml"
    described.write_text("acquisition: {current: filtered, current_filter: 2e-4, speed: false}")
    acquired = ("--sample-rate", "1000", "--actuator", "blind.yaml")
    wish = ("--travel", "0.03", "--current", "15", "--sigma", "friction=0.03,gain=0.02")
    designed = ema("design", *wish, *acquired, *NOISE[:2], "-o", "quick.yaml")
    assert designed.exit_code == 0, designed.output
    simulate, calibrate, estimate = [
        line.split()[1:] for line in designed.stdout.splitlines() if line.startswith("  ema ")
    ]
    assert ema(*simulate, *NOISE[:2]).exit_code == 0
    assert ema(*calibrate).exit_code == 0
    case = [word.replace("healthy", "case") for word in simulate if word not in ("--cycles", "12")]
    assert ema(*case, *NOISE[:2], "--fault", "friction=0.3").exit_code == 0
    [result] = json.loads(ema(*estimate, "--json").stdout)
    assert result["valid"], result
    # The wanted standard deviation is 0.03.
    assert result["faults"]["friction"] == pytest.approx(0.3, abs=0.09)


@pytest.mark.long
def test_impossible_request_names_fault_best_sigma_and_limit_and_writes_nothing(ema, tmp_path):
    file = tmp_path / "quick.yaml"
    wish = ("--travel", "0.004", "--current", "5", "--longest", "0.15", "--sigma", "gain=0.0008")
    result = ema("design", *wish, "-o", file)
    assert result.exit_code == 3
    assert "gain: sigma 0.0008 is not reached, at best 0.0" in result.stdout
    assert not file.exists()


def test_command_is_read_from_its_file_exactly_as_written(tmp_path):
    file = tmp_path / "quick.yaml"
    swing = Command("swing", amplitude=0.0075, duration=0.21, start_frequency=4.5)
    save_command(file, swing, "made by a test\nof two lines")
    bench = RigSettings.of(Parameters(dict(parameters_in(file, "actuator"))))
    assert vars(bench.command) == vars(swing)
    assert dict(parameters_in(file, "monitor")) == {"window_s": 0.21}
    assert file.read_text().startswith("# made by a test\n# of two lines\n")


def test_window_length_of_a_bag_can_be_given(ema, tmp_path):
    case = tmp_path / "case.mcap"
    swing = ("--command", "swing", "-p", "command.duration=0.25")
    assert ema("simulate", *swing, "-o", case).exit_code == 0
    result = ema("estimate", case, "-p", "window_s=0.25", "--json")
    [window] = json.loads(result.stdout)
    assert window["end"] - window["start"] == pytest.approx(0.25)
    wrong = ema("estimate", case, "-p", "window_s=0")
    assert wrong.exit_code == 2
    assert "window_s = 0" in wrong.stderr
