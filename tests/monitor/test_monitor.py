# SPDX-License-Identifier: Apache-2.0
"""A monitor without ROS: from blocks to defects, estimates and health."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_core.levels import ERROR, STALE
from ema_monitor import Count, Diagnosed, Monitor, MonitorSettings, Outlook, diagnosis
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_sim.bench import ActuatorBench, BenchSettings

TEN_HOURS = MonitorSettings(
    prognosis=replace(PrognosisSettings(), service=Service(hours_per_cycle=10.0))
)


@pytest.fixture(scope="module")
def blocks():
    """Return three test cycles of an actuator with friction."""
    bench = ActuatorBench(ActuatorDescription(), BenchSettings())
    bench.set_faults({"friction": 0.6})
    return [block for n in range(3) for block, _ in bench.begin_cycle(n * 10**10).blocks]


@pytest.fixture(scope="module")
def windows(blocks):
    finder = WindowFinder(TriggerSettings(), ActuatorDescription())
    return [event for block in blocks for event in finder.feed(block) if isinstance(event, Segment)]


def fed(monitor, blocks):
    return [event for block in blocks for event in monitor.feed(block)]


def outlooks_in(events):
    return [event for event in events if isinstance(event, Outlook)]


def test_estimates_equal_those_of_the_windows_and_health_has_their_service_hours(blocks, windows):
    monitor = Monitor(settings=TEN_HOURS)
    events = [*fed(monitor, blocks), *monitor.finish()]
    assert [type(event) for event in events] == [Diagnosed, Outlook] * 3
    estimates = [event.estimate for event in events if isinstance(event, Diagnosed)]
    offline = [
        item.estimate
        for item in diagnosis.diagnose(windows, Calibration.builtin())
        if isinstance(item, Diagnosed)
    ]
    for item, reference in zip(estimates, offline, strict=True):
        np.testing.assert_array_equal(item.faults, reference.faults)
        np.testing.assert_array_equal(item.covariance, reference.covariance)
    assert [item.warm_start for item in estimates] == [False, True, True]
    assert [item.flight_hours for item in outlooks_in(events)] == [10.0, 20.0, 30.0]
    assert outlooks_in(events)[-1].health.level == ERROR
    assert [entry.cycles for entry in monitor.unit.history.entries] == [1, 2, 3]


def test_counts_give_the_hours_and_the_history_continues_after_a_restart(blocks, tmp_path):
    cycle = blocks[: len(blocks) // 3]
    first = Monitor(history_folder=tmp_path)
    first.count(Count(0, 100.0, 5))
    assert [outlook.flight_hours for outlook in outlooks_in(fed(first, cycle))] == [100.0]
    first.unit.history.close()
    second = Monitor(history_folder=tmp_path)
    # Repeating the same telemetry changes nothing.
    assert {outlook.flight_hours for outlook in outlooks_in(fed(second, cycle))} == {100.0}
    assert len(second.unit.history.entries) == 1
    second.unit.history.close()


def test_gap_refuses_its_window(blocks):
    missing = len(blocks) // 6
    refused, outlook = fed(Monitor(), [*blocks[:missing], *blocks[missing + 1 : len(blocks) // 3]])
    assert isinstance(refused, Diagnosed)
    assert not refused.estimate.valid
    assert "gap of" in refused.estimate.reason
    assert isinstance(outlook, Outlook)
    assert outlook.health.level == STALE
    assert "the newest test was refused: gap of" in outlook.health.reason
