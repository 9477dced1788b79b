"""A mapping is guessed from names, units, magnitudes and relations."""

import numpy as np
import pandas as pd
import pytest

from ema_bags.inputs.files import InputFile
from ema_bags.inputs.mapping import mapping_from

from .conftest import described

FLAP = described(1000)
RPM = 60.0 / (2.0 * np.pi)


@pytest.fixture
def guessed(telemetry, tmp_path):
    """Return the guess for a table of named columns; each is (column, factor)."""
    own = {
        "t": telemetry.stamps_ns * 1e-9,
        "p": telemetry.position,
        "c": telemetry.command,
        "s": telemetry.speed,
        "i": telemetry.current,
        "e": telemetry.command - telemetry.position,
    }

    def guess(**named):
        frame = pd.DataFrame({name: own[key] * factor for name, (key, factor) in named.items()})
        frame.to_csv(tmp_path / "a.csv", index=False)
        return InputFile(tmp_path / "a.csv").guess(FLAP)

    return guess


def as_mapping(sections, clock):
    return mapping_from({**sections, "clock": clock, "table": {"separator": ",", "decimal": "."}})


@pytest.mark.parametrize(
    ("columns", "sections", "clock"),
    [
        (  # names and units say all
            {
                "time_ms": ("t", 1e3),
                "flap_pos_deg": ("p", 57.29577951),
                "cmd_deg": ("c", 57.29577951),
                "motor_speed_rpm": ("s", RPM),
                "iq [mA]": ("i", 1154.7),
            },
            {
                "position": {"source": "flap_pos_deg", "unit": "deg"},
                "command": {"source": "cmd_deg", "unit": "deg"},
                "speed": {"source": "motor_speed_rpm", "unit": "rpm"},
                "current": {"source": "iq [mA]", "unit": "mA", "kind": "i_q"},
            },
            {"source": "time_ms", "unit": "ms"},
        ),
        (  # nothing but names: units and signs follow from how the columns relate
            {
                "t": ("t", 1e6),
                "position": ("p", 57.29577951),
                "setpoint": ("c", 57.29577951),
                "velocity": ("s", -FLAP.parameters.tau),
                "current": ("i", -1.0),
            },
            {
                "position": {"source": "position", "unit": "deg"},
                "command": {"source": "setpoint", "unit": "deg"},
                "speed": {"source": "velocity", "shaft": "user", "sign": -1},
                "current": {"source": "current", "sign": -1},
            },
            {"source": "t", "unit": "us"},
        ),
        (  # a slow logger's: position error instead of the command, nothing else
            {"Zeit [s]": ("t", 1.0), "Winkel": ("p", 1.0), "following_error": ("e", 1.0)},
            {"position": {"source": "Winkel"}, "error": {"source": "following_error"}},
            {"source": "Zeit [s]"},
        ),
        (  # torque at the motor
            {
                "timestamp": ("t", 1e9),
                "actual_position": ("p", 1.0),
                "target_position": ("c", 1.0),
                "torque_actual": ("i", FLAP.parameters.k_t),
            },
            {
                "position": {"source": "actual_position"},
                "command": {"source": "target_position"},
                "current": {"source": "torque_actual", "unit": "N.m", "kind": "motor_torque"},
            },
            {"source": "timestamp", "unit": "ns"},
        ),
    ],
    ids=["units", "relations", "error", "torque"],
)
def test_mapping_is_guessed(guessed, columns, sections, clock):
    assert guessed(**columns).mapping == as_mapping(sections, clock)


@pytest.mark.parametrize("name", ["current_mA", "i_mA", "Current mA", "current_A", "Current [A]"])
def test_unit_in_the_name_of_a_current_is_found(guessed, name):
    factor = 1000.0 if "mA" in name else 1.0
    found = guessed(**{"t": ("t", 1), "pos": ("p", 1), "cmd": ("c", 1), name: ("i", factor)})
    assert found.mapping.current.unit == ("mA" if "mA" in name else "A")


def test_torque_at_the_joint_is_told_by_its_size(guessed):
    p = FLAP.parameters
    found = guessed(t=("t", 1.0), pos=("p", 1.0), cmd=("c", 1.0), torque=("i", p.k_t / p.tau))
    assert found.mapping.current is not None
    assert found.mapping.current.kind == "joint_torque"


def test_what_is_a_guess_is_said(guessed):
    remarks = guessed(t=("t", 1.0), pos=("p", 1.0), cmd=("c", 1.0), cur=("i", 1.0)).remarks
    words = "\n".join(remarks)
    assert "current.unit is a guess" in words
    assert "current.sampling cannot be found" in words
    assert "no column seems to be the speed" in words


def test_effort_that_never_changes_is_taken_as_not_measured(guessed):
    found = guessed(t=("t", 1.0), pos=("p", 1.0), cmd=("c", 1.0), effort=("i", 0.0))
    assert found.mapping.current is None
    assert any("current never changes" in item for item in found.remarks)


def test_table_without_a_command_is_refused_with_its_columns(guessed):
    with pytest.raises(ValueError, match=r"no column seems to be the command.*columns: t, pos"):
        guessed(t=("t", 1.0), pos=("p", 1.0))


def test_columns_of_two_joints_are_not_mixed_and_the_choice_is_said(guessed):
    found = guessed(
        t=("t", 1.0),
        right_command=("c", 0.5),
        left_pos=("p", 1.0),
        left_command=("c", 1.0),
        right_pos=("p", 0.5),
    )
    mapping = found.mapping
    assert (mapping.position.source, mapping.command.source) == ("left_pos", "left_command")
    assert "position 'left_pos' is a guess; others: 'right_pos'" in found.remarks
    assert "command 'left_command' is a guess; others: 'right_command'" in found.remarks


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: 0.0 * t, "column 'time [s]' never changes and is no clock"),
        (lambda t: t.sample(frac=1.0, random_state=1).to_numpy(), "goes back"),
    ],
)
def test_time_that_is_no_clock_is_named(telemetry, tmp_path, change, words):
    frame = pd.DataFrame(
        {
            "time [s]": change(pd.Series(telemetry.stamps_ns * 1e-9)),
            "position": telemetry.position,
            "command": telemetry.command,
        }
    )
    frame.to_csv(tmp_path / "a.csv", index=False)
    found = InputFile(tmp_path / "a.csv").guess(FLAP)
    assert found.mapping.clock.source == ""
    assert any(words in item for item in found.remarks), found.remarks
