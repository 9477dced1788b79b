# SPDX-License-Identifier: Apache-2.0
"""Figures of moves give a level, and a remaining life if they certainly rise."""

import numpy as np
import pytest

from ema_core.levels import ERROR, OK, STALE
from ema_core.moves import Move
from ema_monitor.joint.moves import MoveSeries

DAY_NS = 86_400_000_000_000


def followed(ratios, *, limit=1.5, seed=0, scatter=0.01):
    rng = np.random.default_rng(seed)
    series = MoveSeries(limit=limit, reference=4)
    reported = []
    for day, ratio in enumerate(ratios):
        noise = np.exp(scatter * rng.standard_normal(3))
        figures = {
            f"RMS {i}": (i + 1.0) * ratio * noise_factor for i, noise_factor in enumerate(noise)
        }
        reported.append(series.add(Move(day * DAY_NS, figures)))
    return reported


def test_constant_unit_stays_ok_and_has_no_predicted_life():
    reported = [verdict for seed in range(20) for verdict in followed(np.ones(30), seed=seed)[4:]]
    assert all(verdict.life_days is None for verdict in reported)
    # 520 tests at 1 %: 5 are expected; more than 13 occur once in 1,000 runs.
    assert sum(verdict.level != OK for verdict in reported) <= 13


@pytest.mark.parametrize("law", ["line", "exponential"])
def test_predicted_life_contains_the_crossing(law):
    days = np.arange(40.0)
    rise = 0.02 * np.maximum(days - 9.0, 0.0)
    if law == "exponential":
        rise = np.where(days < 10.0, 0.0, 0.02 * np.exp(0.2 * (days - 10.0)))
    crossing = int(np.argmax(1.0 + rise >= 1.5))
    held = reported = 0
    for seed in range(10):
        verdicts = followed(1.0 + rise, seed=seed)
        assert [verdict.level for verdict in verdicts[:4]] == [STALE] * 4
        assert verdicts[crossing + 3].level == ERROR
        for day in range(14, crossing - 1):
            if life := verdicts[day].life_days:
                reported += 1
                held += life[0] <= crossing - day <= life[2]
    assert reported >= 20
    assert held / reported >= 0.8


def test_impossible_moves_are_named():
    series = MoveSeries(limit=1.5, reference=3)
    series.add(Move(5, {"RMS": 1.0}))
    with pytest.raises(ValueError, match="earlier than the previous move"):
        series.add(Move(4, {"RMS": 1.0}))
    with pytest.raises(ValueError, match="RMS = -1"):
        series.add(Move(6, {"RMS": -1.0}))
    with pytest.raises(ValueError, match="limit = 1: expected"):
        MoveSeries(limit=1.0, reference=3)
    with pytest.raises(ValueError, match="reference = 2"):
        MoveSeries(limit=1.5, reference=2)
