# SPDX-License-Identifier: Apache-2.0
"""Columns are recognised by their behaviour in motion; a name alone leaves a doubt."""

import numpy as np
import pandas as pd
import pytest

from ema_bags.inputs.files import open_input
from ema_bags.inputs.guess import Guess
from ema_bags.inputs.names import hint_of
from ema_bags.inputs.recognition import Recognizer

from .joint_motion import TAU, joint, moves
from .remarks import remarks_of

DEG = 180.0 / np.pi
RPM = 60.0 / (2.0 * np.pi)


@pytest.fixture(scope="module")
def motion():
    columns, stamps = moves(20.0)
    rng = np.random.default_rng(1)
    columns["speed"] = TAU * columns["speed"]
    columns["time"] = 1e-9 * (stamps - stamps[0])
    columns["error"] = columns["command"] - columns["position"]
    columns["set_current"] = columns["current"] + rng.normal(0.0, 0.001, len(stamps))
    columns["motor_position"] = columns["position"] + 2e-3 * columns["current"]
    columns["set_speed"] = np.gradient(columns["command"], 0.005)
    columns["voltage"] = 48.0 + rng.normal(0.0, 0.1, len(stamps))
    return columns


@pytest.fixture
def guessed(motion, tmp_path):
    """Return a function that writes a CSV file and returns the guess from its columns.

    The argument maps each name in the file to the name of a column of ``motion`` and a factor.
    """

    def guess(named: dict[str, tuple[str, float]]) -> Guess:
        frame = pd.DataFrame({name: motion[key] * scale for name, (key, scale) in named.items()})
        frame.insert(0, "t [s]", motion["time"])
        frame.to_csv(tmp_path / "log.csv", index=False)
        return open_input(tmp_path / "log.csv").guess(joint())

    return guess


FORMS = {
    "robotics": {
        "q": ("position", 1.0),
        "qd": ("speed", 1.0),
        "q_cmd": ("command", 1.0),
        "tau": ("current", 1.0),
    },
    "desired": {
        "q": ("position", 1.0),
        "qd": ("command", 1.0),
        "dq": ("speed", 1.0),
        "tau": ("current", 1.0),
    },
    "numbered": {"q7": ("position", 1.0), "dq7": ("speed", 1.0), "tau7": ("current", 1.0)},
    "desired and actual": {
        "posDes": ("command", DEG),
        "posAct": ("position", DEG),
        "current": ("current", 1.0),
    },
    "machine tool": {
        "X_SetPosition": ("command", 1e3),
        "X_ActualPosition": ("position", 1e3),
        "X_ActualVelocity": ("speed", 1e3),
        "X_SetVelocity": ("set_speed", 1e3),
        "X_CurrentFeedback": ("current", 1.0),
        "X_OutputVoltage": ("voltage", 1.0),
    },
    "commanded current": {
        "position [deg]": ("position", DEG),
        "speed [rpm]": ("speed", RPM),
        "q-axis cmd [A]": ("set_current", 1.0),
        "q-axis [A]": ("current", 1.0),
    },
    "commanded torque": {
        "q_4": ("position", 1.0),
        "dq_4": ("speed", 1.0),
        "q_d_4": ("command", 1.0),
        "tau_J_4": ("current", 1.0),
        "tau_J_d_4": ("set_current", 1.0),
    },
    "two encoders": {
        "qg": ("position", 1.0),
        "qm": ("motor_position", 1.0),
        "vir": ("current", 1.0),
    },
    "volts": {
        "reference_m": ("command", 1.0),
        "position_m": ("position", 1.0),
        "command_v": ("current", 1.0),
    },
    "no names": {
        "ch1": ("voltage", 1.0),
        "ch2": ("current", 1.0),
        "ch3": ("position", 1.0),
        "ch4": ("speed", 1.0),
        "ch5": ("command", 1.0),
    },
}
ABLE = {
    "position": ("position", "motor_position"),
    "command": ("command",),
    "speed": ("speed",),
    "current": ("current",),
}


@pytest.mark.parametrize("named", FORMS.values(), ids=FORMS)
def test_columns_are_recognised(guessed, named):
    guess = guessed(named)
    for quantity, keys in ABLE.items():
        able = [name for name, (key, _) in named.items() if key in keys]
        source = getattr(guess.mapping, quantity)
        if able:
            assert source is not None, quantity
            assert source.source in able
        elif source is not None:
            assert any(
                f"{quantity} {source.source!r} is a guess" in line for line in remarks_of(guess)
            )


def test_columns_without_names_are_a_guess(guessed):
    guess = guessed(FORMS["no names"])
    assert "current 'ch2' is a guess from its values alone" in remarks_of(guess)
    assert "command 'ch5' is a guess from its values alone" in remarks_of(guess)


def test_column_whose_name_contradicts_the_motion_is_a_guess(guessed):
    """A speed that is not the derivative of the position is recognised only by its name."""
    guess = guessed({"pos": ("position", 1.0), "vel": ("voltage", 1.0), "tau": ("current", 1.0)})
    assert guess.mapping.speed is not None
    assert "speed 'vel' is a guess from its name alone" in remarks_of(guess)


def test_names_decide_if_nothing_moves(motion, guessed):
    guess = guessed({"pos": ("voltage", 1.0), "tau": ("current", 1.0)})
    assert guess.mapping.position.source == "pos"
    assert (
        "the columns could not be identified from the motion, only from their names"
        in remarks_of(guess)
    )


def test_following_error_is_not_mistaken_for_a_speed(guessed):
    """The error is proportional to the speed, but no unit fits the factor."""
    guess = guessed({"pos": ("position", 1.0), "lag": ("error", 1.0), "tau": ("current", 1.0)})
    assert guess.mapping.speed is None


def test_each_joint_has_its_columns(motion):
    second, _ = moves(20.0, travel=0.2, seed=3)
    shift = 130  # The cycles of the two joints do not coincide.
    names = {
        "a_pos": motion["position"],
        "b_pos": np.roll(second["position"], shift),
        "b_vel": np.roll(TAU * second["speed"], shift),
        "a_vel": motion["speed"],
        "b_eff": np.roll(second["current"], shift),
        "a_eff": motion["current"],
    }
    joints = Recognizer(names, 0.005, hint_of).joints()
    columns = [{key: item.name[0] for key, item in joint.columns.items()} for joint in joints]
    assert sorted(columns, key=lambda item: item["position"]) == [
        dict.fromkeys(("position", "speed", "effort"), "a"),
        dict.fromkeys(("position", "speed", "effort"), "b"),
    ]


def test_too_few_rows_are_not_judged(motion):
    columns = {name: motion[name][:40] for name in ("position", "speed")}
    assert Recognizer(columns, 0.005, hint_of).joints() == []


@pytest.mark.parametrize("kind", ["at first", "between"])
def test_column_that_is_constant_in_the_compared_part_is_left_out(motion, kind):
    columns = {name: np.tile(motion[name], 20) for name in ("position", "speed", "current")}
    rows = np.arange(len(columns["position"]))
    columns["stage"] = np.minimum(rows, 10.0) if kind == "at first" else rows % 5.0
    period = 0.005 if kind == "at first" else 0.001
    assert Recognizer(columns, period, hint_of).joints()
