# SPDX-License-Identifier: Apache-2.0
"""Duty measured in telemetry, and scenarios of duty in files."""

import re
from collections import deque
from pathlib import Path

import numpy as np
import pytest

from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.prognosis.duty.course import FutureDuty
from ema_monitor.prognosis.duty.damage import FlownDuty
from ema_monitor.prognosis.duty.meter import DutyMeter
from ema_monitor.prognosis.duty.scenario import Scenario, read_scenarios

PARAMETERS = ActuatorParameters()
PERIOD_S = 1e-3


def block(position, first: int = 0, share: float = 0.35, *, measured: bool = True) -> Telemetry:
    """Return positions of a shaft, at a current that is a share of its limit."""
    position = np.asarray(position, dtype=np.float64)
    current = np.full(position.size, -share * PARAMETERS.I_max) if measured else np.empty(0)
    return Telemetry(1_000, PERIOD_S, first, position, current, position, np.empty(0))


def classes(spectrum: np.ndarray) -> list[tuple[int, float, float]]:
    """Return number, amount and mean of each non-empty class."""
    amount, moment = spectrum
    return [(int(i), amount[i], moment[i] / amount[i]) for i in np.flatnonzero(amount)]


def travelled(flown: FlownDuty) -> float:
    return float(flown.travel[0].sum())


def metered(*blocks: Telemetry, rise: float | None = None) -> FlownDuty:
    meter = DutyMeter(deque())
    for item in blocks:
        meter.add(item, PARAMETERS, rise)
    meter.cut(0)
    return meter.take(0)


def test_travel_is_the_distance_back_and_forth_in_the_class_of_its_load():
    """Ten periods with an amplitude of 0.1 rad: 4 rad, less at most a resolution per reversal."""
    turns = 0.1 * np.sin(2.0 * np.pi * np.linspace(0.0, 10.0, 10_001))
    flown = metered(block(turns))
    assert travelled(flown) == pytest.approx(4.0, rel=0.01)
    assert classes(flown.travel) == [(3, pytest.approx(4.0, rel=0.01), pytest.approx(0.35))]
    assert flown.hours == pytest.approx(10_001 * PERIOD_S / 3600.0)
    assert not flown.winding.any()


def test_duty_does_not_depend_on_the_blocks_of_telemetry():
    turns = 0.1 * np.sin(2.0 * np.pi * np.linspace(0.0, 3.0, 3_000))
    whole = metered(block(turns))
    parts = metered(*(block(turns[i : i + 100], i) for i in range(0, 3_000, 100)))
    np.testing.assert_array_equal(parts.travel, whole.travel)
    assert parts.hours == pytest.approx(whole.hours)


def test_noise_of_the_sensor_is_not_travel():
    noise = 5e-5 * np.random.default_rng(0).standard_normal(10_000)
    assert travelled(metered(block(noise))) == 0.0


def test_travel_across_a_gap_is_unknown():
    flown = metered(block([0.0, 0.1]), block([5.0, 5.2], first=10))
    assert travelled(flown) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("telemetry", "load"),
    [
        # Without a measured current, only travel counts; an impossible current counts as the
        # largest.
        (block([0.0, 0.1], measured=False), 1.0),
        (block([0.0, 0.1], share=1e20), 10.0),
    ],
)
def test_travel_without_a_usable_current_is_in_the_last_class(telemetry: Telemetry, load: float):
    assert classes(metered(telemetry).travel) == [(9, pytest.approx(0.1), load)]


@pytest.mark.parametrize(("rise", "number"), [(-300.0, 0), (-3.0, 9), (12.0, 11), (1e4, 31)])
def test_hours_are_in_the_class_of_the_rise_of_the_winding(rise: float, number: int):
    flown = metered(block(np.zeros(3_600)), rise=rise)
    assert classes(flown.winding) == [(number, pytest.approx(1e-3), pytest.approx(rise))]


def test_duty_belongs_to_the_test_at_whose_end_or_before_it_ends():
    """``take`` returns the duty of all windows that end at the stamp or before, in any order.

    A window with a stamp in the future delays no other window.
    """
    meter = DutyMeter(deque())
    for number, end_ns in enumerate((10**18, 100, 200, 300)):
        meter.add(block([0.0, 0.1 * (number + 1)], first=10 * number), PARAMETERS)
        meter.cut(end_ns)
    assert travelled(meter.take(250)) == pytest.approx(0.5)
    assert not meter.take(250).hours
    assert travelled(meter.take(300)) == pytest.approx(0.4)


def test_duty_that_belongs_to_no_test_is_limited_and_not_lost():
    meter = DutyMeter(deque(), 100)
    for number in range(150):
        meter.add(block([0.0, 0.1], first=10 * number), PARAMETERS)
        meter.cut(number)
    assert len(meter.pieces) == 100
    assert travelled(meter.take(150)) == pytest.approx(15.0)


@pytest.mark.parametrize("factor", [0.0, -1.0, np.nan, np.inf])
def test_impossible_duty_is_refused(factor: float):
    with pytest.raises(ValueError, match="expected a number above 0"):
        FutureDuty(factor)


def test_duties_add_up():
    both = metered(block([0.0, 0.1, 0.3])) + metered(block([0.0, 0.2], share=0.45), rise=22.0)
    assert classes(both.travel) == [
        (3, pytest.approx(0.3), pytest.approx(0.35)),
        (4, pytest.approx(0.2), pytest.approx(0.45)),
    ]
    assert both.hours == pytest.approx(5 * PERIOD_S / 3600.0)
    assert both.winding[0].sum() == pytest.approx(2 * PERIOD_S / 3600.0)


WHOLE = """
scenarios:
  - name: as flown
  - name: training
    duty: 1.2
    travel_per_hour: 120
    loads: {0.1: 0.8, 0.6: 0.2}
    winding: {60: 0.7, 110: 0.3}
    hours_per_cycle: 2.5
    hours_per_day: 6
"""


def read(folder: Path, content: str) -> tuple[Scenario, ...]:
    path = folder / "scenarios.yaml"
    path.write_text(content)
    return read_scenarios(path)


def test_file_has_one_entry_per_scenario(tmp_path):
    flown, training = read(tmp_path, WHOLE)
    assert flown == Scenario("as flown")
    assert training == Scenario(
        "training", 1.2, 120.0, {0.1: 0.8, 0.6: 0.2}, {60: 0.7, 110: 0.3}, 2.5, 6.0
    )


def test_example_in_the_documentation_is_read(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "prognosis.md").read_text(encoding="utf-8")
    [example] = re.findall(r"^```yaml\n(scenarios:.*?)^```$", text, re.DOTALL | re.MULTILINE)
    flown, training = read(tmp_path, example)
    assert flown == Scenario("as flown")
    assert training.hours_per_day == 6.0


@pytest.mark.parametrize(
    ("row", "texts"),
    [
        ("{}", ["name = ''", "1 to 64 printable"]),
        (f"{{name: {'a' * 65}}}", ["name = ", "1 to 64"]),
        ("{name: a, duty: 0}", ["duty = 0", "[0.001, 1000]"]),
        ("{name: a, travel_per_hour: -1}", ["travel_per_hour = -1 rad/h", "[0, 1e+07]"]),
        ("{name: a, loads: 0.3}", ["loads = 0.3", "values with shares"]),
        ("{name: a, loads: {0.1: 0.5}}", ["loads", "sum to 0.5", "expected 1"]),
        ("{name: a, loads: {-0.1: 1}}", ["loads", "-0.1", "[0, 10]"]),
        ("{name: a, loads: {high: 1}}", ["loads", "'high'", "[0, 10]"]),
        ("{name: a, loads: {0.1: 2}}", ["loads", "share 2 at 0.1", "[0, 1]"]),
        ("{name: a, winding: {900: 1}}", ["winding", "900", "[-60, 300] degC"]),
        ("{name: a, travel: 3}", ["unknown key 'travel'", "travel_per_hour"]),
        ("a", ["scenario 2: a", "a mapping of keys"]),
    ],
)
def test_wrong_scenario_is_refused_by_name(tmp_path, row: str, texts: list[str]):
    with pytest.raises(ValueError, match="scenario 2") as refused:
        read(tmp_path, f"scenarios: [{{name: right}}, {row}]")
    assert all(text in str(refused.value) for text in ["scenarios.yaml", *texts]), refused.value


@pytest.mark.parametrize(
    ("content", "texts"),
    [
        ("", ["None", "expected one key, scenarios, with a list"]),
        ("duties: []", ["duties", "expected one key, scenarios"]),
        ("scenarios: {name: a}", ["'a'", "with a list"]),
        ("scenarios: [{name: a}, {name: a}]", ["scenario 2", "name = 'a' is repeated"]),
        (f"scenarios: [{', '.join(f'{{name: s{n}}}' for n in range(21))}]", ["21", "at most 20"]),
    ],
)
def test_wrong_file_is_refused(tmp_path, content: str, texts: list[str]):
    with pytest.raises(ValueError, match=r"scenarios\.yaml") as refused:
        read(tmp_path, content)
    assert all(text in str(refused.value) for text in texts), refused.value
