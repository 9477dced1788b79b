# SPDX-License-Identifier: Apache-2.0
"""Ordinary motion on the command line: simulated, inspected and identified."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ema_cli.figures import fit
from ema_monitor.plot import plot_fit

FAULTS = {"friction": 0.2, "short_circuit_b": 0.1}
FIGURES = ("amplitude=0.008", "rate=0.3", "duration=4", "seed=3")
MOVES = ("--command", "moves", *(word for value in FIGURES for word in ("-p", f"command.{value}")))

OPTIONS = ("--any-motion", "-p", "wanted_sigma=0.02")


@pytest.fixture(scope="module")
def bag(ema, tmp_path_factory) -> Path:
    bag = tmp_path_factory.mktemp("motion") / "motion.mcap"
    faults = [item for name, k in FAULTS.items() for item in ("--fault", f"{name}={k}")]
    assert ema("simulate", *MOVES, *faults, "-p", "load=0.3", "-o", bag).exit_code == 0
    return bag


def test_info_lists_the_stretches(ema, bag):
    """Successive stretches of half a second cover the whole cycle."""
    result = ema("info", "--any-motion", bag)
    assert result.exit_code == 0
    assert result.stdout.count("start in the play") >= 6
    assert "(--any-motion: any motion)" in ema("info", bag).stdout


@pytest.fixture(scope="module")
def estimates(ema, bag) -> list[dict[str, Any]]:
    result = ema("estimate", *OPTIONS, "--json", bag)
    assert result.exit_code == 0
    assert "stretches of motion: " in result.stderr
    return json.loads(result.stdout)


@pytest.mark.slow
def test_estimate_combines_stretches_and_states_so(estimates):
    assert estimates
    for estimate in estimates:
        assert estimate["verdict"] != "refused"
        assert estimate["stretches"] >= 1
        assert estimate["end"] - estimate["start"] >= 0.5 * estimate["stretches"] - 1e-6
        # The wanted sigma is 0.02; errors of three standard deviations are rare.
        assert abs(estimate["faults"]["friction"] - FAULTS["friction"]) < 0.06


@pytest.mark.slow
def test_line_names_the_faults_that_the_motion_does_not_show(ema, bag):
    """With a wanted sigma of 0.005, short circuits are not known accurately enough."""
    result = ema("estimate", "--any-motion", "-p", "wanted_sigma=0.005", bag)
    assert result.exit_code == 0
    assert "1 stretch" in result.stdout or " stretches" in result.stdout
    assert "short circuit A" in " ".join(result.stdout.split()).partition("not show")[2]


def test_bag_without_motion_is_an_error(ema, tmp_path):
    command, bag = tmp_path / "rest.csv", tmp_path / "rest.mcap"
    np.savetxt(command, np.zeros(3000))
    assert ema("simulate", "--command", command, "-o", bag).exit_code == 0
    # The slow approach of the cycle counts as motion; a tenth of its travel does not.
    result = ema("estimate", "--any-motion", "-p", "threshold_urad=1e6", bag)
    assert result.exit_code == 1
    assert "no motion to diagnose" in result.stderr


@pytest.mark.slow
def test_plot_shows_an_estimate_with_the_fit_of_its_last_stretch(
    ema, bag, estimates, tmp_path, monkeypatch
):
    """The stretch is under a load, which is part of the fit."""
    drawn = []

    def note(window, estimate, calibration, **more):
        drawn.append((window, estimate))
        return plot_fit(window, estimate, calibration, **more)

    monkeypatch.setattr(fit, "plot_fit", note)
    picture = tmp_path / "fit.png"
    result = ema("plot", *OPTIONS, "--window", "0", "-o", picture, bag)
    assert result.exit_code == 0, result.stderr
    assert picture.stat().st_size > 0
    [(window, estimate)] = drawn
    combined, *later = estimates
    assert estimate.stretches == combined["stretches"]
    assert (estimate.end_ns, window.end_ns) == (combined["end_ns"], combined["end_ns"])
    [load] = [cause.value for cause in estimate.causes if cause.name == "load_torque"]
    assert load == pytest.approx(0.3, abs=0.02)
    number = 1 + len(later)
    result = ema("plot", *OPTIONS, "--window", number, "-o", tmp_path / "none.png", bag)
    assert (result.exit_code, f"the motion has {number} estimate" in result.stderr) == (1, True)
