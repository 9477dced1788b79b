"""Telemetry acquired in other ways, from `ema simulate` to the estimate."""

from pathlib import Path

import pytest

from ema_bags.reader import Bag
from ema_bags.telemetry import read_telemetry
from ema_core.acquisition import Acquisition

WAYS = {
    "filtered": "{current: filtered, current_filter: 1e-3}",
    "blind": "{current: none, speed: false}",
}


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_from_simulation_to_estimate(way: str, tmp_path: Path, ema):
    described = tmp_path / "a.yaml"
    described.write_text(f"acquisition: {WAYS[way]}")
    options = ["--sample-rate", "1000", "--actuator", described]
    healthy, case, unit = (tmp_path / name for name in ("h.mcap", "c.mcap", "u.yaml"))
    assert ema("simulate", *options, "--cycles", "6", "-o", healthy).exit_code == 0
    assert ema("calibrate", healthy, "-o", unit).exit_code == 0
    fault = ["--fault", "friction=0.3"]
    assert ema("simulate", *options, *fault, "-o", case).exit_code == 0
    [description] = read_telemetry(Bag(case)).descriptions
    expected = (
        Acquisition("filtered", 1e-3) if way == "filtered" else Acquisition("none", 0.0, False)
    )
    assert description.acquisition == expected
    found = ema("estimate", case, "--calibration", unit)
    assert found.exit_code == 0
    assert "friction" in found.output
    assert ("not measured" in found.output) == (way == "blind")
    assert ema("info", case).exit_code == 0
    assert ema("plot", case, "-o", tmp_path / "case.png").exit_code == 0
    picture = tmp_path / "window.png"
    result = ema("plot", case, "--window", "0", "--calibration", unit, "-o", picture)
    assert result.exit_code == 0, result.output


def test_impossible_sample_rate_is_refused(tmp_path: Path, ema):
    result = ema("simulate", "--sample-rate", "300", "-o", tmp_path / "x.mcap")
    assert result.exit_code != 0
    assert "--sample-rate 300 Hz" in result.output
    assert not (tmp_path / "x.mcap").exists()
