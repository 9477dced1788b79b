# SPDX-License-Identifier: Apache-2.0
"""``ema verify`` recomputes recorded estimates, and detects altered ones."""

import json
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from ema_archive.store import Store
from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_bags.writer import BagWriter
from ema_cli.commands.verify import Verified
from ema_core.commands import THESIS_CHIRP, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.diagnosis import Diagnosed, Diagnosis, diagnose
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.model.threads import limit_threads
from ema_monitor.node.publish.messages import estimate_to_message
from ema_monitor.prognosis.history import History, history_path
from ema_monitor.prognosis.history_entry import Entry
from ema_monitor.quantities import INERTIA
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_monitor.windows.window import Window
from ema_ros import topics
from ema_sim.actuator import SimulatedActuator

from ..monitor.comparisons import CASES, changed, compared, comparison
from .conftest import repeated

FLAP = ActuatorDescription()


@pytest.fixture(scope="module")
def recorded(faulty_blocks) -> tuple[list[Telemetry], list[Diagnosed]]:
    """Return three cycles of a faulty actuator, and estimates with a warm start from the second."""
    blocks, finder = repeated(faulty_blocks, 3), WindowFinder(TriggerSettings(), FLAP)
    windows = [
        event for block in blocks for event in finder.feed(block) if isinstance(event, Segment)
    ]
    reported = [
        event for event in diagnose(windows, Calibration.builtin()) if isinstance(event, Diagnosed)
    ]
    return blocks, reported


@pytest.fixture
def bag_of_estimates(tmp_path: Path) -> Callable[..., Path]:
    def write(blocks, reported, name: str = "bag.mcap", change=lambda message: None) -> Path:
        class_, qos = topics.MONITOR_TOPICS[topics.FAULT_ESTIMATE]
        (tmp_path / name).parent.mkdir(exist_ok=True)
        bag = BagWriter(str(tmp_path / name))
        with SimulatedActuatorBag(bag, FLAP) as written:
            for block in blocks:
                written.write_block(block, 0.0)
            bag.add_topic("/ema/fault_estimate", class_, qos)
            for diagnosed in reported:
                message = estimate_to_message(diagnosed.estimate, diagnosed.number, FLAP)
                change(message)
                end_ns = diagnosed.estimate.end_ns
                bag.write("/ema/fault_estimate", message, blocks[-1].stamp_ns, end_ns)
        return tmp_path / name

    return write


@pytest.fixture
def bag_of(recorded, bag_of_estimates) -> Callable[..., Path]:
    def write(name: str = "bag.mcap", *, skips: int = 0, change=lambda message: None) -> Path:
        blocks, reported = recorded
        return bag_of_estimates(blocks, reported[skips:], name, change)

    return write


def states(result) -> list[str]:
    return [window["state"] for window in json.loads(result.stdout)]


def test_recomputed_estimates_are_identical_also_after_a_warm_start(ema, bag_of, recorded):
    assert [diagnosed.estimate.warm_start for diagnosed in recorded[1]] == [False, True, True]
    result = ema("verify", bag_of())
    assert result.exit_code == 0
    assert "3 identical" in result.output


@pytest.mark.parametrize(("by", "state"), [(1e-9, "equal within rounding"), (0.01, "different")])
def test_altered_estimate_is_reported_with_its_difference(ema, bag_of, by, state):
    def alter(message):
        if message.window == 2:
            message.faults.friction += by

    result = ema("verify", bag_of(change=alter), "--json")
    assert states(result) == ["identical", "identical", state]
    assert json.loads(result.stdout)[-1]["difference"] == pytest.approx(by, rel=1e-3)
    assert result.exit_code == (3 if state == "different" else 0)


def of_another_calibration(message):
    message.calibration_id = "X-1"


def of_another_verdict(message):
    message.verdict, message.valid = message.REFUSED, False


def of_another_time(message):
    message.window_end.sec += 100


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (of_another_verdict, "the verdict was refused and is valid"),
        (of_another_calibration, "calibration X-1 is missing"),
        (of_another_time, "cannot be recomputed"),
    ],
)
def test_estimate_of_other_telemetry_is_reported(ema, bag_of, change, words):
    result = ema("verify", bag_of(change=change))
    assert (result.exit_code, words in result.output) == (3, True), result.output


def test_search_that_started_from_a_missing_estimate_cannot_be_recomputed(ema, bag_of):
    result = ema("verify", bag_of(skips=1))
    assert result.exit_code == 0
    assert "window 1: cannot be recomputed (its search started from a missing" in result.output
    assert "window 2: identical" in result.output


@pytest.fixture(scope="module")
def worn_blocks() -> list[Telemetry]:
    """Return telemetry of three cycles with backlash, so that the position in the play matters."""
    actuator = SimulatedActuator()
    actuator.faults = fault_vector({"backlash": 0.5})
    samples = build_cycle(THESIS_CHIRP, 1e-4).samples
    parts = np.split(samples, range(100, len(samples), 100))
    return repeated([actuator.advance(part) for part in parts], 3)


def windows_in(blocks: list[Telemetry]) -> list[Segment]:
    finder = WindowFinder(TriggerSettings(), FLAP)
    return [event for block in blocks for event in finder.feed(block) if isinstance(event, Segment)]


@pytest.mark.parametrize("loses_last", [False, True])
def test_estimates_of_a_restarted_monitor_are_identical(
    ema, worn_blocks, bag_of_estimates, loses_last
):
    """The monitor restarts in motion before a window; its history may lack the last estimate."""
    blocks = worn_blocks
    first, second, _ = windows_in(blocks)
    made, monitor = [], Diagnosis()
    for entry in (first, second):
        made += [item for item in diagnose_one(monitor, entry)]
    after = next(n for n, block in enumerate(blocks) if block.stamp_ns > made[-1].estimate.end_ns)
    restarted, kept = Diagnosis(), made[: 1 if loses_last else 2]
    for entry in kept:
        restarted.begin_at(FLAP, entry.estimate)
    later = next(
        windows
        for skipped in range(0, len(blocks) - after, 5)
        if (windows := windows_in(blocks[after + skipped :]))
        and isinstance(window := windows[0].window, Window)
        and window.play is None
    )
    made += [item for entry in later for item in diagnose_one(restarted, entry)]
    assert [entry.number for entry in made] == [0, 1, 0]
    result = ema("verify", bag_of_estimates(blocks, made))
    assert (result.exit_code, "3 identical" in result.output) == (0, True), result.output
    assert "as from a monitor started during the motion before the window" in result.output
    assert ("without the previous test" in result.output) == loses_last


def diagnose_one(monitor: Diagnosis, window: Segment) -> list[Diagnosed]:
    every = monitor.add(window, Calibration.builtin(), SearchSettings())
    return [event for event in every if isinstance(event, Diagnosed)]


def test_archive_is_recomputed_from_its_bags(ema, bag_of, tmp_path: Path):
    bag_of("bags/one.mcap")
    gone = bag_of("bags/two.mcap", skips=3)
    archive = tmp_path / "archive"
    assert ema("archive", "scan", archive, tmp_path / "bags").exit_code == 0
    run = ("archive", "run", archive, "--executor", "threads", "--workers", "1")
    assert ema(*run).exit_code == 0
    limit_threads(None)
    result = ema("verify", archive)
    assert (result.exit_code, "6 identical" in result.output) == (0, True), result.output

    with Store(archive) as store, store.changing() as db:
        altered = "bag LIKE '%one.mcap' AND number = 1"
        db.execute(f"UPDATE estimates SET friction = friction + 0.01 WHERE {altered}")
    gone.unlink()
    result = ema("verify", archive, "--json")
    assert result.exit_code == 3
    reported = json.loads(result.stdout)
    assert [window["state"] for window in reported[:3]] == ["identical", "different", "identical"]
    assert reported[1]["difference"] == pytest.approx(0.01)
    assert [window["state"] for window in reported[3:]] == ["cannot be recomputed"] * 3
    assert "two.mcap" in reported[3]["reason"]


def test_history_is_recomputed_and_alterations_are_reported(ema, bag_of, recorded, tmp_path):
    path = history_path(tmp_path, *FLAP.unit_key)
    history = History(*FLAP.unit_key, path)
    for number, diagnosed in enumerate(recorded[1]):
        history.append(Entry(diagnosed.estimate, float(number), number + 1))
    history.close()
    bag = bag_of()
    result = ema("verify", path, "--bag", bag)
    assert (result.exit_code, "3 identical" in result.output) == (0, True), result.output
    assert ema("verify", path).exit_code == 3  # Without telemetry, no estimate can be recomputed.

    with closing(sqlite3.connect(path)) as db, db:
        db.execute("UPDATE test SET record = record || ' ' WHERE number = 2")
    before = path.read_bytes()
    result = ema("verify", path, "--bag", bag, "--json")
    assert (result.exit_code, path.read_bytes()) == (3, before)
    reported = json.loads(result.stdout)
    assert (reported[0]["state"], reported[0]["window"]) == ("altered", None)
    assert "test 2 is damaged: its checksum is wrong" in reported[0]["reason"]
    assert len(reported) == 3


def test_quantities_of_a_record_are_compared_bit_for_bit():
    recorded = compared(comparison(changed(INERTIA, 0.3)))
    reported = Verified("elbow", 0)
    assert reported.compared(recorded, compared(comparison(changed(INERTIA, 0.3)))).state == (
        "identical"
    )
    # The faults are unchanged: inertia is not a fault.
    altered = reported.compared(recorded, compared(comparison(changed(INERTIA, 0.31))))
    assert (altered.state, altered.difference) == ("different", pytest.approx(0.01))
    hidden = reported.compared(
        compared(CASES["healthy"]), compared(CASES["healthy"], comparison=None)
    )
    assert hidden.reason == "the compared quantities differ"
