# SPDX-License-Identifier: Apache-2.0
"""Defects are named before any estimate, with their value and the correction of the mapping."""

import re
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from ema_bags.inputs import defect_wording
from ema_bags.inputs.defect_kinds import DefectKind
from ema_bags.inputs.defect_wording import defect_line, defect_text
from ema_bags.inputs.defects import find_defects, not_finite, refused, stream_defects
from ema_bags.inputs.input_defect import Evidence, LostSamples, SampleCount, WrongStamps
from ema_bags.inputs.resampling import Losses
from ema_core.telemetry import COLUMNS
from ema_sim import simulate

from .conftest import described

FLAP = described(1000)
TAU = FLAP.parameters.tau
RPM = 60.0 / (2.0 * np.pi)


@pytest.fixture
def defects_of(telemetry, columns, mapped):
    """Return a function that finds defects of a cycle with scaled or replaced columns."""

    def find(mapping=None, **changes):
        spoiled = dict(columns)
        for name, change in changes.items():
            values = columns[name]
            spoiled[name] = change(values) if callable(change) else values * change
        defects = find_defects(spoiled, telemetry.stamps_ns, mapping or mapped(), FLAP)
        return [*not_finite(spoiled), *defects]

    return find


def test_correct_columns_have_no_defects(defects_of):
    assert defects_of() == []


@pytest.mark.parametrize(
    ("changes", "name", "value", "remedy"),
    [
        ({"current": 0.0}, "current_zero", "current is 0 in all 1700 samples", "sampling: none"),
        ({"current": lambda x: 0 * x + 2}, "current_frozen", "is 2 in", "omit current"),
        ({"speed": lambda x: 0 * x + 3}, "speed_frozen", "speed is 3 in", "omit speed"),
        ({"position": 0.0}, "position_frozen", "position is 0", "choose another source"),
        ({"command": 0.0}, "command_frozen", "command is 0", "choose another source"),
        ({"position": 57.29578}, "position_unit", "56.", "position: {unit: deg}"),
        ({"command": 57.29578}, "command_unit", "rad, but is probably deg", "command: {unit: deg}"),
        ({"speed": RPM}, "speed_unit", "is probably rpm", "speed: {unit: rpm}"),
        ({"speed": 57.29578}, "speed_unit", "is probably deg/s", "speed: {unit: deg/s}"),
        ({"speed": 1 / (2 * np.pi)}, "speed_unit", "is probably turn/s", "speed: {unit: turn/s}"),
        ({"position": -1}, "position_sign_reversed", "-0.98", "position: {sign: -1}"),
        ({"command": -1}, "command_sign_reversed", "-0.98", "command: {sign: -1}"),
        ({"speed": -1}, "speed_sign_reversed", "-1 times the speed", "speed: {sign: -1}"),
        ({"current": -1}, "current_sign_reversed", "correlation -0.9", "current: {sign: -1}"),
        ({"position": 1000}, "position_unit", "is probably mrad", "position: {unit: mrad}"),
        ({"position": 1e-3}, "position_scale", "is probably 1000", "position: {scale: 1000}"),
        ({"speed": 1000}, "speed_unit", "is probably mrad/s", "speed: {unit: mrad/s}"),
        ({"current": 1000}, "current_unit", "1.2", "current: {unit: mA}"),
        ({"current": 1e-3}, "current_unit", "times what", "current: {scale: 1000}"),
        ({"speed": TAU}, "speed_shaft", "is probably user", "speed: {shaft: user}"),
        ({"position": 1 / TAU}, "position_shaft", "is probably motor", "position: {shaft: motor}"),
        ({"speed": 0.8}, "gear_ratio", "the description has 1/500", "unit and shaft of both"),
        ({"command": 0.25}, "command_position", "3.9", "command: {scale: 3.9"),
        ({"position": np.nan}, "not_finite", "in 1700 of 1700", "choose another source"),
    ],
)
def test_defect_is_named_with_value_and_remedy(defects_of, changes, name, value, remedy):
    [defect] = defects_of(**changes)
    assert (defect.kind, defect.is_error) == (name, True)
    assert value in defect_text(defect).problem
    assert remedy in defect_text(defect).remedy


def test_position_and_command_both_in_degrees_are_named_by_the_speed(defects_of):
    names = {item.kind for item in defects_of(position=57.29578, command=57.29578)}
    assert names == {"position_unit", "command_unit"}


def test_degrees_beyond_the_end_stop_are_named_without_a_speed(defects_of, mapped):
    mapping = mapped(speed=None)
    far = {"position": 57.29578 * 10, "command": 57.29578 * 10, "speed": lambda x: np.empty(0)}
    assert {item.kind for item in defects_of(mapping, **far)} == {"position_unit", "command_unit"}


def test_remedy_refers_to_the_mapping_in_use(defects_of, mapped):
    mapping = mapped(position={"source": "p", "sign": -1})
    [defect] = defects_of(mapping, position=-1)
    assert defect_text(defect).remedy == "position: {sign: 1}"


def test_accepted_defect_does_not_forbid_estimates(defects_of, mapped):
    defects = defects_of(current=0.0)
    assert refused(defects, mapped())
    assert refused(defects, mapped(accept=["current_zero"])) == []


def test_document_lists_all_kinds_of_defects_and_a_mapping_accepts_them(mapped):
    page = Path(__file__).parents[2] / "docs" / "inputs.md"
    section = page.read_text().split("## Reported defects")[1].split("\n## ")[0]
    cells = re.findall(r"^\| (`.*?`) \|", section, re.MULTILINE)
    listed = [name for cell in cells for name in re.findall("`(.*?)`", cell)]
    kinds = set(DefectKind)
    for name in [name for name in listed if name.startswith("COLUMN_")]:
        of_columns = {name.replace("COLUMN", column) for column in COLUMNS} & kinds
        assert of_columns, name
        listed += of_columns
    assert {name for name in listed if not name.startswith("COLUMN_")} == kinds
    assert mapped(accept=[kind.value for kind in DefectKind]).accept == tuple(DefectKind)


def test_each_evidence_has_words():
    assert set(defect_wording._WORDS) == set(get_args(Evidence))


def test_position_at_the_motor_gives_a_note_that_backlash_is_hidden(defects_of, mapped):
    [defect] = defects_of(mapped(position={"source": "p", "shaft": "motor"}))
    assert (defect.kind, defect.is_error) == ("position_at_motor", False)


def test_current_kind_that_contradicts_the_drive_is_named(defects_of, mapped):
    [defect] = defects_of(mapped(current={"source": "i", "kind": "i_q"}))
    assert (defect.kind, defect.is_error) == ("drive_of_i_q", True)
    assert "drive: field_oriented in the description" in defect_text(defect).remedy


def test_unknown_drive_is_not_checked_against_default_limits(telemetry, columns, mapped):
    """The description of an unknown drive has only default limits and sizes."""
    unknown = replace(FLAP, drive="unknown")
    far = {name: columns[name] * (200.0 if name != "current" else 900.0) for name in columns}
    assert find_defects(far, telemetry.stamps_ns, mapped(), unknown) == []
    [defect] = find_defects(
        columns | {"current": -columns["current"]}, telemetry.stamps_ns, mapped(), unknown
    )
    assert defect.kind == "current_sign_reversed"


def test_actuator_at_rest_has_no_defects(telemetry, mapped):
    still = {name: np.zeros(500) for name in ("command", "current", "position", "speed")}
    assert find_defects(still, telemetry.stamps_ns[:500], mapped(), FLAP) == []


WORST = {"friction": 1.0, "backlash": 1.0, "short_circuit_a": 0.7, "eccentricity": 1.0, "gain": 1.0}
CAUSES = [
    *("load_torque=0.3", "load_torque=-0.3", "load_stiffness=5e-4", "inertia=0.5"),
    *("torque_constant=-0.3", "viscous_friction=1", "friction_ripple=0.5", "jam=1"),
    *("open_phase_a=1", "dead_switch=1", "winding_temperature=100", "supply_voltage=-0.3"),
    *("current_offset=0.5", "current_gain=0.2", "position_gain=0.02", "position_offset=1e-3"),
    *("speed_gain=0.02", "speed_delay=1e-3", "command_delay=2e-3", "cogging=0.02"),
]


@pytest.mark.slow
def test_no_fault_or_cause_of_the_simulator_is_mistaken_for_a_wrong_mapping(mapped):
    """The telemetry has 1 kHz, and 500 Hz with every second sample."""
    cases = [({name: value}, ()) for name, value in WORST.items()]
    cases += [({}, (cause,)) for cause in CAUSES]
    for faults, causes in cases:
        cycle = simulate(
            faults,
            description=FLAP,
            causes=causes,
            current_noise=0.1,
            resolutions={"position": 1e-5, "speed": 0.5},
        )
        for step, with_speed in product((1, 2), (True, False)):
            columns = {name: getattr(cycle, name)[::step] for name in COLUMNS}
            if not with_speed:
                columns["speed"] = np.empty(0)
            mapping = mapped(**({} if with_speed else {"speed": None}))
            stamps_ns = cycle.stamps_ns[::step]
            defects = find_defects(columns, stamps_ns, mapping, described(1000 // step))
            assert defects == [], (faults, causes)


def test_losses_and_wrong_stamps_are_named_with_their_number():
    losses = Losses(samples=1000, lost=3, gaps=2, filled=5, jumps=1, repeated=4)
    defects = list(stream_defects(losses, 6))
    assert {item.kind: item.evidence for item in defects} == {
        DefectKind.LOST_SAMPLES: LostSamples(3, 1000, gaps=2, is_interpolated=False),
        DefectKind.FILLED_SAMPLES: SampleCount(5, 1000),
        DefectKind.TIME_NOT_MONOTONIC: WrongStamps(1, 4, 1000, of_table=False),
        DefectKind.STAMPS_REBUILT: SampleCount(6, 1000),
    }
    lines = "\n".join(map(defect_line, defects))
    assert "lost_samples: 3 samples of 1003 missing in 2 gaps: no window" in lines
    assert "filled_samples: 5 lost samples interpolated linearly" in lines
    assert "decreases 1 time and repeats 4 times" in lines
    assert "6 stamps of 1000 reconstructed" in lines
    assert not any(item.is_error for item in defects)
    [mostly] = stream_defects(Losses(samples=100, repeated=90), 0)
    assert mostly.is_error
    assert "reconstructs the stamps" in defect_text(mostly).remedy
    [rows] = stream_defects(Losses(samples=100, jumps=50), 0, of_table=True)
    assert defect_text(rows).remedy == "check clock.source. Sort the rows by time"
