# SPDX-License-Identifier: Apache-2.0
"""Friction that rises over the healthy records is not accepted as a baseline."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ema_monitor.baselines.unit_baseline import UnitBaseline
from ema_monitor.calibration.joint_calibration import calibrate_joint
from ema_monitor.joint.trend import friction_rise

from ..baselines.healthy import JOINT, record


def rise(count: int, per_record: float, records_per_day: int, seed: int = 0) -> float:
    windows = [
        record(number + 100 * seed, number // records_per_day, 1.0 + per_record * number)
        for number in range(count)
    ]
    return friction_rise(calibrate_joint(windows, JOINT).baseline)


@pytest.mark.parametrize("records_per_day", [3, 100])
@pytest.mark.parametrize("seed", range(3))
def test_healthy_scatter_is_not_a_rise(records_per_day: int, seed: int):
    assert rise(12, 0.0, records_per_day, seed) == 0.0


@pytest.mark.parametrize("records_per_day", [3, 100])
def test_wear_is_a_rise(records_per_day: int):
    # A line from 1 to 1.33, relative to its median.
    assert rise(12, 0.03, records_per_day) == pytest.approx(0.33 / 1.165, abs=0.04)


@pytest.mark.parametrize("records_per_day", [1, 2, 100])
def test_four_records_that_worsen_by_5_percent_each_are_a_rise(records_per_day: int):
    assert rise(4, 0.05, records_per_day) == pytest.approx(0.15 / 1.075, abs=0.06)


def healthy(rng: np.random.Generator, days: int, records_per_day: int, **scatter: float) -> Any:
    """Return records of a healthy joint; ``within`` and ``between`` are the scatter by day."""
    by_day = np.repeat(rng.normal(1.0, scatter["between"], days), records_per_day)
    frictions = by_day * rng.normal(1.0, scatter["within"], days * records_per_day)
    return SimpleNamespace(
        records=[
            SimpleNamespace(
                stamp_ns=number, day=number // records_per_day, values=np.array([friction] * 5)
            )
            for number, friction in enumerate(frictions)
        ]
    )


@pytest.mark.parametrize(("days", "records_per_day"), [(1, 4), (1, 10), (3, 3), (4, 1), (10, 2)])
@pytest.mark.parametrize(("within", "between"), [(0.02, 0.02), (0.03, 0.03)])
def test_healthy_joints_are_rarely_refused(days, records_per_day, within, between):
    rng = np.random.default_rng(1)
    refused = [
        friction_rise(healthy(rng, days, records_per_day, within=within, between=between)) > 0.0
        for _ in range(400)
    ]
    assert np.mean(refused) < (0.01 if within < 0.03 else 0.04)


def test_falling_friction_is_not_a_rise():
    assert rise(12, -0.03, 100) == 0.0


def test_worsening_joint_is_not_accepted(tmp_path: Path):
    """With three records a day, each single record is within the scatter of the days."""
    with UnitBaseline(tmp_path, JOINT) as baseline:
        for number in range(20):
            baseline.add(record(number, number // 3, 1.0 + 0.1 * number))
        with pytest.raises(ValueError, match=r"friction rises by \d+ % over the records"):
            baseline.accept("accept_after = 20", is_automatic=True)
        assert not baseline.is_accepted
        assert baseline.accept("Ada", "loads differ", force=True).records == 20
