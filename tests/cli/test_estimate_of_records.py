# SPDX-License-Identifier: Apache-2.0
"""``ema estimate`` on records that are compared with a baseline."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.monitor.comparisons import (
    FRICTION_UP,
    HEALTHY,
    LOADED,
    NOTHING,
    STILL,
    changed,
    compared,
    comparison,
)

from ema_cli.bags.identifying import Identifying
from ema_monitor.joint.comparison import Comparison, Improvement
from ema_monitor.quantities import FRICTION
from ema_monitor.reasons import StatedReason

Shown = Callable[..., Any]


@pytest.fixture
def estimate(ema, monkeypatch: pytest.MonkeyPatch, bag: Path) -> Shown:
    """Return a function that runs ``ema estimate`` on records with given comparisons."""

    def run(*of: Comparison, options: Sequence[str] = ()) -> Any:
        estimates = [compared(item, calibration_windows=12) for item in of]
        monkeypatch.setattr(Identifying, "estimate", lambda *_: estimates)
        return ema("estimate", bag, *options)

    return run


@pytest.fixture(scope="module")
def bag(ema, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bag") / "case.mcap"
    assert ema("simulate", "-o", path).exit_code == 0
    return path


def test_record_is_shown_as_a_table_of_quantities(estimate: Shown):
    result = estimate(FRICTION_UP)
    assert result.exit_code == 3
    assert "record 0, " in result.stdout
    rows = [" ".join(line.split()) for line in result.stdout.splitlines()]
    assert "Coulomb friction +15.2 % +11.2 to +19.2 % changed" in rows
    assert "not judged (there is no position command)" in result.stdout
    assert "\ndeparted\nCoulomb friction rose 15.2 %" in result.stdout
    assert "short circuit" not in result.stdout
    assert "command travels" not in result.stdout
    assert "calibration of 12 healthy records" in result.stdout


def test_healthy_record_ends_with_0_and_states_how_to_detect_smaller_changes(estimate: Shown):
    result = estimate(replace(HEALTHY, improvements=(Improvement(FRICTION, 2, 6, 0.06, 0.05),)))
    assert result.exit_code == 0
    assert "changes of Coulomb friction above 6 % would show" in result.stdout
    assert "change of Coulomb friction from 6 % to 5 % on a day without healthy" in result.stdout


def test_record_without_a_judgement_ends_with_3(estimate: Shown):
    result = estimate(NOTHING)
    assert result.exit_code == 3
    assert f"\nrefused\n{STILL}" in result.stdout


def test_several_records_have_a_line_each_and_a_summary(estimate: Shown):
    stronger = comparison(changed(FRICTION, 0.3))
    result = estimate(HEALTHY, FRICTION_UP, stronger, LOADED, NOTHING)
    assert result.exit_code == 3
    lines = result.stdout.splitlines()
    assert [line.split()[6] for line in lines[1:6]] == [
        "valid", "departed", "departed", "departed", "refused",
    ]  # fmt: skip
    assert "5 records: 1 valid, 1 refused, 3 departed" in lines
    assert (
        "largest: Coulomb friction +30.0 % (record 2), constant load +0.50 N.m (record 3)" in lines
    )


def test_json_has_the_quantities(estimate: Shown):
    [printed] = json.loads(estimate(FRICTION_UP, options=("--json",)).stdout)
    friction = printed["comparison"]["quantities"][0]
    assert (friction["name"], friction["judgement"]) == ("friction", "changed")
    assert friction["change"] == pytest.approx(0.152)
    hidden = printed["comparison"]["quantities"][-1]
    assert (hidden["judgement"], hidden["change"]) == ("not judged", None)
    assert hidden["reason"] == "there is no position command"


def test_unreadable_record_is_refused_with_its_reason(
    ema, monkeypatch: pytest.MonkeyPatch, bag: Path
):
    refused = compared(
        NOTHING, comparison=None, reasons=(StatedReason("the position is constant"),)
    )
    monkeypatch.setattr(Identifying, "estimate", lambda *_: [refused])
    result = ema("estimate", bag)
    assert result.exit_code == 3
    assert "record 0, " in result.stdout
    assert "no valid estimate: the position is constant" in result.stdout
