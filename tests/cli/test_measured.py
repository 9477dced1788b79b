# SPDX-License-Identifier: Apache-2.0
"""``ema estimate --measured``: hidden causes that were measured outside the bag."""

import json
import re
from pathlib import Path

import pytest

RIGHT = ("--measured", "load_torque=0.3:0.01")


@pytest.fixture(scope="module")
def bag(ema, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("bags") / "loaded.mcap"
    result = ema("simulate", "--cause", "load_torque=0.3", "--fault", "friction=0.2", "-o", path)
    assert result.exit_code == 0, result.output
    return path


def test_measured_load_is_shown_and_not_as_a_hidden_cause(ema, bag):
    result = ema("estimate", bag, *RIGHT, "--measured", "winding_temperature=0:2")
    assert result.exit_code == 0
    assert "measured: load torque +0.3 ± 0.01 N.m; winding temperature +0 ± 2 K" in result.stdout
    # Within 0.002, as without a load.
    assert re.search(r"found: friction 0\.(199|20[012]) \([^;]*$", result.stdout, re.MULTILINE)
    assert "note:" not in result.stdout


def test_measured_load_is_in_the_json_objects(ema, bag):
    [estimate] = json.loads(ema("estimate", bag, *RIGHT, "--json").stdout)
    assert estimate["measured"] == [{"name": "load_torque", "value": 0.3, "sigma": 0.01}]
    assert estimate["causes"] == []


def test_contradicting_measurement_is_reported(ema, bag):
    result = ema("estimate", bag, "--measured", "load_torque=0:0.01")
    assert "load torque +0.3 ± " in " ".join(result.stdout.split())
    assert "contradicts it: measured load torque +0 ± 0.01 N.m" in result.stdout


@pytest.mark.slow
def test_calibration_states_assumed_and_unlearned_parameters(ema, tmp_path):
    loaded = tmp_path / "loaded.mcap"
    assert ema("simulate", "--cause", "load_torque=0.3", "-o", loaded).exit_code == 0
    result = ema("calibrate", loaded, *RIGHT, "-o", tmp_path / "unit.yaml")
    assert result.exit_code == 0, result.output
    words = " ".join(result.stdout.split())
    assert "measured causes: load torque +0.3 ± 0.01 N.m in 1 window" in words
    assert "not learned from these windows: viscous friction" in words
