# SPDX-License-Identifier: Apache-2.0
import io
import os
import re
import signal
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from ament_index_python.packages import get_package_share_directory
from matplotlib.image import imread
from rich.console import Console

from ema_bags.reader import Bag
from ema_bags.telemetry import HEALTH_TYPE
from ema_cli.bags.diagnoses import DiagnosedWindow, DiagnosisLog, read_history
from ema_cli.figures.history import draw_history
from ema_cli.processes import demo_run, listener
from ema_cli.processes.demo_run import SHOWN, Technician
from ema_cli.processes.observer import Observer
from ema_cli.show.live_table import LiveTable
from ema_core.faults import fault_vector
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_interfaces.msg import Health
from ema_monitor.prognosis.history import read_history as read_history_file
from ema_monitor.recordings.windows import truth_at
from ema_ros.messages import StampedFaults
from ema_ros.stamps import stamp_from_message

from ..waiting import DEADLINE_S, started, wait_for

MARK = "EMA_TEST_OF_THE_DEMO"
CAUSE = "torque margin 0.59 (warns below 0.62, fails below 0.5)"
FAILED = DiagnosedWindow(
    30, 0, 1, fault_vector({"friction": 0.6}), np.full(8, 0.004), True, "", 0.8,
    cycle=30, level=ERROR, cause="friction 0.6 (failed: above 0.5)",
)  # fmt: skip


class Demo:
    """A demo in a process, whose descendants are found by a mark in their environment."""

    def __init__(self, folder: Path, duration_s: float) -> None:
        self.folder = folder
        self.log = folder.with_name(f"{folder.name}.log")
        environment = {name: os.environ[name] for name in os.environ if name != "ROS_DOMAIN_ID"}
        environment[MARK] = str(folder)
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                ["ema", "demo", "--duration", str(duration_s), "-o", str(folder)],
                env=environment,
                stdout=log,
                stderr=subprocess.STDOUT,
            )

    @property
    def printed(self) -> str:
        return self.log.read_text()

    def wait_until(self, is_reached: Callable[[], bool]) -> None:
        try:
            wait_for(lambda: is_reached() or self.process.poll() is not None, "a state of the demo")
            assert is_reached(), self.printed
        except AssertionError:
            self.process.kill()
            raise

    def interrupt(self, number: signal.Signals) -> None:
        """Interrupt the demo twice, as an impatient user does, and wait until it has ended."""
        self.process.send_signal(number)
        self.process.send_signal(number)
        assert self.process.wait(timeout=DEADLINE_S) == 128 + number
        assert self.descendants() == {}
        assert "Traceback" not in self.printed
        assert "interrupted" in self.printed

    def descendants(self) -> dict[int, bytes]:
        """Return the command lines of the demo and its nodes by process id."""
        processes = {}
        for folder in Path("/proc").iterdir():
            try:
                if f"{MARK}={self.folder}".encode() in (folder / "environ").read_bytes():
                    processes[int(folder.name)] = (folder / "cmdline").read_bytes()
            except (OSError, ValueError):  # no such process, or it has just ended
                continue
        return processes


@pytest.fixture(scope="module")
def demos(tmp_path_factory):
    """Run two demos concurrently in separate domains: one to its end, one interrupted."""
    folder = tmp_path_factory.mktemp("demos")
    finished, interrupted = Demo(folder / "one", 7.0), Demo(folder / "other", 60.0)
    try:
        interrupted.wait_until(
            lambda: len(re.findall("^ +[0-9]+  ", interrupted.printed, re.MULTILINE)) >= 2
        )
        interrupted.interrupt(signal.SIGINT)
        assert finished.process.wait(timeout=DEADLINE_S) == 0, finished.printed
    except BaseException:
        finished.process.kill()
        interrupted.process.kill()
        raise
    return finished, interrupted


@pytest.fixture(scope="module")
def finished(demos):
    return demos[0]


def test_concurrent_demos_have_separate_domains_and_dashboards(demos):
    domains = [re.findall(r"ROS_DOMAIN_ID=(\d+)", demo.printed)[0] for demo in demos]
    assert domains[0] != domains[1]
    addresses = [
        re.findall(r"^dashboard at (http://127.0.0.1:\d+/)$", d.printed, re.M) for d in demos
    ]
    assert [len(address) for address in addresses] == [1, 1]
    assert addresses[0] != addresses[1]  # A port that is in use is skipped.


def test_demo_leaves_bag_and_picture_and_no_process(finished):
    assert finished.descendants() == {}
    bag = Bag(finished.folder / "bag")
    assert bag.damage == ""
    for name in ("telemetry", "simulated_faults", "usage", "fault_estimate", "health"):
        assert bag.topics[f"/ema/{name}"].count > 0, name
    # The actuator counts its service hours from zero: ten per cycle.
    truths = read_history(finished.folder / "bag").truths
    for item in bag.messages(["/ema/health"]):
        cycle = truth_at(truths, stamp_from_message(item.message.header.stamp))
        assert cycle is not None
        assert item.message.flight_hours == 10.0 * cycle.cycle
    # A monitor that is restarted with the same folder continues this history.
    [history] = (finished.folder / "history").glob("flap+*.sqlite")
    tests = read_history_file(history).entries
    assert len(tests) == sum(
        diagnosis.valid for diagnosis in read_history(finished.folder / "bag").diagnoses()
    )
    picture = imread(finished.folder / "history.png")
    assert picture.shape[0] > 400
    assert picture.shape[1] > 800
    # For an empty page, or a page with empty axes only, the share is below 0.05.
    assert np.std(picture[..., :3]) > 0.1
    assert f"picture  {finished.folder / 'history.png'}" in finished.printed


def test_demo_prints_a_line_a_cycle_and_the_latency(demos):
    finished, _ = demos
    cycles = [
        re.findall(
            r"^ +(\d+)  [\d.]+ → [\d.]+ ± [\d.]+ .*(?:OK|WARN) +([\d.]+) s(?:  .+)?$",
            demo.printed,
            re.MULTILINE,
        )
        for demo in demos
    ]
    # On a busy machine, few cycles pass during a demo, and a level may be STALE by then.
    assert all(len(lines) >= 1 for lines in cycles)
    assert len(re.findall("^ +[0-9]+  ", demos[1].printed, re.MULTILINE)) >= 2
    assert finished.printed.count("\ncycle  friction ") == 1
    assert all(float(latency) > 0.0 for lines in cycles for _, latency in lines)
    assert re.search(r"latency median [\d.]+ s, 95 % below [\d.]+ s", finished.printed)


def test_demo_ends_between_two_windows_and_waits_for_the_last(finished):
    history = read_history(finished.folder / "bag")
    diagnoses = history.diagnoses()
    assert [
        diagnosis.reason for diagnosis in diagnoses if "telemetry ends" in diagnosis.reason
    ] == []
    # The next cycle may have begun, but not its window.
    assert diagnoses[-1].start_ns >= history.truths[-2].stamp_ns


@pytest.mark.parametrize(
    ("moment", "number"), [("actuator.log", signal.SIGINT), ("bag", signal.SIGTERM)]
)
def test_demo_interrupted_at_its_start_leaves_no_process_and_a_readable_bag(
    tmp_path, moment, number
):
    demo = Demo(tmp_path / "demo", 60.0)
    demo.wait_until((demo.folder / moment).exists)
    demo.interrupt(number)
    assert moment != "bag" or Bag(demo.folder / "bag").damage == ""


def test_demo_interrupted_during_its_cycles_leaves_the_estimates_in_a_readable_bag(demos):
    _, interrupted = demos
    bag = Bag(interrupted.folder / "bag")
    assert bag.damage == ""
    assert bag.topics["/ema/fault_estimate"].count > 0


def test_dead_node_ends_the_demo_and_its_log_is_named(tmp_path):
    demo = Demo(tmp_path / "demo", 60.0)
    # Only imports precede this log line; the nodes may be at any step of their start.
    demo.wait_until(lambda: any(b"monitor_node" in line for line in demo.descendants().values()))
    [monitor] = [n for n, line in demo.descendants().items() if b"monitor_node" in line]
    os.kill(monitor, signal.SIGKILL)
    assert demo.process.wait(timeout=DEADLINE_S) == 1
    assert demo.descendants() == {}
    assert "monitor was terminated by SIGKILL" in demo.printed
    assert re.search(rf"Error: monitor failed: .*see {demo.folder / 'monitor.log'}\n", demo.printed)


def test_failed_actuator_is_repaired_once_and_wears_again_and_blocks_a_demo(
    ema, tmp_path, monkeypatch
):
    monkeypatch.setattr(
        demo_run, "set_reach", lambda _: None
    )  # It would change the environment of this process.
    monkeypatch.setattr(listener, "_DISCOVERY_S", DEADLINE_S)
    failed, well = FAILED, replace(FAILED, window=31, cycle=31, level=OK, cause="")
    technician = Technician()
    command = ["ema", "up", "actuator", "-p", "faults.friction=0.6", "-p", "rate=4.0"]
    with started(command, stderr=subprocess.DEVNULL) as actuator, Observer("demo") as observer:
        frictions = lambda: [truth.faults[0] for truth in observer._history.truths]  # noqa: E731
        try:
            wait_for(lambda: frictions()[-1:] == [0.6], "a cycle of the worn actuator")
            refused = ema("demo", "-o", tmp_path / "demo")
            domain = os.environ["ROS_DOMAIN_ID"]
            assert f"a node /ema/actuator is already running in domain {domain}" in refused.stderr
            assert (refused.exit_code, (tmp_path / "demo").exists()) == (1, False)
            assert technician.look([well], observer) == ""
            reported = technician.look([well, failed], observer)
            assert "failed in cycle 30: friction 0.6 (failed: above 0.5)" in reported
            assert "next: remove the unit, repair the worn part" in reported
            assert technician.look([failed], observer) == ""  # until it is reported healthy
            wait_for(lambda: 0.0 < frictions()[-1] < 0.1, "the growth of the repaired one")
            confirmed = technician.look([failed, well], observer)
            assert confirmed == "cycle 31 confirms the repair: OK again"
            assert technician.look([failed, well], observer) == ""
        finally:
            actuator.send_signal(signal.SIGTERM)


def test_non_empty_folder_is_refused(ema, tmp_path, monkeypatch):
    monkeypatch.setattr(demo_run, "set_reach", lambda _: None)
    (tmp_path / "note").touch()
    refused = ema("demo", "-o", tmp_path)
    assert refused.exit_code == 1
    assert "already exists: expected a new or empty folder" in refused.stderr
    assert [item.name for item in tmp_path.iterdir()] == ["note"]


def test_only_growing_faults_are_shown():
    path = Path(get_package_share_directory("ema_bringup"), "config", "demo.yaml")
    actuator = yaml.safe_load(path.read_text(encoding="utf-8"))["/**/actuator"]
    assert tuple(actuator["ros__parameters"]["growth"]) == SHOWN


def shown(width: int, **changes) -> str:
    """Return a warning as a terminal of ``width`` columns shows it."""
    diagnosis = replace(
        FAILED, window=0, faults=fault_vector({"friction": 0.21}), latency_s=0.84, cycle=12,
        truth=fault_vector({"friction": 0.2}), level=WARN, cause=CAUSE,
    )  # fmt: skip
    screen = io.StringIO()
    console = Console(file=screen, force_terminal=True, width=width, height=30, color_system=None)
    with LiveTable(SHOWN, console) as table:
        table.show([replace(diagnosis, **changes)], "test cycle 13")
    return re.sub(r"\x1b\[[?0-9]*[A-Za-z]", "", screen.getvalue())


def test_table_on_a_terminal_shows_truth_estimate_level_and_latency():
    screen = shown(80)
    assert max(len(line) for line in screen.splitlines()) <= 80
    for words in ("0.200→0.210±0.004", "12", "WARN", "0.84 s", "test cycle 13"):
        assert words in screen
    assert f"WARN since cycle 12, now: {CAUSE}" in " ".join(screen.split())
    assert "0.200→none" in shown(80, valid=False)


def test_picture_states_when_each_level_first_occurred_and_why():
    diagnosis = replace(FAILED, latency_s=0.84, cycle=None, level=None, cause="")
    history = DiagnosisLog("flap", "0001", limits={"friction": 0.5})
    levels = (OK, WARN, WARN, ERROR, STALE)
    history._diagnosed = {
        i: replace(diagnosis, window=i, start_ns=i, end_ns=i, valid=level != STALE)
        for i, level in enumerate(levels)
    }
    history._levels = {i: (level, CAUSE) for i, level in enumerate(levels)}
    history.truths = [StampedFaults(i, "flap", i, diagnosis.faults) for i in range(len(levels))]
    figure = draw_history(history)
    assert f"WARN first in cycle 1: {CAUSE}" in figure.axes[0].get_title(loc="left")
    markers = [line.get_marker() for line in figure.axes[1].lines]
    assert len(set(markers)) == len(markers) == 6, "distinct without colour"
    [legend] = figure.legends
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels == [
        "truth", "no valid estimate", "limit", "WARN", "ERROR", "STALE", "estimate, 90 % interval",
        "median latency, 0.84 s",
    ]  # fmt: skip


def test_republished_health_counts_again_unless_it_is_stale():
    history = DiagnosisLog("flap", "0001")
    message = Health(actuator_id="flap", level=OK)
    message.header.stamp.sec = 5
    levels = []
    for level in (OK, WARN, STALE):
        message.level = level
        history.add(HEALTH_TYPE, message, 0)
        levels.append(history._levels[5_000_000_000][0])
    assert levels == [OK, WARN, WARN]
