"""Duty in telemetry: travel by load, and hours by temperature of the winding."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.prognosis.duty.flown import FlownDuty, Share, together
from ema_monitor.prognosis.duty.meter import DutyLog, DutyMeter

PARAMETERS = ActuatorParameters()
UNIT = ("flap", "SIM-0001")
PERIOD_S = 1e-3


def block(position, first: int = 0, share: float = 0.35, *, measured: bool = True) -> Telemetry:
    """Positions of a shaft, at a current that is some share of its limit."""
    position = np.asarray(position, dtype=np.float64)
    current = np.full(position.size, -share * PARAMETERS.I_max) if measured else np.empty(0)
    return Telemetry(1_000, PERIOD_S, first, position, current, position, np.empty(0))


def metered(*blocks: Telemetry, rise: float | None = None) -> FlownDuty:
    meter = DutyMeter()
    for one in blocks:
        meter.add(one, PARAMETERS, rise)
    return meter.take()


def test_travel_is_the_way_to_and_fro_in_the_class_of_its_load():
    """Ten periods of an amplitude of 0.1 rad: 4 rad, but for less than a resolution each turn."""
    turns = 0.1 * np.sin(2.0 * np.pi * np.linspace(0.0, 10.0, 10_001))
    flown = metered(block(turns))
    assert flown.travelled == pytest.approx(4.0, rel=0.01)
    [share] = flown.travel
    assert (share.number, share.mean) == (3, pytest.approx(0.35))
    assert flown.hours == pytest.approx(10_001 * PERIOD_S / 3600.0)
    assert flown.winding == ()


def test_duty_does_not_depend_on_how_telemetry_is_cut_into_blocks():
    turns = 0.1 * np.sin(2.0 * np.pi * np.linspace(0.0, 3.0, 3_000))
    whole = metered(block(turns))
    parts = metered(*(block(turns[i : i + 100], i) for i in range(0, 3_000, 100)))
    assert parts.travel == whole.travel
    assert parts.hours == pytest.approx(whole.hours)


def test_noise_of_the_sensor_is_no_travel():
    noise = 5e-5 * np.random.default_rng(0).standard_normal(10_000)
    assert metered(block(noise)).travel == ()


def test_way_over_a_gap_is_not_known():
    assert metered(block([0.0, 0.1]), block([5.0, 5.2], first=10)).travelled == pytest.approx(0.3)


def test_travel_alone_counts_where_the_current_is_not_measured():
    [share] = metered(block([0.0, 0.1], measured=False)).travel
    assert (share.amount, share.mean) == (pytest.approx(0.1), 1.0)


@pytest.mark.parametrize(("rise", "number"), [(-300.0, 0), (-3.0, 9), (12.0, 11), (1e4, 31)])
def test_hours_are_in_the_class_of_the_rise_of_the_winding(rise: float, number: int):
    [share] = metered(block(np.zeros(3_600)), rise=rise).winding
    assert share.number == number
    assert share[1:] == pytest.approx((1e-3, rise))


def test_pieces_go_to_the_test_that_they_end_with_or_before():
    log = DutyLog()
    for number, end_ns in enumerate((100, 200, 300)):
        log.add(UNIT, block([0.0, 0.1 * (number + 1)], first=10 * number), PARAMETERS)
        log.cut(UNIT, end_ns)
    first = log.take(UNIT, 250)
    assert first is not None
    assert first.travelled == pytest.approx(0.3)
    assert log.take(UNIT, 250) is None
    log.forget("flap")
    assert log.take(UNIT, 300) is None


def test_pieces_that_no_test_takes_are_bounded_and_not_lost():
    log = DutyLog()
    for number in range(1_500):
        log.add(UNIT, block([0.0, 0.1], first=10 * number), PARAMETERS)
        log.cut(UNIT, number)
    flown = log.take(UNIT, 1_500)
    assert flown is not None
    assert flown.travelled == pytest.approx(150.0)


def test_duty_is_the_same_after_it_was_kept():
    one = FlownDuty(1.5, (Share(0, 3.0, 0.05), Share(4, 2.0, 0.41)), (Share(12, 1.5, 22.0),))
    other = replace(one, travel=(Share(4, 6.0, 0.45),))
    assert FlownDuty.of_record(one.as_record()) == one
    both = together(one, other)
    assert both is not None
    assert both.travel[0] == Share(0, 3.0, 0.05)
    assert both.travel[1] == pytest.approx((4, 8.0, 0.44))
    assert together(one, None) == together(None, one) == one


@pytest.mark.parametrize(
    "wrong",
    [
        {"hours": -1.0},
        {"hours": "long"},
        {"travel": [[10, 1.0, 0.5]]},
        {"travel": [[0, -1.0, 0.5]]},
        {"winding": [[0, 1.0, float("nan")]]},
        {"winding": [[0, 1.0]]},
    ],
)
def test_record_that_is_none_is_refused(wrong):
    record = FlownDuty(1.0).as_record() | wrong
    with pytest.raises((ValueError, TypeError)):
        FlownDuty.of_record(record)


def test_impossible_current_counts_as_the_largest_load():
    flown = metered(block([0.0, 0.1], share=1e20))
    [share] = flown.travel
    assert (share.number, share.mean) == (9, 10.0)


def test_piece_whose_stamp_is_ahead_holds_back_no_other():
    log = DutyLog()
    for n, end_ns in enumerate((10**18, 1_000, 2_000)):
        log.add(UNIT, block([0.0, 0.1], 2 * n), PARAMETERS)
        log.cut(UNIT, end_ns)
    taken = log.take(UNIT, 2_000)
    assert taken is not None
    assert taken.travelled == pytest.approx(0.4)  # with the ways back
    assert log.take(UNIT, 3_000) is None
