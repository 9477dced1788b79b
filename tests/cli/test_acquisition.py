# SPDX-License-Identifier: Apache-2.0
"""Telemetry with other kinds of acquisition, from `ema simulate` to the estimate."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from ema_bags.reader import Bag
from ema_bags.telemetry import read_telemetry
from ema_core.acquisition import Acquisition


@pytest.mark.slow
@pytest.mark.parametrize(
    "acquisition", [Acquisition("filtered", 1e-3), Acquisition("none", 0.0, False)]
)
def test_from_simulation_to_estimate(acquisition: Acquisition, tmp_path: Path, ema):
    described = tmp_path / "a.yaml"
    described.write_text(json.dumps({"acquisition": asdict(acquisition)}))
    options = ["--sample-rate", "1000", "--actuator", described]
    healthy, case, unit = (tmp_path / name for name in ("h.mcap", "c.mcap", "u.yaml"))
    assert ema("simulate", *options, "--cycles", "6", "-o", healthy).exit_code == 0
    assert ema("calibrate", healthy, "-o", unit).exit_code == 0
    fault = ["--fault", "friction=0.3"]
    assert ema("simulate", *options, *fault, "-o", case).exit_code == 0
    [description] = read_telemetry(Bag(case)).descriptions
    assert description.acquisition == acquisition
    estimated = ema("estimate", case, "--calibration", unit)
    assert estimated.exit_code == 0
    assert "friction" in estimated.output
    assert ("not measured" in estimated.output) == (acquisition.current == "none")
    assert ema("info", case).exit_code == 0
    assert ema("plot", case, "-o", tmp_path / "case.png").exit_code == 0
    picture = tmp_path / "window.png"
    result = ema("plot", case, "--window", "0", "--calibration", unit, "-o", picture)
    assert result.exit_code == 0, result.output
