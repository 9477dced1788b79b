# SPDX-License-Identifier: Apache-2.0
"""Columns with repeated values, angles that wrap, and physically impossible samples."""

import numpy as np
import pytest

from ema_bags.inputs.defect_wording import defect_text
from ema_bags.inputs.held import find_held, renewed_rows
from ema_bags.inputs.importing import SampleStream, import_series
from ema_bags.inputs.impossible import ImpossibleSampleRepair
from ema_bags.inputs.limits import limits_of
from ema_bags.inputs.rate import find_rate
from ema_bags.inputs.series import Series
from ema_bags.inputs.wrapping import Unwrapper
from ema_core.columns.errors import WrappedColumn
from ema_core.columns.repetition import held_samples

from .conftest import described
from .joint_motion import joint, moves


def imported(mapping, columns, stamps, rate_hz):
    return import_series({"": Series(stamps, stamps, columns)}, mapping, joint(rate_hz))


@pytest.mark.parametrize("held", [2, 3, 5, 15])
def test_repeated_values_are_distinguished_from_a_coarse_encoder(held):
    columns, _ = moves(20.0, 1000.0)
    position = columns["position"]
    assert held_samples(np.repeat(position[::held], held)) == held
    coarse = np.round(position / 1.5e-3) * 1.5e-3
    assert held_samples(coarse) == 1
    assert held_samples(position) == 1


def test_publisher_with_a_separate_clock_repeats_values_a_varying_number_of_times():
    columns, _ = moves(20.0, 1000.0)
    phase = np.floor(np.arange(20_000) * 0.2013).astype(int)
    assert held_samples(columns["current"][phase]) == 5


def test_states_renewed_at_200_hz_and_published_at_1000_hz_are_resampled(mapped):
    slow, _ = moves(12.0, 200.0)
    columns = {name: np.repeat(values, 5) for name, values in slow.items()}
    _, stamps = moves(12.0, 1000.0)
    assert find_held(columns) == {"position": 5, "speed": 5, "current": 5}
    got = imported(mapped(), columns, stamps, 1000.0)
    assert 1.0 / got.description.sample_period == pytest.approx(200.0)
    [defect] = got.defects
    assert (defect.kind, defect.is_error) == ("values_repeat", False)
    assert (
        "published 5 times: updated at 200 Hz, published at 1000 Hz" in defect_text(defect).problem
    )
    [run] = got.runs
    position = run.values[:, got.stream.filled.index("position")]
    np.testing.assert_array_equal(position, slow["position"])


def test_columns_of_different_rates_are_not_resampled():
    columns, _ = moves(12.0, 1000.0)
    columns["current"] = np.repeat(columns["current"][::5], 5)
    assert renewed_rows(columns) is None


def wrapped(values, period, lowest):
    return (values - lowest) % period + lowest


@pytest.mark.parametrize(
    ("source", "period", "lowest"),
    [
        ({"unit": "rad"}, 2.0 * np.pi, -np.pi),
        ({"unit": "rad"}, 2.0 * np.pi, 0.0),
        ({"unit": "deg"}, 360.0, -180.0),
        ({"unit": "turn"}, 1.0, 0.0),
        ({"unit": "turn", "scale": 1.0 / 4096}, 4096.0, 0.0),
        ({"unit": "rad"}, 65536.0, 0.0),
    ],
)
@pytest.mark.parametrize("block", [7, 10_000])
def test_angle_is_unwrapped_across_the_limits_of_its_register(
    mapped, source, period, lowest, block
):
    """Two and a half turns in each direction, in blocks and as a whole."""
    angle = 2.5 * period * np.sin(np.linspace(0.0, 9.0, 4000))
    if period > 1000.0:
        angle = np.floor(angle)
    mapping = mapped(position={"source": "p", **source}, command=None)
    unwrapper = Unwrapper(mapping)
    register = wrapped(angle, period, lowest)
    parts = [
        unwrapper.push({"position": register[i : i + block]})["position"]
        for i in range(0, len(angle), block)
    ]
    continued = np.concatenate(parts)
    np.testing.assert_allclose(continued - continued[0], angle - angle[0], atol=1e-9 * period)
    jumps = np.count_nonzero(np.abs(np.diff(register)) > 0.5 * period)
    assert unwrapper.wrapped == {"position": WrappedColumn("position", period, int(jumps))}


def test_command_that_wraps_first_begins_in_the_turn_of_the_position(mapped):
    position = np.linspace(3.0, 3.5, 200)
    command = position + 0.2
    ahead = {"position": position, "command": wrapped(command, 2.0 * np.pi, -np.pi)}
    cut = {name: values[20:] for name, values in ahead.items()}
    got = Unwrapper(mapped()).push(cut)
    np.testing.assert_allclose(got["command"] - got["position"], 0.2, atol=1e-12)


def test_fast_turn_between_two_samples_is_not_mistaken_for_a_wrap(mapped):
    angle = np.cumsum(np.full(500, 0.9 * 2.0 * np.pi))
    unwrapper = Unwrapper(mapped(command=None))
    np.testing.assert_array_equal(unwrapper.push({"position": angle})["position"], angle)
    assert unwrapper.wrapped == {}


def test_wraps_are_counted_by_the_import(mapped):
    columns, stamps = moves(travel=2.0)
    true = columns["position"].copy()
    for name in ("position", "command"):
        columns[name] = wrapped(columns[name] + np.pi, 2.0 * np.pi, -np.pi)
    got = imported(mapped(), columns, stamps, 200.0)
    [defect] = got.defects
    assert (defect.kind, defect.is_error) == ("angle_wraps", False)
    moved = got.columns["position"]
    np.testing.assert_allclose(moved - moved[0], true - true[0], atol=1e-12)


def pushed(target, columns, block):
    """Return the output columns for samples pushed in blocks of a length."""
    n = len(columns["position"])
    parts = [
        target.push(
            np.arange(i, min(i + block, n)),
            {name: values[i : i + block] for name, values in columns.items()},
            is_last=i + block >= n,
        )
        for i in range(0, n, block)
    ]
    return {
        "stamps_ns": np.concatenate([stamps for stamps, _ in parts]),
        **{name: np.concatenate([part[name] for _, part in parts]) for name in columns},
    }


@pytest.mark.parametrize("block", [1, 10, 10_000])
def test_messages_of_zeros_are_bridged_and_counted(mapped, block):
    columns, _ = moves()
    columns["position"] += 1.0
    rows = [700, 1201, 1202]
    spoiled = {name: values.copy() for name, values in columns.items()}
    for name in ("position", "speed", "current"):
        spoiled[name][rows] = 0.0
    target = ImpossibleSampleRepair(mapped())
    position = pushed(target, spoiled, block)["position"]
    assert target.count == len(rows)
    step = np.max(np.abs(np.diff(columns["position"])))
    assert np.max(np.abs(position - columns["position"])) < 0.5 * step
    np.testing.assert_array_equal(np.delete(position, rows), np.delete(columns["position"], rows))


@pytest.mark.parametrize(
    ("name", "value"), [("current", 9.9e37), ("speed", -9.9e37), ("position", 40.0)]
)
def test_single_impossible_sample_is_a_note(mapped, name, value):
    columns, stamps = moves()
    true = columns[name].copy()
    columns[name][1500] = value
    got = imported(mapped(), columns, stamps, 200.0)
    [defect] = got.defects
    assert (defect.kind, defect.is_error) == ("impossible_samples", False)
    assert "1 sample of 2400 physically impossible" in defect_text(defect).problem
    near = np.max(np.abs(true[1495:1506] - true[1500]))
    assert abs(got.columns[name][1500] - true[1500]) <= near


def test_many_impossible_samples_are_an_error(mapped):
    columns, stamps = moves()
    columns["current"][::50] = 9.9e37
    got = imported(mapped(), columns, stamps, 200.0)
    [defect] = [item for item in got.defects if item.kind == "impossible_samples"]
    assert defect.is_error


def test_rest_at_zero_is_not_impossible(mapped):
    columns, _ = moves()
    still = {name: np.where(np.arange(2400) > 800, 0.0, values) for name, values in columns.items()}
    target = ImpossibleSampleRepair(mapped())
    pushed(target, still, 10)
    assert target.count == 0


GLITCHES = [
    ("position", 2.0 * np.pi),
    ("position", -0.02),
    ("speed", 1e5),
    ("current", -32767.0),
    ("speed", 9.9e37),
]


@pytest.mark.parametrize(("name", "value"), GLITCHES)
@pytest.mark.parametrize("length", [1, 3])
@pytest.mark.parametrize("block", [1, 2, 7, 2000])
def test_sample_impossible_for_the_described_motor_is_bridged(
    mapped, telemetry, columns, name, value, length, block
):
    """The drive is modelled; samples come in blocks, as from the bridge, and as a whole."""
    spoiled = {key: values.copy() for key, values in columns.items()}
    for row in (300, 1000, 1201):
        spoiled[name][row : row + length] += value
    mapping, description = mapped(), described(1000)
    stream = SampleStream(mapping, description, find_rate(telemetry.stamps_ns))
    got = [
        stream.push_joined(
            {key: values[i : i + block] for key, values in spoiled.items()},
            telemetry.stamps_ns[i : i + block],
            is_last=i + block >= len(telemetry),
        ).columns[name]
        for i in range(0, len(telemetry), block)
    ]
    # An added turn may also count as two wraps.
    wraps = stream.losses.wraps // 2
    assert stream.losses.impossible + length * wraps == 3 * length
    assert not wraps or value == 2.0 * np.pi
    # The error is at most the motion within the bridged or held samples.
    most = 2 * length * np.max(np.abs(np.diff(columns[name])))
    assert np.max(np.abs(np.concatenate(got) - columns[name])) <= most


@pytest.mark.parametrize("block", [1, 3, 2000])
def test_healthy_test_cycle_has_no_impossible_sample(mapped, telemetry, columns, block):
    target = ImpossibleSampleRepair(mapped(), limits_of(mapped(), described(1000), 1e-3))
    got = pushed(target, columns, block)
    for name, values in columns.items():
        np.testing.assert_array_equal(got[name], values)
    assert target.count == 0


def test_lasting_jump_is_not_a_single_sample(mapped, telemetry, columns):
    columns["position"] = np.where(np.arange(len(telemetry)) > 900, 0.5, 0.0) + columns["position"]
    for block in (1, 2, 2000):
        target = ImpossibleSampleRepair(mapped(), limits_of(mapped(), described(1000), 1e-3))
        pushed(target, columns, block)
        assert target.count == 0


def test_glitch_of_one_turn_is_bridged_for_a_joint_with_a_wide_range(mapped):
    """The range of the joint is wider than the glitch."""
    position = 20.0 * np.sin(np.linspace(0.0, 12.0, 4000))
    spoiled = position.copy()
    spoiled[[700, 2100]] += 2.0 * np.pi
    target = ImpossibleSampleRepair(mapped(command=None))
    repaired = pushed(target, {"position": spoiled}, len(spoiled))["position"]
    assert target.count == 2
    assert np.max(np.abs(repaired - position)) < 0.01


def test_limits_are_in_the_units_of_the_sources(mapped):
    """The sources are in degrees of the motor, rpm and mA."""
    mapping = mapped(
        position={"source": "p", "unit": "deg", "shaft": "motor"},
        speed={"source": "s", "unit": "rpm"},
        current={"source": "i", "unit": "mA"},
    )
    parameters = described(1000).parameters
    top = max(parameters.omega_max, parameters.V_max / parameters.k_e)
    assert limits_of(mapping, described(1000), 1e-3) == pytest.approx(
        {
            "position": np.rad2deg(2.0 * top * 1e-3),
            "speed": 3.0 * top * 30.0 / np.pi,
            "current": 3.0 * parameters.I_max * 1e3,
        }
    )
    assert limits_of(mapping, joint(1000.0), 1e-3) == {}


@pytest.mark.parametrize("held", [5, 15])
@pytest.mark.parametrize(
    "names", [("position", "speed", "current"), ("position",), ("speed",), ("current",)]
)
def test_repeated_values_of_a_modelled_drive_raise_no_doubt_about_gears_or_scales(
    mapped, telemetry, columns, names, held
):
    """If all columns repeat values, they are resampled; single repeating columns are refused."""
    for name in names:
        columns[name] = np.repeat(columns[name][::held], held)[: len(telemetry)]
    got = import_series(
        {"": Series(telemetry.stamps_ns, telemetry.stamps_ns, columns)}, mapped(), described(1000)
    )
    repeats, *remaining = got.defects
    assert repeats.kind == "values_repeat"
    assert f"{held} times" in defect_text(repeats).problem
    is_whole = len(names) == 3
    assert repeats.is_error == (not is_whole)
    assert 1.0 / got.rate.period == pytest.approx(1000.0 / held if is_whole else 1000.0)
    words = " ".join(str(defect_text(item).remedy) for item in got.defects)
    assert "tau" not in words
    assert "scale" not in words
    assert all(
        item.kind == "gear_ratio" and "too slow" in defect_text(item).remedy for item in remaining
    )
