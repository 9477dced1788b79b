"""Ordinary motion on the command line: simulated, looked into, identified."""

import json
from pathlib import Path

import numpy as np
import pytest

from ema_core.faults import FAULT_NAMES, fault_vector

FAULTS = {"friction": 0.2, "short_circuit_b": 0.1}
MOVES = ("--command", "moves", "--command-set", "amplitude=0.008,rate=0.3,duration=4,seed=3")


@pytest.fixture(scope="module")
def bag(ema, tmp_path_factory) -> Path:
    bag = tmp_path_factory.mktemp("motion") / "motion.mcap"
    faults = [item for name, k in FAULTS.items() for item in ("--fault", f"{name}={k}")]
    assert ema("simulate", *MOVES, *faults, "--load", "0.3", "-o", bag).exit_code == 0
    return bag


def test_info_lists_the_stretches(ema, bag):
    """Stretches of half a second, one after the other, through the whole cycle."""
    result = ema("info", "--any-motion", bag)
    assert result.exit_code == 0
    assert result.stdout.count("start in the play") >= 6


@pytest.mark.slow
def test_estimate_combines_stretches_and_says_so(ema, bag):
    result = ema("estimate", "--any-motion", "--wanted-sigma", "0.02", "--json", bag)
    assert result.exit_code == 0
    assert "stretches of motion: " in result.stderr
    estimates = json.loads(result.stdout)
    assert estimates
    for one in estimates:
        assert one["verdict"] != "refused"
        assert one["stretches"] >= 1
        assert one["end"] - one["start"] >= 0.5 * one["stretches"] - 1e-6
        for name, true in zip(FAULT_NAMES, fault_vector(FAULTS), strict=True):
            if name != "eccentricity_phase" and name not in one["unobservable"]:
                # The wanted 0.02, and three of these are rare.
                assert abs(one["faults"][name] - true) < 0.06


@pytest.mark.slow
def test_a_line_names_what_the_motion_does_not_show(ema, bag):
    """With half a per cent wanted, short circuits are not known well enough."""
    result = ema("estimate", "--any-motion", "--wanted-sigma", "0.005", bag)
    assert result.exit_code == 0
    assert "1 stretch" in result.stdout or " stretches" in result.stdout
    assert "the motion does not show short circuit A" in " ".join(result.stdout.split())


def test_a_bag_without_motion_is_an_error(ema, tmp_path):
    command, bag = tmp_path / "rest.csv", tmp_path / "rest.mcap"
    np.savetxt(command, np.zeros(3000))
    assert ema("simulate", "--command", command, "-o", bag).exit_code == 0
    # The slow approach of the cycle is motion; one that travels a tenth as far is none.
    result = ema("estimate", "--any-motion", "--threshold", "1", bag)
    assert result.exit_code == 1
    assert "no motion to diagnose" in result.stderr
