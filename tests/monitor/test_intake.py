# SPDX-License-Identifier: Apache-2.0
"""Intake of one actuator: assignment of duty, counts and measured causes to windows and tests."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.causes import CauseEstimate
from ema_core.commands import THESIS_CHIRP, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_monitor.intake import Intake
from ema_monitor.prognosis.duty.damage import FlownDuty
from ema_monitor.prognosis.history_entry import Count
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import TriggerSettings
from ema_monitor.windows.window import Window

OLD = ActuatorDescription()
NEW = replace(OLD, serial_number="new")
PERIOD_S = 1e-4
CYCLE = build_cycle(THESIS_CHIRP, PERIOD_S).samples
HOUR_S = 3600.0
S = 1_000_000_000


def block(first: int, samples: int = 1000) -> Telemetry:
    """Return telemetry at rest."""
    zeros = np.zeros(samples)
    return Telemetry(round(first * PERIOD_S * S), PERIOD_S, first, zeros, zeros, zeros, zeros)


def cycle_block(stamp_ns: int = 0) -> Telemetry:
    """Return a whole test cycle, whose position follows the command."""
    zeros = np.zeros(len(CYCLE))
    return Telemetry(stamp_ns, PERIOD_S, 0, CYCLE, zeros, CYCLE, zeros)


def window_in(events: list) -> Window:
    [window] = [event.window for event in events if isinstance(event, Segment)]
    assert isinstance(window, Window)
    return window


def seconds(flown: FlownDuty) -> float:
    return round(flown.hours * HOUR_S, 9)


def test_duty_of_a_removed_unit_does_not_count_for_the_next():
    intake = Intake("flap", TriggerSettings(), OLD)
    intake.feed(block(0, 3000))
    intake.describe(NEW)
    intake.feed(block(3000, 1000))
    pieces = intake.pieces(S)
    assert {unit[1]: seconds(flown) for unit, [(_, flown)] in pieces.items()} == {
        OLD.serial_number: 0.3,
        "new": 0.1,
    }
    assert seconds(intake.take_use(NEW.unit_key, S).flown) == 0.1
    assert seconds(intake.take_use(OLD.unit_key, S).flown) == 0.3
    assert intake.take_use(OLD.unit_key, S).flown.hours == 0.0


def test_units_that_come_and_go_are_kept_in_limited_number():
    intake = Intake("flap", TriggerSettings(), OLD)
    for number in range(30):
        intake.describe(replace(OLD, serial_number=str(number)))
        intake.feed(block(1000 * number))
    assert [unit[1] for unit in intake.pieces(30 * S)] == [str(n) for n in range(20, 30)]


def test_duty_of_a_window_ends_with_it_and_the_rest_belongs_to_the_next():
    intake = Intake("flap", TriggerSettings(), OLD)
    window = window_in(intake.feed(cycle_block()))
    intake.feed(block(len(CYCLE), 1000))
    end_ns = window.end_ns
    assert not intake.take_use(OLD.unit_key, end_ns - 1).flown.hours
    flown = intake.take_use(OLD.unit_key, end_ns).flown
    assert seconds(flown) == round(len(CYCLE) * PERIOD_S, 9)
    assert flown.travel[0].sum() > 0.0
    [(_, rest)] = intake.pieces(10 * S)[OLD.unit_key]
    assert seconds(rest) == 0.1


def test_count_before_the_description_belongs_to_the_unit_described_next():
    intake = Intake("flap", TriggerSettings())
    intake.count(("flap", ""), Count(S, 12.0, 3))
    intake.describe(OLD)
    assert intake.take_use(OLD.unit_key, S - 1).counted is None
    assert intake.take_use(OLD.unit_key, S).counted == Count(S, 12.0, 3)


def test_measured_causes_apply_to_the_next_window_and_the_duty():
    intake = Intake("flap", TriggerSettings(), OLD, max_age_s=lambda: 2.0)
    intake.measure(S, {"load_torque": (0.1, 0.01), "winding_temperature": (30.0, 1.0)})
    window = window_in(intake.feed(cycle_block(S)))
    assert [cause.name for cause in window.measured] == ["load_torque", "winding_temperature"]
    assert intake.take_use(OLD.unit_key, window.end_ns).flown.winding[1].sum() > 0.0
    aged = window_in(intake.feed(cycle_block(5 * S)))
    assert aged.measured == ()


def test_continuously_measured_cause_replaces_the_one_in_the_log():
    throughout = CauseEstimate("load_torque", 0.5, 0.1)
    intake = Intake("flap", TriggerSettings(), OLD, measured=[throughout])
    intake.measure(S, {"load_torque": (0.1, 0.01), "winding_temperature": (30.0, 1.0)})
    first, second = window_in(intake.feed(cycle_block(S))).measured
    assert (first, second.name) == (throughout, "winding_temperature")


def test_impossible_measurement_is_refused():
    with pytest.raises(ValueError, match="measured cause load_torque"):
        Intake("flap", TriggerSettings()).measure(S, {"load_torque": (0.1, -1.0)})
