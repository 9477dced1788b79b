# SPDX-License-Identifier: Apache-2.0
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema_core.faults import FAULT_NAMES, estimation_error, fault_vector, healthy_faults

from ..commands import SAMPLE
from .conftest import repeated

SAMPLE_FAULTS = {"friction": 0.25, "eccentricity": 0.1, "eccentricity_phase": 0.7}


def test_faults_of_the_sample_bag_are_named(ema):
    result = ema("estimate", SAMPLE, "--json")
    assert result.exit_code == 0
    [estimate] = json.loads(result.stdout)
    assert {"fitness", "evaluations", "computing_time", "reason", "start", "end"} < {*estimate}
    assert (estimate["valid"], estimate["algorithm"]) == (True, "least_squares")
    assert list(estimate["faults"]) == list(FAULT_NAMES) == list(estimate["sigma"])
    # Measured: 0.5 %, partly due to noise and resolution of the sample's sensors.
    assert estimation_error([*estimate["faults"].values()], fault_vector(SAMPLE_FAULTS)) < 1.5


@pytest.fixture(scope="module")
def worn(ema, tmp_path_factory) -> Path:
    """Return a bag with three cycles with friction."""
    bag = tmp_path_factory.mktemp("worn") / "worn.mcap"
    assert ema("simulate", "--cycles", "3", "--fault", "friction=0.3", "-o", bag).exit_code == 0
    return bag


@pytest.mark.parametrize("options", [(), ("-p", "warm_start=false"), ("--no-memory",)])
def test_searches_start_from_the_previous_window_unless_configured_otherwise(ema, worn, options):
    estimates = json.loads(ema("estimate", worn, *options, "--json").stdout)
    assert [estimate["warm_start"] for estimate in estimates] == [False, not options, not options]


def test_several_windows_give_a_line_each_and_a_summary(ema, worn):
    result = ema("estimate", worn)
    assert result.exit_code == 0
    calibration, *windows, count, largest = result.stdout.splitlines()
    assert calibration.startswith("calibration ")
    for number, line in enumerate(windows):
        assert re.fullmatch(rf" +{number} +[\d.]+ s  valid    friction 0\.\d+ ± 0\.\d+.*", line)
    assert len(windows) == 3
    assert count == "3 windows: 3 valid, 0 degraded, 0 refused"
    assert re.match(r"largest: friction 0\.\d+ \(window \d\)", largest)
    table = ema("estimate", worn, "--verbose").stdout
    assert (table.count("least_squares, cold:"), table.count("least_squares, warm:")) == (1, 2)


def test_parameter_file_of_the_monitor_applies_unless_it_is_overridden(ema, tmp_path):
    file = tmp_path / "monitor.yaml"
    file.write_text(
        "/**/monitor: {ros__parameters: {goodness_limit: 0.2, seed: 5, limits: {friction: 0.4}}}"
    )
    result = ema("estimate", SAMPLE, "--params", file, "-p", "goodness_limit=3.0", "--json")
    assert result.exit_code == 0
    [estimate] = json.loads(result.stdout)
    assert (estimate["goodness_limit"], estimate["seed"]) == (3.0, 5)


def test_faults_are_named_in_one_line_from_largest_to_smallest(ema, tmp_path):
    result = ema("estimate", SAMPLE)
    assert result.exit_code == 0
    assert "shipped, for the built-in actuator" in result.stdout
    assert "short circuit A" in result.stdout
    [line] = [line for line in result.stdout.splitlines() if line.startswith("found:")]
    assert line.index("friction 0.2") < line.index("eccentricity 0.1")
    assert "× nominal" in line
    assert "gain" not in line
    healthy = tmp_path / "healthy.mcap"
    ema("simulate", "-o", healthy)
    assert "no significant fault" in ema("estimate", healthy).stdout


def test_plant_that_differs_keeps_its_nominal_description(ema, tmp_path):
    bag = tmp_path / "hot.mcap"
    ema("simulate", "-p", "plant.resistance=2.24", "--fault", "friction=0.2", "-o", bag)
    result = ema("estimate", bag, "--json")
    assert result.exit_code == 0
    [estimate] = json.loads(result.stdout)
    assert estimate["valid"]
    # An error of 5 % in the resistance is hardly visible while the current is controlled.
    assert estimate["faults"]["friction"] == pytest.approx(0.2, abs=0.02)


def test_calibration_of_the_same_unit_is_used(ema, tmp_path):
    healthy, case, calibration = (
        tmp_path / name for name in ("healthy.mcap", "case.mcap", "c.yaml")
    )
    unit = ("-p", "serial_number=SN-7")
    ema("simulate", *unit, "--cycles", "3", "-o", healthy)
    reported = ema("estimate", healthy)
    assert reported.exit_code == 3
    assert "3 windows: 0 valid, 0 degraded, 3 refused\n3 refused: " in reported.stdout
    assert "largest" not in reported.stdout
    assert reported.stdout.endswith(
        "`ema calibrate HEALTHY_BAG -o FILE`, then --calibration FILE\n"
    )
    ema("simulate", *unit, "--fault", "gain=0.6", "-o", case)
    result = ema("calibrate", healthy, "-o", calibration)
    assert result.exit_code == 0
    assert "3 windows" in result.stdout
    assert "3 windows average out little" in result.stderr
    assert "simulated faults" not in result.stderr
    refused = ema("estimate", case, "--json")
    assert refused.exit_code == 3
    [estimate] = json.loads(refused.stdout)
    assert "'SN-7'" in estimate["reason"]
    assert (estimate["valid"], estimate["faults"]["gain"]) == (False, None)
    [forced] = json.loads(ema("estimate", case, "--accept-defects", "--json").stdout)
    assert forced["valid"]
    assert "forced" in forced["reason"]
    [calibrated] = json.loads(ema("estimate", case, "--calibration", calibration, "--json").stdout)
    assert calibrated["valid"]
    assert calibrated["reason"] == ""
    assert calibrated["faults"]["gain"] == pytest.approx(0.6, abs=0.01)
    assert "`ema calibrate" not in ema("estimate", case, "--calibration", calibration).stdout


@pytest.mark.parametrize("window", [(), ("--window", "0")])
def test_plot_draws_telemetry_and_fit(ema, tmp_path, window):
    picture = tmp_path / "picture.png"
    assert ema("plot", SAMPLE, *window, "-o", picture).exit_code == 0
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_command_other_than_the_calibrated_one_is_estimated(ema, tmp_path):
    bag = tmp_path / "sine.mcap"
    samples = tmp_path / "motion.csv"
    t = 1e-4 * np.arange(1, 5201)
    np.savetxt(
        samples, np.column_stack([t, 4e-3 * np.sin(12.0 * t)]), delimiter=",", header="t,angle"
    )
    faulty = ("--fault", "backlash=0.3")
    assert ema("simulate", "--command", samples, *faulty, "-o", bag).exit_code == 0
    [estimate] = json.loads(ema("estimate", bag, "--json").stdout)
    assert estimate["faults"]["backlash"] == pytest.approx(0.3, abs=0.02)
    # The standard deviations include what the calibration could not learn from the chirp.
    for name in {*FAULT_NAMES} - {"backlash", *estimate["insignificant"]}:
        healthy = healthy_faults()[FAULT_NAMES.index(name)]
        assert abs(estimate["faults"][name] - healthy) < 3.0 * estimate["sigma"][name]


def test_calibration_on_a_faulty_bag_is_refused_unless_it_is_accepted(ema, tmp_path):
    output = tmp_path / "c.yaml"
    result = ema("calibrate", SAMPLE, "-o", output)
    assert (result.exit_code, output.exists()) == (3, False)
    assert "records simulated faults" in result.stderr
    assert "--accept-defects" in result.stderr
    result = ema("calibrate", SAMPLE, "--accept-defects", "-o", output)
    assert (result.exit_code, output.exists()) == (1, False)
    assert "implausible for a healthy unit" in result.stderr
    accepted = "--accept-defects", "--accepted-by", "Ada"
    result = ema("calibrate", SAMPLE, *accepted, "-o", output)
    assert result.exit_code == 0
    assert "warning: " in result.stderr
    assert "residual of a healthy window unknown" in result.stdout


def test_noisy_command_needs_a_threshold_above_its_noise(ema, tmp_path, record, faulty_blocks):
    rng = np.random.default_rng(4)
    noisy = [
        replace(block, command=block.command + rng.normal(0.0, 2e-6, len(block)))
        for block in faulty_blocks
    ]
    bag = record(noisy)
    blind = ema("estimate", bag)
    assert blind.exit_code == 1
    assert "never rested within 1e-06 rad" in blind.stderr
    calibration = tmp_path / "c.yaml"
    by_ada = "--accepted-by", "Ada"
    result = ema("calibrate", bag, "-p", "threshold_urad=20", *by_ada, "-o", calibration)
    assert result.exit_code == 0
    [estimate] = json.loads(ema("estimate", bag, "-p", "threshold_urad=20", "--json").stdout)
    assert estimate["valid"]
    assert estimate["faults"]["friction"] == pytest.approx(0.3, abs=0.02)


def test_window_cut_off_by_the_end_of_a_recording_is_not_a_failure(ema, record, faulty_blocks):
    # The same cycle follows the first, up to the middle of its window.
    n = len(faulty_blocks)
    again = repeated(faulty_blocks, 2)[n : n + n * 6 // 10]
    broken = [block for i, block in enumerate(faulty_blocks) if i != n * 6 // 10]

    def estimate(blocks):
        bag = record(blocks)
        result = ema("estimate", bag, "--json")
        bag.unlink()
        return result

    result = estimate([*faulty_blocks, *again])
    valid, cut = json.loads(result.stdout)
    assert valid["valid"]
    assert "the telemetry ends" in cut["reason"]
    assert result.exit_code == 0
    # An incomplete window before the last one is a failure, as is a recording without a whole
    # window.
    assert estimate([*broken, *again]).exit_code == 3
    assert estimate(again).exit_code == 3
