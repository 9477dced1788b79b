# SPDX-License-Identifier: Apache-2.0
"""``ema certify``, from options to the promised accuracy, and wrong options."""

import json

import pytest

from ema_core.faults import COMPONENTS


@pytest.mark.long
def test_certificate_shows_every_fault_and_names_those_that_miss_the_requirement(ema):
    result = ema("certify", "--require", "friction=0.0001", "--json")
    assert result.exit_code == 3
    certificate = json.loads(result.stdout)
    assert certificate["unmet"][0].startswith("friction has sigma 0.00")
    assert [item["name"] for item in certificate["faults"]] == list(COMPONENTS)
    assert all(item["shown"] for item in certificate["faults"])
    namings = {item["name"]: (item["naming"], item["meaning"]) for item in certificate["causes"]}
    assert namings["load_torque"] == ("named", "named")
    assert namings["winding_temperature"] == ("hidden", "does not show")


@pytest.mark.long
def test_slow_coarse_sensors_promise_less_and_a_step_is_refused(ema, tmp_path):
    coarse = ema(
        *("certify", "--sample-rate", "1000", "--current-noise", "0.3"),
        *("-p", "resolution.current=0.1", "-p", "resolution.speed=5", "--json"),
    )
    assert coarse.exit_code == 0
    certificate = json.loads(coarse.stdout)
    assert certificate["sample_period"] == pytest.approx(1e-3)
    assert max(fault["sigma"] or 0.0 for fault in certificate["faults"]) > 0.01
    step = ema("certify", "--command", "step")
    assert step.exit_code == 1
    assert "the command step produced 0 windows: expected motion back and forth" in step.stderr
