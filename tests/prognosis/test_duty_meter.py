"""Duty in telemetry: travel by load, and hours by temperature of the winding."""

import numpy as np
import pytest

from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.prognosis.duty.flown import FlownDuty, together
from ema_monitor.prognosis.duty.meter import DutyLog, DutyMeter

PARAMETERS = ActuatorParameters()
UNIT = ("flap", "SIM-0001")
PERIOD_S = 1e-3


def block(position, first: int = 0, share: float = 0.35, *, measured: bool = True) -> Telemetry:
    """Positions of a shaft, at a current that is some share of its limit."""
    position = np.asarray(position, dtype=np.float64)
    current = np.full(position.size, -share * PARAMETERS.I_max) if measured else np.empty(0)
    return Telemetry(1_000, PERIOD_S, first, position, current, position, np.empty(0))


def classes(spectrum: np.ndarray) -> list[tuple[int, float, float]]:
    """Number, amount and mean of each class with anything in it."""
    amount, moment = spectrum
    return [(int(i), amount[i], moment[i] / amount[i]) for i in np.flatnonzero(amount)]


def travelled(flown: FlownDuty | None) -> float:
    assert flown is not None
    return float(flown.travel[0].sum())


def metered(*blocks: Telemetry, rise: float | None = None) -> FlownDuty:
    meter = DutyMeter()
    for one in blocks:
        meter.add(one, PARAMETERS, rise)
    return meter.take()


def test_travel_is_the_way_to_and_fro_in_the_class_of_its_load():
    """Ten periods of an amplitude of 0.1 rad: 4 rad, but for less than a resolution each turn."""
    turns = 0.1 * np.sin(2.0 * np.pi * np.linspace(0.0, 10.0, 10_001))
    flown = metered(block(turns))
    assert travelled(flown) == pytest.approx(4.0, rel=0.01)
    assert classes(flown.travel) == [(3, pytest.approx(4.0, rel=0.01), pytest.approx(0.35))]
    assert flown.hours == pytest.approx(10_001 * PERIOD_S / 3600.0)
    assert not flown.winding.any()


def test_duty_does_not_depend_on_how_telemetry_is_cut_into_blocks():
    turns = 0.1 * np.sin(2.0 * np.pi * np.linspace(0.0, 3.0, 3_000))
    whole = metered(block(turns))
    parts = metered(*(block(turns[i : i + 100], i) for i in range(0, 3_000, 100)))
    np.testing.assert_array_equal(parts.travel, whole.travel)
    assert parts.hours == pytest.approx(whole.hours)


def test_noise_of_the_sensor_is_no_travel():
    noise = 5e-5 * np.random.default_rng(0).standard_normal(10_000)
    assert travelled(metered(block(noise))) == 0.0


def test_way_over_a_gap_is_not_known():
    flown = metered(block([0.0, 0.1]), block([5.0, 5.2], first=10))
    assert travelled(flown) == pytest.approx(0.3)


def test_travel_alone_counts_where_the_current_is_not_measured():
    flown = metered(block([0.0, 0.1], measured=False))
    assert classes(flown.travel) == [(9, pytest.approx(0.1), 1.0)]


@pytest.mark.parametrize(("rise", "number"), [(-300.0, 0), (-3.0, 9), (12.0, 11), (1e4, 31)])
def test_hours_are_in_the_class_of_the_rise_of_the_winding(rise: float, number: int):
    flown = metered(block(np.zeros(3_600)), rise=rise)
    assert classes(flown.winding) == [(number, pytest.approx(1e-3), pytest.approx(rise))]


def test_pieces_go_to_the_test_that_they_end_with_or_before():
    log = DutyLog()
    for number, end_ns in enumerate((100, 200, 300)):
        log.add(UNIT, block([0.0, 0.1 * (number + 1)], first=10 * number), PARAMETERS)
        log.cut(UNIT, end_ns)
    first = log.take(UNIT, 250)
    assert travelled(first) == pytest.approx(0.3)
    assert log.take(UNIT, 250) is None
    log.forget("flap")
    assert log.take(UNIT, 300) is None


def test_pieces_that_no_test_takes_are_bounded_and_not_lost():
    log = DutyLog()
    for number in range(1_500):
        log.add(UNIT, block([0.0, 0.1], first=10 * number), PARAMETERS)
        log.cut(UNIT, number)
    flown = log.take(UNIT, 1_500)
    assert travelled(flown) == pytest.approx(150.0)


def test_duty_is_the_same_after_it_was_kept_and_adds_up():
    one = metered(block([0.0, 0.1, 0.3]), rise=22.0)
    again = FlownDuty.of_record(one.as_record())
    both = together(one, metered(block([0.0, 0.2], share=0.45)))
    assert both is not None
    for figure in ("hours", "travel", "winding"):
        np.testing.assert_array_equal(getattr(again, figure), getattr(one, figure))
    assert classes(both.travel) == [
        (3, pytest.approx(0.3), pytest.approx(0.35)),
        (4, pytest.approx(0.2), pytest.approx(0.45)),
    ]
    assert together(one, None) is together(None, one) is one


def test_impossible_current_counts_as_the_largest_load():
    flown = metered(block([0.0, 0.1], share=1e20))
    assert classes(flown.travel) == [(9, pytest.approx(0.1), 10.0)]


def test_piece_whose_stamp_is_ahead_holds_back_no_other():
    log = DutyLog()
    for n, end_ns in enumerate((10**18, 1_000, 2_000)):
        log.add(UNIT, block([0.0, 0.1], 2 * n), PARAMETERS)
        log.cut(UNIT, end_ns)
    taken = log.take(UNIT, 2_000)
    assert travelled(taken) == pytest.approx(0.4)  # with the ways back
    assert log.take(UNIT, 3_000) is None
