# SPDX-License-Identifier: Apache-2.0
"""``ema import --guide`` asks what it cannot infer; --set answers in advance."""

from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from ema_bags import read_telemetry
from ema_bags.inputs.mapping import Table, load_mapping
from ema_core.telemetry import join

REAL = Path(__file__).parents[2] / "bags" / "real"
ENTRIES = {
    "position": ["set_point_mm - position_error_mm", "mm", "0.005", "user"],
    "command": ["set_point_mm", "mm", "0.005", "user"],
    "speed": ["-"],
    "current": ["current_a", "magnitude", "A", "mean"],
    "temperature": ["-"],
    "clock": ["time_s", "s"],
}
ASKED = "".join(f"{line}\n" for entry in ENTRIES.values() for line in entry)
SET = [
    *("position.source=set_point_mm - position_error_mm", "position.unit=mm"),
    *("position.lead=0.005", "command.source=set_point_mm", "command.unit=mm"),
    *("command.lead=0.005", "current.source=current_a", "current.kind=magnitude"),
    "clock.source=time_s",
]
SET_OPTIONS = [word for answer in SET for word in ("--set", answer)]


@pytest.fixture
def command():
    return "import", REAL / "healthy_1.csv", "--actuator", REAL / "actuator.yaml"


def test_check_of_a_real_record_recognises_the_same_mapping_as_by_hand(ema, tmp_path, command):
    """The position follows from an error, and the current has no sign."""
    done = ema("check", *command[1:], "-o", tmp_path / "mapping.yaml")
    assert done.exit_code == 0, done.output
    guessed = load_mapping(tmp_path / "mapping.yaml")
    assert replace(guessed, table=Table()) == load_mapping(REAL / "mapping.yaml")


def test_guide_and_options_give_the_same_result_as_the_mapping_by_hand(ema, tmp_path, command):
    by_hand = ema(*command, "--mapping", REAL / "mapping.yaml", "-o", tmp_path / "hand.mcap")
    assert by_hand.exit_code == 0, by_hand.output
    guided = ema(*command, "--guide", "-o", tmp_path / "guided.mcap", typed=ASKED)
    assert guided.exit_code == 0, guided.output
    assert "# column 'current_a': 0.186 to 1.13" in guided.stdout
    printed = ema(*command, *SET_OPTIONS, "-o", tmp_path / "given.mcap")
    assert printed.exit_code == 0, printed.output
    hand, *mappings = (
        join(list(read_telemetry(tmp_path / f"{name}.mcap")))
        for name in ("hand", "guided", "given")
    )
    for mapping in mappings:
        assert (hand.position == mapping.position).all()
        assert (hand.current == mapping.current).all()
    assert (tmp_path / "guided.png").stat().st_size > 10_000
    again = ("--mapping", tmp_path / "guided.yaml", "-o", tmp_path / "again.mcap")
    assert ema(*command, *again).exit_code == 0
    assert "already exists" in ema(*command, *SET_OPTIONS, "-o", tmp_path / "given.mcap").stderr


def test_impossible_answer_is_reported_and_the_question_is_repeated(ema, tmp_path, command):
    wrong = ASKED.replace("current_a", "amperes", 1)
    # When the question is repeated, the previous answer is the default.
    again = "\n" * 9 + "current_a\n" + "\n" * 6
    result = ema(*command, "--guide", "-o", tmp_path / "guided.mcap", typed=wrong + again)
    assert result.exit_code == 0, result.output
    assert "'amperes'" in result.stderr
    mapping = yaml.safe_load((tmp_path / "guided.yaml").read_text())
    assert mapping["current"] == {
        **{"source": "current_a", "unit": "A", "kind": "magnitude", "sampling": "mean"}
    }


def test_answers_are_kept_if_the_data_are_refused(ema, tmp_path, command):
    source = "position_error_mm - set_point_mm"
    reversed_command = ASKED.replace("\nset_point_mm\n", f"\n{source}\n", 1)
    result = ema(*command, "--guide", "-o", tmp_path / "guided.mcap", typed=reversed_command)
    assert (result.exit_code, (tmp_path / "guided.mcap").exists()) == (1, False)
    assert "is not imported" in result.stderr
    kept = yaml.safe_load((tmp_path / "guided.yaml").read_text())
    assert kept["command"]["source"] == source


def test_rate_of_a_table_without_time_is_asked(ema, tmp_path, command):
    answers = ASKED.replace("time_s\ns\n", "-\n25\n")
    result = ema(*command, "--guide", "-o", tmp_path / "guided.mcap", typed=answers)
    assert result.exit_code == 0, result.output
    assert yaml.safe_load((tmp_path / "guided.yaml").read_text())["clock"] == {"rate_hz": 25.0}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--set", "position.uni=mm"), "unknown entry 'uni'; did you mean 'unit'?"),
        (("--guide", "--mapping", REAL / "mapping.yaml"), "--mapping excludes"),
        ((), "--guide asks for them"),
    ],
)
def test_wrong_options_are_refused(ema, tmp_path, command, options, words):
    result = ema(*command, *options, "-o", tmp_path / "bag.mcap")
    assert result.exit_code in (1, 2)
    assert words in " ".join(result.stderr.split())
    assert not list(tmp_path.iterdir())
