# SPDX-License-Identifier: Apache-2.0
"""Corrupt samples of joints with unknown limits, in files and live."""

import numpy as np
import pytest

from ema_bags.inputs.defect_wording import defect_text
from ema_bags.inputs.excursions import find_excursions
from ema_bags.inputs.importing import import_series
from ema_bags.inputs.series import Series

from .joint_motion import joint, moves


def imported(mapping, columns, stamps, rate_hz):
    return import_series({"": Series(stamps, stamps, columns)}, mapping, joint(rate_hz))


def in_blocks(values, block):
    """Return the first samples of the excursions detected live, and the longest wait."""
    past, waiting, rows, longest = np.empty(0), np.empty(0), [], 0
    for i in range(0, len(values), block):
        part = np.concatenate([waiting, values[i : i + block]])
        series = np.concatenate([past, part])
        excursions = find_excursions(series, len(past), is_last=False)
        passed = len(part) if excursions.first_open is None else excursions.first_open - len(past)
        start = i + len(values[i : i + block]) - len(part)
        rows += [start + first - len(past) for first, _ in excursions.parts]
        past, waiting = np.concatenate([past, part[:passed]])[-1000:], part[passed:]
        longest = max(longest, len(waiting))
    return rows, longest


@pytest.mark.parametrize("rate_hz", [50.0, 250.0, 1000.0])
@pytest.mark.parametrize("length", [1, 2, 3])
@pytest.mark.parametrize("travel", [0.08, 1.4])
def test_samples_that_leave_and_return_are_excursions(rate_hz, length, travel):
    position = moves(max(6.0, 600.0 / rate_hz), rate_hz, travel)[0]["position"]
    fastest = np.max(np.abs(np.diff(position)))
    spoiled, rows = position.copy(), [len(position) // 3, len(position) // 2 + 7]
    for row, sign in zip(rows, (1.0, -1.0), strict=True):
        spoiled[row : row + length] += sign * (5.0 * fastest + 0.04 * travel)
    parts = [(row, row + length) for row in rows]
    assert find_excursions(spoiled).parts == parts
    for block in (5, 12):
        assert in_blocks(spoiled, block)[0] == rows
    assert find_excursions(position).parts == []


def impacts(rate_hz, rng):
    """Return a joint that swings between hard stops and bounces."""
    fine, angle, speed, values = 20, 0.0, 0.0, []
    for i in range(round(15 * rate_hz) * fine):
        goal = 1.0 if (i / (fine * rate_hz)) % 1.7 < 0.8 else -1.0
        speed += (20.0 * goal - speed) / (fine * rate_hz)
        angle += speed / (fine * rate_hz)
        if abs(angle) > 0.5:
            angle, speed = 0.5 * np.sign(angle), -0.5 * speed
        if i % fine == 0:
            values.append(angle + rng.normal(0.0, 1e-5))
    return np.array(values)


def on_and_off(rate_hz, rng):
    """Return a valve that occasionally opens in 60 ms."""
    times = np.arange(round(40 * rate_hz)) / rate_hz
    ways = np.cumsum(rng.uniform(1.0, 5.0, 20))
    ramps = [np.clip((times - at) / 0.06, 0.0, 1.0) * (-1.0) ** i for i, at in enumerate(ways)]
    return np.sum(ramps, axis=0) + rng.normal(0.0, 1e-5, len(times))


def knocks(rate_hz, rng):
    """Return a gear with play that rings at 60 Hz after each reversal."""
    times = np.arange(round(20 * rate_hz)) / rate_hz
    phase = (times - 0.5) % 1.0
    ringing = 0.01 * np.exp(-phase / 0.01) * np.cos(2.0 * np.pi * 60.0 * phase)
    return 0.5 * np.sin(np.pi * times) + ringing + rng.normal(0.0, 1e-5, len(times))


@pytest.mark.parametrize("motion", [impacts, on_and_off, knocks])
@pytest.mark.parametrize("rate_hz", [50, 200, 1000])
@pytest.mark.parametrize("count", [0.0, 2.0 * np.pi / 4096])
def test_quick_motion_is_not_an_excursion(motion, rate_hz, count):
    values = motion(rate_hz, np.random.default_rng(3))
    if count:
        values = np.round(values / count) * count
    assert find_excursions(values).parts == []
    rows, longest = in_blocks(values, 10)
    assert rows == []
    assert longest <= 5


@pytest.mark.parametrize("size", [-3.0, 90.0, -32768.0, 1e20])
@pytest.mark.parametrize("length", [1, 3])
def test_corrupt_command_is_bridged_and_the_sensors_are_kept(mapped, size, length):
    columns, stamps = moves(rate_hz=250.0)
    true = {name: values.copy() for name, values in columns.items()}
    columns["command"][1700 : 1700 + length] += size
    got = imported(mapped(), columns, stamps, 250.0)
    [defect] = got.defects
    assert (defect.kind, defect.is_error) == ("impossible_samples", False)
    assert got.stream.losses.impossible == length
    for name in ("position", "speed", "current"):
        np.testing.assert_array_equal(got.columns[name], true[name])
    np.testing.assert_allclose(got.columns["command"], true["command"], atol=0.01)


@pytest.mark.parametrize("length", [7, 20])
def test_command_beyond_all_travel_for_longer_is_reported(mapped, length):
    columns, stamps = moves(rate_hz=250.0)
    columns["command"][1200 : 1200 + length] = -32768.0
    got = imported(mapped(), columns, stamps, 250.0)
    [defect] = [item for item in got.defects if item.is_error]
    assert (defect.kind, defect.is_certain) == ("command_range", False)
    assert (
        "the command is -3.277e+04 rad, far outside the travel from -0.2"
        in defect_text(defect).problem
    )
    assert f"in {length} samples of 3000" in defect_text(defect).problem


def test_steps_of_the_set_point_are_not_bridged(mapped):
    columns, stamps = moves()
    columns["command"] = np.array([0.0, 0.4, 0.8])[np.arange(len(stamps)) // 170 % 3]
    got = imported(mapped(), columns, stamps, 200.0)
    np.testing.assert_array_equal(got.columns["command"], columns["command"])
    assert got.stream.losses.impossible == 0


@pytest.mark.parametrize(("rate_hz", "length"), [(100.0, 5), (500.0, 12), (1000.0, 60)])
def test_outage_of_zeros_is_a_gap(mapped, rate_hz, length):
    columns, stamps = moves(rate_hz=rate_hz)
    columns["position"] += 0.9
    columns["command"] += 0.9
    first = len(stamps) // 2
    for values in columns.values():
        values[first : first + length] = 0.0
    got = imported(mapped(), columns, stamps, rate_hz)
    assert {item.kind: item.is_error for item in got.defects} == {
        "lost_samples": False,
        "impossible_samples": False,
    }
    assert (got.stream.losses.impossible, got.stream.losses.lost) == (length, length)
    assert [run.first_index for run in got.runs] == [1, first + length + 1]


@pytest.mark.parametrize(("rate_hz", "length"), [(100.0, 4), (200.0, 10), (500.0, 12)])
def test_zeros_in_a_moving_command_are_a_gap(mapped, rate_hz, length):
    columns, stamps = moves(rate_hz=rate_hz)
    columns["command"] += 0.9
    steps = np.abs(np.diff(columns["command"]))
    first = int(np.flatnonzero(steps > 0.5 * np.max(steps))[len(stamps) // 10])
    columns["command"][first : first + length] = 0.0
    got = imported(mapped(), columns, stamps, rate_hz)
    assert {item.kind: item.is_error for item in got.defects} == {
        "lost_samples": False,
        "impossible_samples": False,
    }
    assert (got.stream.losses.impossible, got.stream.losses.lost) == (length, length)
    assert [run.first_index for run in got.runs] == [1, first + length + 1]


@pytest.mark.parametrize("length", [10, 60])
def test_command_that_pulses_or_rests_at_zero_is_kept(mapped, length):
    columns, stamps = moves()
    rests = np.array(columns["command"])
    rests[np.abs(rests) < 0.02] = 0.0
    pulses = np.where(np.arange(len(stamps)) % 100 < length, 0.0, 0.4)
    for command in (rests, pulses):
        got = imported(mapped(), columns | {"command": command}, stamps, 200.0)
        np.testing.assert_array_equal(got.columns["command"], command)
        assert got.stream.losses.impossible == 0


@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 1000.0])
@pytest.mark.parametrize("size", [0.12, -0.25])
def test_step_of_the_position_is_reported(mapped, rate_hz, size):
    columns, stamps = moves(rate_hz=rate_hz)
    columns["position"][round(0.6 * len(stamps)) :] += size
    got = imported(mapped(), columns, stamps, rate_hz)
    assert "position_jumps" in [item.kind for item in got.defects if item.is_error]


@pytest.mark.parametrize("length", [5, 9, 30])
@pytest.mark.parametrize("at", [0.52, 0.55, 0.61])
def test_longer_excursion_of_the_position_is_reported(mapped, length, at):
    """The excursion occurs in motion and at rest."""
    columns, stamps = moves(rate_hz=250.0)
    row = round(at * len(stamps))
    columns["position"][row : row + length] += 0.2
    got = imported(mapped(), columns, stamps, 250.0)
    assert "position_jumps" in [item.kind for item in got.defects if item.is_error]


def test_position_after_repeated_values_does_not_count_as_a_jump(mapped):
    columns, stamps = moves(travel=1.0)
    row = int(np.argmax(np.abs(np.diff(columns["position"]))))
    for values in columns.values():
        values[row - 10 : row + 10] = values[row - 10]
    got = imported(mapped(), columns, stamps, 200.0)
    assert [item.kind for item in got.defects] == []
