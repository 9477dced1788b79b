# SPDX-License-Identifier: Apache-2.0
"""Checks of a drive with an unknown controller: errors, which forbid estimates, and notes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ema_bags.inputs.conversion import convert
from ema_bags.inputs.defect_wording import defect_text
from ema_bags.inputs.defects import find_defects, refused, withholding
from ema_bags.inputs.importing import import_series
from ema_bags.inputs.series import Series
from ema_core.description import ActuatorDescription

from .joint_motion import START_NS, TAU, joint, moves

RPM = 60.0 / (2.0 * np.pi)


def defects_of(mapping, changes: dict[str, Any], *, seconds=12.0, rate_hz=200.0):
    columns, stamps = moves(seconds, rate_hz)
    for name, change in changes.items():
        columns[name] = columns[name] * change
    return find_defects(columns, stamps, mapping, joint(rate_hz))


def test_lagging_joint_has_no_defect(mapped):
    assert defects_of(mapped(), {}) == []


@pytest.mark.parametrize("factor", [0.6, 0.9, 0.956, 1.05, 1.6])
def test_speed_that_differs_slightly_from_the_derivative_is_a_note(mapped, factor):
    [defect] = defects_of(mapped(), {"speed": factor})
    assert (defect.kind, defect.is_error) == ("speed_ratio", False)
    assert (
        f"the speed is {factor:.3g} times the derivative of the position over"
        in defect_text(defect).problem
    )
    assert "strokes: elasticity, lag or sampling" in defect_text(defect).problem
    assert "tau" not in defect_text(defect).remedy


@pytest.mark.parametrize("factor", [0.3, 2.7, 22.0])
def test_speed_ratio_that_no_unit_explains_is_a_note(mapped, factor):
    [defect] = defects_of(mapped(), {"speed": factor})
    assert (defect.kind, defect.is_error) == ("speed_ratio", False)
    assert "no unit, sign or shaft explains it" in defect_text(defect).problem


@pytest.mark.parametrize(
    ("changes", "name", "remedy"),
    [
        ({"speed": RPM}, "speed_unit", "speed: {unit: rpm}"),
        ({"speed": 57.29578}, "speed_unit", "speed: {unit: deg/s}"),
        ({"speed": 1 / (2 * np.pi)}, "speed_unit", "speed: {unit: turn/s}"),
        ({"speed": 1000}, "speed_unit", "speed: {unit: mrad/s}"),
        ({"speed": -1}, "speed_sign_reversed", "speed: {sign: -1}"),
        ({"speed": -0.8}, "speed_sign_reversed", "speed: {sign: -1}"),
        ({"speed": TAU}, "speed_shaft", "speed: {shaft: user}"),
        ({"speed": 1.12 * TAU}, "speed_shaft", "speed: {shaft: user}"),
        ({"command": 57.29578}, "command_unit", "command: {unit: deg}"),
        ({"position": 1 / TAU}, "position_shaft", "position: {shaft: motor}"),
        ({"position": -1}, "position_sign_reversed", "position: {sign: -1}"),
        ({"current": -1}, "current_sign_reversed", "current: {sign: -1}"),
    ],
)
def test_factor_near_a_unit_is_an_error_that_is_certain_after_some_strokes(
    mapped, changes, name, remedy
):
    [defect] = defects_of(mapped(), changes)
    assert (defect.kind, defect.is_error, defect.is_certain) == (name, True, True)
    assert remedy in defect_text(defect).remedy


@pytest.mark.parametrize(
    ("factor", "names"),
    [
        (-57.29578, {"speed_unit", "speed_sign_reversed"}),
        (RPM * TAU, {"speed_unit", "speed_shaft"}),
        (-TAU, {"speed_shaft", "speed_sign_reversed"}),
    ],
)
def test_product_of_two_units_is_named_with_both(mapped, factor, names):
    defects = defects_of(mapped(), {"speed": factor})
    assert {item.kind for item in defects} == names
    assert all(item.is_error for item in defects)


def test_unit_of_one_stroke_is_an_error_that_does_not_withhold_yet(mapped):
    mapping = mapped()
    defects = defects_of(mapping, {"speed": RPM}, seconds=0.5)
    assert [item.kind for item in refused(defects, mapping)] == ["speed_unit"]
    assert withholding(defects, mapping) == []


def test_current_that_holds_a_load_against_gravity_is_not_mistaken_for_reversed(mapped):
    """The torque that holds a heavy load has the opposite sign half of the time."""
    columns, stamps = moves()
    columns["current"] += -6.0 * np.sin(columns["position"] + 0.4)
    assert find_defects(columns, stamps, mapped(), joint()) == []


def test_encoder_of_few_counts_is_not_blocked(mapped):
    """With 12 bits at 100 Hz, the joint moves only a few encoder steps per sample."""
    columns, stamps = moves(rate_hz=100.0, travel=0.2)
    count = 2.0 * np.pi / 4096
    columns["position"] = np.round(columns["position"] / count) * count
    columns["current"] = np.round(columns["current"] / 2.7e-3) * 2.7e-3
    assert refused(find_defects(columns, stamps, mapped(), joint(100.0)), mapped()) == []


def test_rate_that_differs_by_a_few_per_cent_is_a_note(mapped):
    columns, stamps = moves(rate_hz=195.0)
    series = Series(stamps, stamps, {name: values for name, values in columns.items()})
    imported = import_series({"": series}, mapped(), joint(200.0))
    [defect] = imported.defects
    assert (defect.kind, defect.is_error) == ("other_rate", False)
    assert "rate is 195 Hz, but the description has 200" in defect_text(defect).problem
    assert imported.description.sample_period == pytest.approx(1 / 195)


@pytest.mark.parametrize("lag", [0, 2])
def test_position_that_equals_the_command_is_named(mapped, lag):
    columns, stamps = moves()
    columns["position"] = np.concatenate([columns["command"][:1]] * lag + [columns["command"]])
    columns["position"] = columns["position"][: len(stamps)]
    [defect] = find_defects(columns, stamps, mapped(), joint())
    assert (defect.kind, defect.is_error) == ("position_commanded", False)
    assert "a setpoint, not a measurement" in defect_text(defect).problem


def test_speed_of_the_command_is_named(mapped):
    columns, stamps = moves()
    columns["speed"] = np.gradient(columns["command"], 5e-3) / TAU
    [defect] = find_defects(columns, stamps, mapped(), joint())
    assert defect.kind == "speed_commanded"


def test_commanded_current_is_named(mapped):
    columns, stamps = moves()
    error = columns["command"] - columns["position"]
    columns["current"] = 12.0 * error - 0.1 * columns["speed"] * TAU + 0.3
    [defect] = find_defects(columns, stamps, mapped(), joint())
    assert (defect.kind, defect.is_error) == ("current_commanded", False)
    assert "the current follows position error and speed exactly" in defect_text(defect).problem


def test_sensor_that_repeats_its_value_is_named_with_its_rate(mapped):
    columns, stamps = moves()
    columns["current"] = np.repeat(columns["current"][::15], 15)[: len(stamps)]
    [defect] = find_defects(columns, stamps, mapped(), joint())
    assert (defect.kind, defect.is_error) == ("values_repeat", False)
    assert (
        "the current repeats each value 15 times (updated at 13.33 Hz)"
        in defect_text(defect).problem
    )


def test_position_that_is_updated_irregularly_is_named(mapped):
    columns, stamps = moves()
    is_new = np.random.default_rng(3).random(len(stamps)) < 0.3
    rows = np.maximum.accumulate(np.where(is_new, np.arange(len(stamps)), 0))
    columns["position"] = columns["position"][rows]
    [defect] = [
        item
        for item in find_defects(columns, stamps, mapped(), joint())
        if item.kind == "values_repeat"
    ]
    assert not defect.is_error
    assert "the position is updated every 3." in defect_text(defect).problem
    assert "samples on average, irregularly" in defect_text(defect).problem


def test_position_that_jumps_is_an_error(mapped):
    columns, stamps = moves()
    columns["position"][1000:] += 0.3
    columns["command"][1000:] += 0.3
    names = [item.kind for item in find_defects(columns, stamps, mapped(), joint())]
    assert "position_jumps" in names


def test_position_that_is_homed_at_rest_is_an_error_once_motion_follows(mapped):
    position = np.round(moves()[0]["position"] / 1e-4) * 1e-4
    homed = np.concatenate([np.full(300, 0.7), position])
    still = np.concatenate([homed[:302], np.full(len(homed) - 302, homed[301])])
    stamps = START_NS + 5_000_000 * np.arange(len(homed))
    for values, is_judged in ((homed, True), (still, False)):
        columns = {
            "command": np.empty(0),
            "position": values,
            "speed": np.empty(0),
            "current": np.zeros(len(values)),
        }
        names = [item.kind for item in find_defects(columns, stamps, mapped(), joint())]
        assert ("position_jumps" in names) == is_judged


@pytest.mark.parametrize("rate_hz", [50.0, 250.0, 1000.0])
@pytest.mark.parametrize("count", [1e-12, 1e-5, 1e-4])
def test_motion_after_a_long_rest_is_not_a_jump(mapped, rate_hz, count):
    """Live telemetry is judged at every stage of the rest and of the first motion."""
    rest = round(10.0 * rate_hz)
    times = np.arange(1, round(0.5 * rate_hz) + 1) / rate_hz
    position = np.concatenate([np.zeros(rest), 20.0 * times**2])
    position = np.round(position / count) * count
    stamps = START_NS + np.rint(1e9 / rate_hz * np.arange(rest)).astype(np.int64)
    for moved in range(1, len(times) + 1):
        columns = {
            "command": np.empty(0),
            "position": position[moved : moved + rest],
            "speed": np.empty(0),
            "current": np.random.default_rng(moved).normal(0.0, 0.1, rest),
        }
        defects = find_defects(columns, stamps, mapped(), joint(rate_hz))
        assert "position_jumps" not in [item.kind for item in defects], moved


@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_few_quick_moves_in_a_long_record_are_not_jumps(mapped, noise):
    """The record lasts 10 min at 50 Hz, with a move of 0.3 s every 100 s."""
    ramp = (1.0 - np.cos(np.pi * np.arange(1, 16) / 15)) / 2.0
    rest = np.zeros(5000)
    position = np.concatenate([rest, ramp, rest + 1.0, 1.0 - ramp] * 3)
    rng = np.random.default_rng(0)
    columns = {
        "command": np.empty(0),
        "position": np.round((position + rng.normal(0.0, noise, len(position))) / 1e-5) * 1e-5,
        "speed": np.empty(0),
        "current": rng.normal(0.0, 0.1, len(position)),
    }
    stamps = START_NS + 20_000_000 * np.arange(len(position))
    defects = find_defects(columns, stamps, mapped(), joint(50.0))
    assert "position_jumps" not in [item.kind for item in defects]


def test_drive_without_a_command_is_imported_with_an_empty_column(mapped):
    columns, stamps = moves()
    mapping = mapped(command=None)
    assert not mapping.acquisition.command
    values = {name: values for name, values in columns.items() if name != "command"}
    series = Series(stamps, stamps, values)
    imported = import_series({"": series}, mapping, joint())
    assert imported.defects == []
    assert not imported.description.acquisition.command
    blocks = list(imported.blocks())
    assert not any(block.has_command for block in blocks)
    position = np.concatenate([block.position for block in blocks])
    np.testing.assert_array_equal(position, columns["position"])


@pytest.mark.parametrize(("rate_hz", "length"), [(25.0, 20), (200.0, 20), (1000.0, 50)])
def test_block_of_a_slow_table_has_many_samples(mapped, rate_hz, length):
    """Reading a block takes as long as reading many samples.

    With one sample per block, 65 s at 25 Hz took 0.5 s.
    """
    columns, _ = moves()
    stamps = (1e9 / rate_hz * np.arange(len(columns["position"]))).astype(np.int64)
    values = {name: column for name, column in columns.items() if name != "speed"}
    mapping = mapped(speed=None)
    imported = import_series({"": Series(stamps, stamps, values)}, mapping, joint())
    blocks = list(imported.blocks())
    assert {len(block) for block in blocks[:-1]} == {length}
    assert sum(map(len, blocks)) == len(stamps)
    position = np.concatenate([block.position for block in blocks])
    np.testing.assert_allclose(position, columns["position"], atol=1e-12)


def test_modelled_drive_needs_a_command(mapped):
    columns, stamps = moves()
    series = Series(stamps, stamps, columns)
    six_step = replace(joint(), drive="six_step", acquisition=ActuatorDescription().acquisition)
    with pytest.raises(ValueError, match=r"no position command with drive = six_step"):
        import_series({"": series}, mapped(command=None), six_step)


@pytest.mark.parametrize(
    ("source", "factor"),
    [
        ({"unit": "A"}, 1.0),
        ({"unit": "mA"}, 1e-3),
        ({"unit": "N.m"}, TAU / 0.05),
        ({"unit": "N"}, 1.0),
        ({"unit": "N.m", "kind": "joint_torque"}, TAU / 0.05),
        ({"unit": "N.m", "kind": "motor_torque"}, 1.0 / 0.05),
        ({"unit": "N", "kind": "force"}, 1.0),
    ],
)
def test_effort_of_an_unknown_drive_may_be_a_current_a_torque_or_a_force(mapped, source, factor):
    columns, _ = moves()
    mapping = mapped(current={"source": "i", **source})
    converted = convert(columns, mapping, joint())
    np.testing.assert_allclose(converted["current"], factor * columns["current"], rtol=1e-12)


def test_unknown_linear_drive_needs_no_lead(mapped):
    columns, stamps = moves()
    mapping = mapped(
        command=None,
        speed=None,
        position={"source": "position", "unit": "mm"},
        current={"source": "i", "unit": "N", "kind": "force"},
    )
    unit = replace(joint(), parameters=replace(joint().parameters, tau=1.0, k_t=1.0))
    imported = import_series({"": Series(stamps, stamps, columns)}, mapping, unit)
    assert imported.description.acquisition.effort_unit == "N"
    way = imported.description.parameters.lead / (2.0 * np.pi)
    blocks = list(imported.blocks())
    position = np.concatenate([block.position for block in blocks])
    effort = np.concatenate([block.current for block in blocks])
    np.testing.assert_allclose(position * way, 1e-3 * columns["position"], atol=1e-12)
    np.testing.assert_allclose(effort / way, columns["current"], rtol=1e-9)


def test_lead_in_the_mapping_applies_to_an_unknown_drive(mapped):
    columns, stamps = moves()
    mapping = mapped(
        command=None,
        speed=None,
        position={"source": "position", "unit": "mm", "lead": 0.004},
        current={"source": "i"},
    )
    imported = import_series({"": Series(stamps, stamps, columns)}, mapping, joint())
    assert imported.description.parameters.lead == 0.004


def test_force_of_a_screw_becomes_the_torque_of_its_motor(mapped):
    columns, _ = moves()
    screw = replace(joint(), parameters=replace(joint().parameters, lead=0.01))
    mapping = mapped(current={"source": "i", "unit": "N", "kind": "force"})
    force = convert(columns, mapping, screw)["current"]
    torque = columns["current"] * 0.01 / (2.0 * np.pi) * TAU
    np.testing.assert_allclose(force * 0.05, torque, rtol=1e-12)


def test_modelled_drive_refuses_a_torque_as_its_current(mapped):
    columns, _ = moves()
    mapping = mapped(current={"source": "i", "unit": "N.m"})
    with pytest.raises(ValueError, match=r"unit = N\.m with kind = equivalent and drive = six_st"):
        convert(columns, mapping, ActuatorDescription())


def test_joint_that_settles_after_its_command_withholds_nothing(mapped):
    """The command is constant from the first sample on. With more motion, it is another joint's."""
    mapping = mapped()
    short = defects_of(mapping, {"command": 0.0}, seconds=0.6)
    assert [item.kind for item in refused(short, mapping)] == ["command_frozen"]
    assert withholding(short, mapping) == []
    [long] = withholding(defects_of(mapping, {"command": 0.0}), mapping)
    assert long.kind == "command_frozen"
    assert "or omit command" in defect_text(long).remedy


def test_motion_starts_at_its_first_stamp():
    assert moves()[1][0] == START_NS + 5_000_000
