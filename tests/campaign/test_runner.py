"""The campaign counts, resumes, names what failed, and repeats it."""

import importlib
import io
import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import rich.console

from ..waiting import wait_for

RUN = Path(__file__).parents[2] / "campaign" / "run.py"


def ran(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(RUN), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.slow
def test_state_is_kept_and_resumed(tmp_path: Path):
    state = tmp_path / "state.json"
    # 20 s are what a case usually takes: one round of two cases is begun, no more.
    first = ran("--part", "vectors", "--seed", 7, "--budget", 20.2, "--state", state)
    assert first.returncode == 0, first.stdout + first.stderr
    assert "seed 7" in first.stdout
    known = json.loads(state.read_text())
    done = known["parts"]["vectors"]["done"]
    assert done
    assert done == list(range(len(done)))
    assert known["parts"]["vectors"]["counts"]["valid read"] >= 440
    used_s = known["used_s"]
    again = ran("--part", "vectors", "--resume", state, "--budget", used_s + 20.2)
    assert again.returncode == 0
    more = json.loads(state.read_text())["parts"]["vectors"]["done"]
    assert more == list(range(len(more)))
    assert len(more) > len(done)


def test_file_that_is_no_state_is_refused(tmp_path: Path):
    path = tmp_path / "state.json"
    path.write_text("{}")
    result = ran("--resume", path)
    assert result.returncode == 1
    assert "is not the state of a campaign" in result.stderr


def test_failure_is_listed_with_the_command_that_repeats_it():
    part, run, tally = (importlib.import_module(name) for name in ("part", "run", "tally"))
    one = part.Part("files", "", lambda _: None, 1.0, 1.0, judge=lambda _: ["too few"])
    found = tally.PartTally()
    found.add(3, 1.0, 2.0, {"counts": {"a": 2}, "worst": {"b [s]": 3.0}, "failures": ["it fell"]})
    found.add(4, 1.0, 2.0, {"counts": {"a": 1}, "worst": {"b [s]": 1.0}, "failures": []})
    assert (found.counts, found.worst) == ({"a": 3}, {"b [s]": 3.0})
    assert run.failures_of(one, 9, found) == [
        "files case 3: it fell",
        "    repeat: python campaign/case.py files --seed 9 --case 3",
        "files: too few",
    ]


def test_table_says_what_was_not_reached_and_not_judged():
    run, tally, parts = (importlib.import_module(name) for name in ("run", "tally", "parts"))
    found = tally.Tally(9, 60.0)
    found.of("fuzz").counts = {"inputs of bag": 999_999, "inputs of table": 1}
    found.of("kills").counts = {"kills of monitor": 470, "kills of player": 29}
    found.of("state_machines").counts = {"queue: steps": 9_000, "queue: walks": 40}
    shown = [parts.part_of(name) for name in ("fuzz", "kills", "state_machines")]
    goals = [list(map(str, part.goals(found.of(part.name).counts))) for part in shown]
    assert goals == [
        ["1,000,000 of 1,000,000 inputs", "2 of 12 targets: not reached"],
        ["499 of 500 kills: not reached"],
        [
            "9,000 of 100,000 steps: not reached",
            "40 of 40 walks of queue",
            "0 of 40 walks of lifecycle: not judged",
            "0 of 40 walks of prognosis: not judged",
        ],
    ]
    printed = io.StringIO()
    console = rich.console.Console(width=200, file=printed)
    console.print(run.overview(shown, found))
    table = printed.getvalue()
    assert all(words in table for lines in goals for words in lines)


@pytest.mark.slow
def test_interrupted_campaign_leaves_no_process_and_says_how_to_go_on(tmp_path: Path):
    state = tmp_path / "state.json"
    command = [sys.executable, str(RUN), "--part", "files", "--state", str(state), "--seed", "7"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        groups = wait_for(lambda: children_of(process.pid), "cases that run")
        for _ in range(2):  # as by Ctrl-C, and a launcher that passes it on
            process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert f"--resume {state}" in output
    wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in groups), "their end")
    assert json.loads(state.read_text())["parts"].get("files", {"done": []})["done"] == []


def children_of(pid: int) -> list[int]:
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(one) for one in found]
