# SPDX-License-Identifier: Apache-2.0
"""Recording and playing a bag with the node programs in the process of the command."""

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ema_bags.reader import Bag
from ema_cli.bags.diagnoses import read_history
from ema_cli.figures.history import draw_history

from ..commands import SAMPLE, without_progress
from ..waiting import DEADLINE_S, started, wait_for

PLAYED = ("/ema/telemetry", "/ema/actuator_description", "/ema/simulated_faults")


def end(process: subprocess.Popen[str], number: int) -> None:
    process.send_signal(number)
    _, printed = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0, printed
    assert "Traceback" not in printed


@pytest.fixture(scope="module")
def replayed(tmp_path_factory):
    """Return a bag that recorded a monitor while the command played the sample."""
    # YAML would read this name as a number.
    bag = tmp_path_factory.mktemp("replay") / "1e3"
    output: dict[str, Any] = {"stderr": subprocess.PIPE, "text": True}
    with (
        started(["ema", "record", "-o", bag.name], cwd=bag.parent, **output) as recorder,
        started(["ema", "up", "monitor"], **output) as monitor,
    ):
        # The player starts as soon as one subscriber exists, the monitor or the recorder.
        for process in (recorder, monitor):
            assert process.stderr is not None
            assert any("active" in line for line in process.stderr)
        printed = subprocess.run(["ema", "play", SAMPLE], **output, timeout=DEADLINE_S, check=False)
        assert printed.returncode == 0, printed.stderr
        wait_for(lambda: _has_health(bag), "a health in the bag")
        end(monitor, signal.SIGINT)
        end(recorder, signal.SIGTERM)
    return bag


def _has_health(bag: Path) -> bool:
    if not bag.is_dir():
        return False
    topic = Bag(bag).topics.get("/ema/health")
    return topic is not None and topic.count > 0


def as_text(message: Any) -> str:
    """Return all values of a message as text, arrays with all digits."""
    with np.printoptions(threshold=sys.maxsize, floatmode="unique"):
        return repr(message)


def test_recording_holds_all_played_messages(replayed):
    sample, bag = Bag(SAMPLE), Bag(replayed)
    assert bag.damage == ""
    for name in PLAYED:
        played = [as_text(item.message) for item in sample.messages([name])]
        assert [as_text(item.message) for item in bag.messages([name])] == played


def test_history_agrees_with_the_truth_of_the_sample(replayed):
    history = read_history(replayed)
    [diagnosis] = history.diagnoses()
    assert (diagnosis.valid, diagnosis.cycle) == (True, 0)
    assert diagnosis.truth is not None
    assert diagnosis.truth[0] == 0.25
    # Measured: 0.001; the tolerance is 4 sigma of the estimate.
    assert diagnosis.faults[0] == pytest.approx(0.25, abs=4.0 * diagnosis.sigma[0])
    assert history.limits["friction"] == 0.5
    # Friction of 0.25 is half of its limit.
    assert diagnosis.level == 1


def test_latency_is_left_out_if_the_stamps_are_from_another_time(replayed):
    # Stamps of the sample begin at 0, stamps of the recording at the current time.
    labels = [axes.get_ylabel() for axes in draw_history(read_history(replayed)).axes]
    assert labels == ["friction", "eccentricity", "error of\nthe others"]


def test_history_plot_is_next_to_the_bag_and_unknown_actuators_are_refused_with_the_names(
    ema, replayed
):
    result = ema("plot", replayed, "--history")
    assert result.exit_code == 0
    assert replayed.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    result = ema("plot", replayed, "--replace", "--history", "--actuator-id", "rudder")
    assert result.exit_code == 1
    assert "no estimates of actuator 'rudder', only of flap" in result.stderr


def test_options_become_parameters_of_the_nodes(monkeypatch, ema):
    passed = []

    def main(arguments: list[str]) -> int:
        assert "__ns:=/ema" in arguments
        passed.append([item for item in arguments if ":=" in item and item[:2] != "__"])
        return 0

    monkeypatch.setattr("ema_bags.recorder_node.main", main)
    monkeypatch.setattr("ema_bags.player_node.main", main)
    assert (
        ema("record", "-o", "12", "--topic", "telemetry", "--topic", "b", "--replace").exit_code
        == 0
    )
    assert ema("play", "bag", "--rate", "4", "--only-actuator").exit_code == 0
    assert ema("record").exit_code == 0
    parameters = [
        {
            name: json.loads(value)
            for name, _, value in (item.partition(":=") for item in assignments)
        }
        for assignments in passed
    ]
    assert parameters == [
        {"output": "12", "topics": ["telemetry", "b"], "overwrite": True},
        {"bag": "bag", "rate": 4.0, "actuator_only": True},
        {},
    ]


def test_impossible_options_give_one_clear_line(tmp_path: Path):
    command = ["ema", "record", "-o", "a.mcap", "-p", "max_bag_size=1000000"]
    result = subprocess.run(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True, check=False)
    assert result.returncode == 1
    [line] = without_progress(result.stderr).splitlines()
    assert "is a single file: expected a folder" in line
