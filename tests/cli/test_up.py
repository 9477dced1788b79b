# SPDX-License-Identifier: Apache-2.0
"""Supervised processes: small programs in place of nodes, then real nodes."""

import math
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from ema_bags.reader import Bag
from ema_cli.processes import listener, supervisor
from ema_cli.processes.stop_request import ENDING, deferred_signals
from ema_cli.processes.supervisor import Supervisor

from ..waiting import DEADLINE_S, started, wait_for

# Write "up"; after SIGTERM, end with a delay and write a line.
ORDERLY = """
import signal, sys, time
from pathlib import Path
note, seconds = Path(sys.argv[1]), float(sys.argv[2])
def end(*_):
    time.sleep(seconds)
    with note.open("a") as file: file.write(f"{sys.argv[3]}\\n")
    sys.exit(0)
signal.signal(signal.SIGTERM, end)
with note.open("a") as file: file.write("up\\n")
while True: time.sleep(10)
"""
STUBBORN = ORDERLY.replace("signal.SIGTERM, end", "signal.SIGTERM, signal.SIG_IGN")
SUPERVISOR = """
import sys, time
from ema_cli.processes.stop_request import ENDING, deferred_signals
from ema_cli.processes.supervisor import Supervisor
with deferred_signals(*ENDING) as stop, Supervisor(print) as processes:
    for number in range(int(sys.argv[1])):
        if not stop:
            processes.start(f"child {number}", [sys.executable, "-c", sys.argv[2], *sys.argv[3:]])
    print("started", flush=True)
    while processes.running and not stop:
        time.sleep(0.05)
        processes.check()
"""


def lines(note: Path) -> list[str]:
    return note.read_text(encoding="utf-8").split("\n")[:-1] if note.exists() else []


def processes_with(mark: str | Path) -> list[int]:
    """Return the processes except this one whose command line has a mark; zombies have none."""
    processes = []
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit() or int(folder.name) == os.getpid():
            continue
        try:
            command = (folder / "cmdline").read_bytes()
        except OSError:  # it has just ended
            continue
        if os.fsencode(mark) in command:
            processes.append(int(folder.name))
    return processes


def has_ended(processes: Supervisor) -> bool:
    processes.check()
    return not processes.running


@pytest.fixture
def note(tmp_path):
    return tmp_path / "note"


@pytest.fixture
def child(note):
    def command(name: str, seconds: float = 0.0, program: str = ORDERLY) -> list[str]:
        return [sys.executable, "-c", program, str(note), str(seconds), name]

    return command


def test_last_process_is_stopped_after_the_others_have_ended(note, child, monkeypatch):
    # A busy machine ends the others late, and in any order.
    monkeypatch.setattr(supervisor, "_HEAD_START_S", DEADLINE_S)
    reported: list[str] = []
    with Supervisor(reported.append, "recorder", patience_s=DEADLINE_S) as processes:
        for name, seconds in (("recorder", 0.0), ("actuator", 0.1), ("monitor", 0.4)):
            processes.start(name, child(name, seconds))
        wait_for(lambda: lines(note) == ["up"] * 3, "three children up")
    assert sorted(lines(note)[3:5]) == ["actuator", "monitor"]
    assert lines(note)[5:] == ["recorder"]
    assert (reported, processes.failed, processes_with(note)) == ([], [], [])


def test_last_process_waits_at_most_a_second_for_the_others(note, child):
    with Supervisor(lambda _: None, "recorder", patience_s=DEADLINE_S) as processes:
        processes.start("recorder", child("recorder"))
        processes.start("monitor", child("monitor", 5.0))
        wait_for(lambda: lines(note) == ["up"] * 2, "two children up")
    assert lines(note)[2:] == ["recorder", "monitor"]


def test_single_process_is_stopped_while_the_others_continue(note, child):
    with Supervisor(lambda _: None) as processes:
        processes.start("actuator", child("actuator"))
        processes.start("monitor", child("monitor"))
        wait_for(lambda: lines(note) == ["up"] * 2, "two children up")
        processes.stop("actuator")
        assert processes.running == ["monitor"]
        processes.check()
        assert processes.running == ["monitor"]
    assert lines(note)[2:] == ["actuator", "monitor"]


def test_ctrl_c_of_the_terminal_reaches_only_the_supervisor(note, child):
    with Supervisor(lambda _: None) as processes:
        processes.start("monitor", child("monitor"))
        wait_for(lambda: lines(note) == ["up"], "the child up")
        [number] = processes_with(note)
        assert os.getpgid(number) != os.getpgid(0)


def test_process_that_does_not_end_is_killed_with_a_message(note, child):
    reported: list[str] = []
    with Supervisor(reported.append, patience_s=0.3) as processes:
        processes.start("monitor", child("monitor", program=STUBBORN))
        wait_for(lambda: lines(note) == ["up"], "the child up")
    assert reported == ["monitor did not exit within 0.3 s and is killed"]
    assert processes_with(note) == []


def test_death_is_reported_once_and_the_other_processes_continue(note, child):
    reported: list[str] = []
    with Supervisor(reported.append) as processes:
        processes.start("monitor", child("monitor"))
        processes.start("failing", [sys.executable, "-c", "raise SystemExit(7)"])
        processes.start("done", [sys.executable, "-c", ""])
        processes.start("killed", [sys.executable, "-c", "import os; os.kill(os.getpid(), 9)"])

        def only_the_monitor_runs() -> bool:
            processes.check()
            return processes.running == ["monitor"]

        wait_for(only_the_monitor_runs, "three children gone")
        processes.check()
        wait_for(lambda: lines(note) == ["up"], "the monitor up")
    assert sorted(reported) == [
        "done has exited",
        "failing failed, exit code 7",
        "killed was terminated by SIGKILL",
    ]
    assert sorted(processes.failed) == ["failing", "killed"]


def test_no_process_survives_if_a_report_cannot_be_written(note, child):
    def broken(_: str) -> None:
        raise BrokenPipeError

    with Supervisor(broken, patience_s=0.3) as processes:
        for name in ("a", "b"):
            processes.start(name, child(name, program=STUBBORN))
        wait_for(lambda: lines(note) == ["up"] * 2, "two children up")
    assert processes_with(note) == []


def test_output_goes_to_the_log(tmp_path):
    log = tmp_path / "log"
    program = "import sys; print('said'); sys.stdout.flush(); sys.stderr.write('complained')"
    with Supervisor(lambda _: None) as processes:
        processes.start("one", [sys.executable, "-c", program], log)
        wait_for(lambda: has_ended(processes), "its end")
    assert log.read_text() == "said\ncomplained"


def test_first_signal_counts_and_handlers_are_restored():
    before = signal.getsignal(signal.SIGTERM)
    with deferred_signals(*ENDING) as stop:
        assert not stop
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)
        assert stop
        assert stop.number == signal.SIGTERM
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize(
    ("number", "children_up"), [(signal.SIGINT, 0), (signal.SIGTERM, 2), (signal.SIGHUP, 6)]
)
def test_signal_at_any_moment_of_the_start_leaves_no_process(note, number, children_up):
    command = [sys.executable, "-c", SUPERVISOR, "6", ORDERLY, str(note), "0", "child"]
    with started(command, stdout=subprocess.PIPE, text=True) as supervisor:
        # The handlers are installed before the first child is started.
        wait_for(lambda: len(processes_with(note)) > 1, "the first child")
        wait_for(lambda: lines(note).count("up") >= children_up, f"{children_up} children up")
        supervisor.send_signal(number)
        supervisor.send_signal(signal.SIGINT)
        supervisor.communicate(timeout=DEADLINE_S)
    assert supervisor.returncode == 0
    assert processes_with(note) == []


def test_killed_supervisor_ends_its_children(note):
    command = [sys.executable, "-c", SUPERVISOR, "2", ORDERLY, str(note), "0", "child"]
    with started(command, stdout=subprocess.DEVNULL) as supervisor:
        wait_for(lambda: lines(note) == ["up"] * 2, "two children up")
        supervisor.kill()
    wait_for(lambda: processes_with(note) == [], "no survivors")
    assert lines(note)[2:] == ["child"] * 2


def health_in(bag: Path) -> list[Any]:
    # A recorder first opens an empty file, and discovers topics some time after they appear.
    file = bag / "bag_0.mcap"
    if not file.exists() or not file.stat().st_size or "/ema/health" not in Bag(bag).topics:
        return []
    recording = Bag(bag)
    return [item.message for item in recording.messages(["/ema/health"])]


def test_nodes_run_under_one_command_until_ctrl_c(ema, tmp_path, monkeypatch):
    bag = tmp_path / "bag"
    fleet = ("--actuators", "left,right", "--monitors", "2")
    nodes = ("actuator", "monitor", "recorder")
    command = ["ema", "up", *fleet, *nodes, "-p", f'output:="{bag}"', "-p", "seed:=3"]
    environment = {**os.environ, "ROS_HOME": str(tmp_path / "ros_home")}
    with started(command, stderr=subprocess.PIPE, text=True, env=environment) as process:
        wait_for(
            lambda: {item.actuator_id for item in health_in(bag)} == {"left", "right"},
            "health of both in the bag",
        )
        # On a busy machine, discovery of a node may take longer than 2 s.
        monkeypatch.setattr(listener, "_DISCOVERY_S", DEADLINE_S)
        second = ema("up", "--actuators", "left", "actuator")
        assert (
            second.exit_code,
            "a node /ema/left/actuator is already running" in second.stderr,
        ) == (1, True)
        process.send_signal(signal.SIGINT)
        _, printed = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0, printed
    assert "Traceback" not in printed
    recorded = Bag(bag)
    assert recorded.damage == ""
    assert recorded.topics["/ema/telemetry"].count > 10
    # Service hours are known without a parameter, and nothing is stored for a simulated unit.
    assert math.isfinite(health_in(bag)[0].flight_hours)
    assert list((tmp_path / "ros_home").rglob("*.sqlite")) == []
    assert processes_with(bag) == []


def test_missing_calibration_is_named_before_any_telemetry(tmp_path):
    file = tmp_path / "none.yaml"
    command = ["ema", "up", "monitor", "-p", f"calibration_file={file}"]
    with started(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr
        assert any(f"{file} is missing; calibrate" in line for line in process.stderr)
        process.send_signal(signal.SIGINT)


def test_failed_node_is_reported_and_gives_exit_code_1(ema, capfd):
    result = ema("up", "player", "-p", "rate:=1.0")
    assert (result.exit_code, "player failed, exit code 1" in result.stderr) == (1, True)
    assert "parameter bag is empty" in capfd.readouterr().err  # of the node process
