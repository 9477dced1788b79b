# SPDX-License-Identifier: Apache-2.0
"""`ema watch`: messages of monitors from worst to best, as a table or a line per change."""

import io
import math
import os
import pty
import re
import signal
from collections.abc import Callable, Iterator

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rich.console import Console

from ema_cli.processes.health_listener import Completion
from ema_cli.show.health_table import HealthTable, LatestHealths
from ema_core.description import ActuatorDescription
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_core.wording import time_text
from ema_interfaces.msg import (
    BaselineStatus,
    FaultEstimate,
    FaultHealth,
    Health,
    HiddenCause,
    RemainingUsefulLife,
    TelemetryStatus,
)
from ema_monitor.node.publish.messages import estimate_to_message
from ema_ros.stamps import stamp_to_message
from ema_ros.topics import FAULT_ESTIMATE, HEALTH, MONITOR_TOPICS, NAMESPACE

from ..monitor.comparisons import CASES, HIDDEN, STILL, compared
from ..ros.spinning import ros_context, spinning
from ..waiting import DEADLINE_S, started, wait_for

FLAP = ActuatorDescription()
TEST_NS = 1_700_000_000_000_000_000


def health_of(actuator_id: str, level: int, life: tuple[float, float, float] | None) -> Health:
    """Return health at 100 service hours; ``life`` has the quantiles of the remaining life [h]."""
    low, median, high = life or (math.nan,) * 3
    rul = RemainingUsefulLife(known=life is not None, hours_05=low, hours_50=median, hours_95=high)
    friction = FaultHealth(
        name="friction", level=level, value=0.31, sigma=0.002, limit=0.5, unit="1", rul=rul
    )
    message = Health(
        actuator_id=actuator_id,
        serial_number=f"{actuator_id}-1",
        author="/ema/monitor",
        level=level,
        health_index=0.38,
        dominant_fault="friction" if level != OK else "",
        faults=[friction],
        rul=rul,
        flight_hours=100.0,
        cause="friction 0.31 (fails above 0.5)" if level == WARN else "",
    )
    message.header.stamp = stamp_to_message(TEST_NS)
    return message


def refused(actuator_id: str, stamp_ns: int) -> FaultEstimate:
    message = FaultEstimate(actuator_id=actuator_id, valid=False, reason="no excitation")
    message.header.stamp = stamp_to_message(stamp_ns)
    return message


def baseline_of(actuator_id: str, state: int = BaselineStatus.LEARNING) -> BaselineStatus:
    return BaselineStatus(
        actuator_id=actuator_id,
        serial_number=f"{actuator_id}-1",
        state=state,
        records=4,
        records_needed=12,
    )


def alive(_place: str, _author: str) -> bool:
    """Return True: every monitor is alive."""
    return False


def received(*healths: Health) -> LatestHealths:
    """Return the latest healths, all received at 0 s."""
    latest = LatestHealths()
    for health in healths:
        latest.add_health("/ema", health, 0.0, TEST_NS)
    return latest


def test_worst_actuator_comes_first_and_among_equals_the_shortest_life():
    healths = received(
        health_of("a", OK, None),
        health_of("b", WARN, (50.0, 80.0, 100.0)),
        health_of("c", WARN, (20.0, 80.0, 100.0)),
        health_of("d", STALE, None),
        health_of("e", ERROR, None),
    )
    assert [row.actuator_id for row in healths.rows(1.0, TEST_NS, alive)] == [
        "e",
        "d",
        "c",
        "b",
        "a",
    ]


def test_row_shows_value_life_and_removal():
    [row] = received(health_of("a", WARN, (20.0, 80.0, 100.0))).rows(
        1.0, TEST_NS + 3 * 10**9, alive
    )
    assert row.dominant == "friction 0.31 ± 0.002 (≤ 0.5)"
    assert row.life == (20.0, 80.0, 100.0)
    assert (row.must_remove, row.remove_before) == (False, 120.0)
    assert row.test_age_s == pytest.approx(3.0)
    assert row.why == "friction 0.31 (fails above 0.5)"
    [failed] = received(health_of("a", ERROR, (0.0, 0.0, 0.0))).rows(1.0, TEST_NS, alive)
    assert failed.must_remove


def test_actuator_is_stale_while_its_monitor_is_silent():
    healths = received(health_of("a", ERROR, None), health_of("b", WARN, None))
    duplicate = health_of("c", OK, None)
    duplicate.author = "/ema/monitor_1"
    healths.add_health("/ema", duplicate, 0.0, TEST_NS)
    is_silent = {("/ema", "/ema/monitor"), ("/right", "/ema/monitor_1")}.__contains__
    rows = healths.rows(1.0, TEST_NS, lambda *monitor: is_silent(monitor))
    levels = {row.actuator_id: (row.level, row.last_level) for row in rows}
    assert levels == {"a": (STALE, ERROR), "b": (STALE, WARN), "c": (OK, OK)}
    assert rows[0].why.startswith("/ema/monitor is silent, the level was ERROR")
    assert [row.level for row in healths.rows(2.0, TEST_NS, alive)] == [ERROR, WARN, OK]


def test_refused_test_is_reported_until_the_next_valid_one():
    healths = received(health_of("a", WARN, None))
    [before] = healths.rows(1.0, TEST_NS, alive)
    later_ns = TEST_NS + 10**10
    healths.add_estimate("/ema", refused("a", later_ns), 2.0)
    [row] = healths.rows(3.0, later_ns + 10**9, alive)
    assert row.why == "friction 0.31 (fails above 0.5); last test refused: no excitation"
    assert (row.test_ns, row.test_age_s) == (later_ns, pytest.approx(1.0))
    assert row.content != before.content
    valid = FaultEstimate(actuator_id="a", valid=True)
    valid.causes = [HiddenCause(name="load_torque", value=0.3, sigma=0.01, unit="N.m")]
    healths.add_estimate("/ema", valid, 4.0)
    [row] = healths.rows(4.0, later_ns, alive)
    assert row.why.endswith("; hidden cause: load torque +0.3 ± 0.01 N.m")


def test_refused_test_is_not_reported_twice():
    """The health after a refused test states the reason, perhaps worded differently."""
    later_ns = TEST_NS + 10**10
    health = health_of("a", STALE, None)
    health.tested, health.reason = stamp_to_message(later_ns), "no motion in the newest test"
    healths = received(health)
    healths.add_estimate("/ema", refused("a", later_ns), 2.0)
    [row] = healths.rows(3.0, later_ns + 10**9, alive)
    assert row.why == "no motion in the newest test"
    healths.add_estimate("/ema", refused("a", later_ns + 10**9), 4.0)
    [row] = healths.rows(5.0, later_ns + 2 * 10**9, alive)
    assert row.why == "no motion in the newest test; last test refused: no excitation"
    health.level, health.reason, health.cause = ERROR, "", "a failed drive: no excitation"
    failed = refused("a", later_ns)
    failed.verdict = FaultEstimate.FAILED
    jammed = received(health)
    jammed.add_estimate("/ema", failed, 5.0)
    [row] = jammed.rows(5.0, later_ns + 10**9, alive)
    assert row.why == "a failed drive: no excitation"
    health.level, health.reason, health.cause = STALE, "no motion in the newest test", ""
    # The level of a departed test was withdrawn for a reason of its own.
    departed = refused("a", later_ns)
    departed.verdict = FaultEstimate.DEPARTED
    healths.add_estimate("/ema", departed, 5.0)
    [row] = healths.rows(5.0, later_ns + 2 * 10**9, alive)
    assert row.why == "no motion in the newest test; last test refused: no excitation"


@pytest.mark.parametrize(
    ("name", "reported"),
    [
        ("healthy", "Coulomb friction +0.0 %, unchanged (changes above 6 % would show)"),
        ("friction", "Coulomb friction +15.2 %, changed"),
        ("inertia without friction", f"Coulomb friction not judged ({HIDDEN})"),
    ],
)
def test_friction_of_a_record_is_reported_with_the_health(name: str, reported: str):
    healths = received(health_of("flap", OK, None))
    healths.add_estimate("/ema", estimate_to_message(compared(CASES[name]), 0, FLAP), 2.0)
    [row] = healths.rows(3.0, TEST_NS, alive)
    assert row.why == reported


def test_record_without_a_judgement_is_reported_and_has_no_index():
    health = health_of("flap", STALE, None)
    health.health_index = math.nan
    healths = received(health)
    healths.add_estimate("/ema", estimate_to_message(compared(CASES["nothing"]), 0, FLAP), 2.0)
    [row] = healths.rows(3.0, TEST_NS, alive)
    assert row.why == f"last test refused: {STILL}"
    # An unknown index is the most urgent of its level.
    rows = received(health, health_of("b", STALE, None)).rows(3.0, TEST_NS, alive)
    assert [item.actuator_id for item in rows] == ["flap", "b"]


def counted(windows: int, valid: int, invalid: int = 0) -> list[TelemetryStatus]:
    return [
        TelemetryStatus(
            actuator_id="flap", windows=windows, estimates_valid=valid, estimates_invalid=invalid
        )
    ]


def test_playback_is_complete_when_each_window_has_an_estimate_and_counters_are_constant():
    completion = Completion()
    completion.add_report("/ema", counted(2, 2))
    completion.add_report("/ema", counted(2, 2))
    assert not completion.is_complete  # The player has not ended.
    completion.end()
    completion.add_report("/ema", counted(3, 2))
    completion.add_report("/ema", counted(3, 2))
    assert not completion.is_complete
    completion.add_report("/ema", counted(3, 2, 1))
    assert not completion.is_complete
    completion.add_report("/ema", counted(3, 2, 1))
    assert completion.is_complete


def test_playback_is_complete_when_the_monitors_of_all_namespaces_have_finished():
    completion = Completion()
    completion.add_report("/left", counted(1, 0))
    completion.end()
    for _ in range(2):
        completion.add_report("/right", counted(1, 1))
    assert not completion.is_complete
    for _ in range(2):
        completion.add_report("/left", counted(1, 1))
    assert completion.is_complete


def test_passing_of_time_is_not_a_change():
    healths = received(health_of("a", WARN, (20.0, 80.0, 100.0)))
    [before], [after] = healths.rows(1.0, TEST_NS, alive), healths.rows(2.0, TEST_NS + 10**9, alive)
    assert before.content == after.content
    assert before.test_age_s != after.test_age_s


def test_age_of_a_stamp_of_another_clock_counts_from_reception():
    [row] = received(health_of("a", OK, None)).rows(2.5, 0, alive)
    assert row.test_age_s == 2.5


def test_ages_are_in_suitable_units():
    ages = [time_text(seconds) for seconds in (0.4, 119.0, 7199.0, 7200.0, 864000.0, math.nan)]
    assert ages == ["0 s", "119 s", "120 min", "2 h", "10 d", "-"]


def shown(width: int) -> str:
    """Return two actuators as a terminal of ``width`` columns shows them."""
    screen = io.StringIO()
    console = Console(file=screen, force_terminal=True, width=width, height=30, color_system=None)
    healths = health_of("left", WARN, (20.0, 80.0, 100.0)), health_of("right", OK, None)
    with HealthTable("on /ema in domain 3", console) as table:
        table.show(received(*healths).rows(1.0, TEST_NS, alive), "")
    return re.sub(r"\x1b\[[?0-9]*[A-Za-z]", "", screen.getvalue())


@pytest.mark.parametrize("width", [140, 80])
def test_table_fits_the_terminal_and_states_the_reasons(width):
    screen = shown(width)
    assert max(map(len, screen.splitlines())) <= width
    printed = " ".join(screen.split())
    for words in (
        "2 actuators on /ema in domain 3",
        *("▲ WARN", "● OK", "0.38", "80 (20 to 100)", "120 h", "friction 0.31 ±"),
        "left: friction 0.31 (fails above 0.5)",
    ):
        assert words in printed


@pytest.fixture
def publish() -> Iterator[Callable[[Health | FaultEstimate], None]]:
    """Return a function that publishes messages like a monitor of two actuators."""
    with ros_context() as context:
        node = Node("monitor", namespace=NAMESPACE, context=context)
        kind, qos = MONITOR_TOPICS[HEALTH]
        # Like the monitor: one publisher per actuator, so that the last message of each is kept.
        healths = {name: node.create_publisher(kind, HEALTH, qos) for name in ("left", "right")}
        estimates = node.create_publisher(FaultEstimate, FAULT_ESTIMATE, 10)

        def send(message: Health | FaultEstimate) -> None:
            name = message.actuator_id
            (healths[name] if isinstance(message, Health) else estimates).publish(message)

        try:
            with spinning(SingleThreadedExecutor(context=context), node):
                yield send
        finally:
            node.destroy_node()


@pytest.mark.slow
def test_piped_watch_writes_a_line_for_each_change_and_ends_with_0(publish, tmp_path):
    log = tmp_path / "log"
    publish(health_of("left", OK, None))
    with log.open("w") as file, started(["ema", "watch"], stdout=file) as process:
        wait_for(lambda: "● OK  /ema/left (left-1)" in log.read_text(), "the first actuator")
        publish(health_of("right", WARN, (20.0, 80.0, 100.0)))
        wait_for(lambda: "/ema/right" in log.read_text(), "the second one")
        publish(refused("right", TEST_NS + 10**9))
        wait_for(lambda: "last test refused: no excitation" in log.read_text(), "the refusal")
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=DEADLINE_S) == 0
    lines = log.read_text().splitlines()
    assert len(lines) == 3
    for words in (
        "▲ WARN  /ema/right (right-1)",
        "friction 0.31 ± 0.002 (≤ 0.5)",
        "RUL 80 (20 to 100) h",
        "remove before 120 h",
        "friction 0.31 (fails above 0.5)",
    ):
        assert words in lines[1]


@pytest.mark.slow
def test_watch_on_a_terminal_shows_a_table_and_ends_with_0_on_ctrl_c(publish):
    publish(health_of("left", OK, None))
    publish(health_of("right", WARN, (20.0, 80.0, 100.0)))
    ours, theirs = pty.openpty()
    environment = os.environ | {"COLUMNS": "120", "LINES": "30", "TERM": "xterm"}
    seen = b""
    with started(
        ["ema", "watch"], stdin=theirs, stdout=theirs, env=environment, start_new_session=True
    ) as process:
        os.close(theirs)
        # Until the worst actuator is in the first row.
        while not re.search(rb"(?s)2 actuators on /ema.*WARN.*left", seen):
            seen += os.read(ours, 65536)
        process.send_signal(signal.SIGINT)
        try:
            while os.read(ours, 65536):
                pass
        except OSError:  # a terminal that its last process has closed
            pass
        assert process.wait(timeout=DEADLINE_S) == 0
    os.close(ours)


@pytest.mark.slow
def test_watch_reports_missing_messages_and_the_namespaces_that_have_some(publish, tmp_path):
    publish(health_of("left", OK, None))
    log = tmp_path / "log"
    command = ["ema", "watch", "--namespace", "wing/left"]
    with log.open("w") as file, started(command, stderr=file, stdout=file) as process:
        wait_for(lambda: "with --namespace" in log.read_text(), "a report of nothing received")
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=DEADLINE_S) == 0
    domain = os.environ["ROS_DOMAIN_ID"]
    assert log.read_text().startswith(
        f"no health is published on /wing/left in domain {domain}, but on /ema: select it with"
    )


def test_learning_joint_is_shown_with_its_progress_instead_of_stale():
    stale = health_of("elbow", STALE, None)
    stale.cause, stale.reason = "", "learning: 4 records on 1 day"
    latest = received(stale, health_of("wrist", OK, None))
    for name in ("elbow", "wrist"):
        latest.add_baseline("/ema", baseline_of(name))
    rows = {row.actuator_id: row for row in latest.rows(1.0, TEST_NS + 10**9, alive)}
    assert rows["elbow"].level_text == "◌ LEARNING 4 of 12"
    assert rows["elbow"].why == "learning: 4 records on 1 day"
    assert rows["wrist"].level_text == "● OK"
    # A silent monitor learns nothing, nor does a unit with an accepted baseline.
    silent = latest.rows(1.0, TEST_NS + 10**9, lambda *_: True)
    assert {row.actuator_id: row for row in silent}["elbow"].level_text == "○ STALE"
    latest.add_baseline("/ema", baseline_of("elbow", BaselineStatus.ACCEPTED))
    rows = {row.actuator_id: row for row in latest.rows(1.0, TEST_NS + 10**9, alive)}
    assert rows["elbow"].level_text == "○ STALE"


def test_line_of_a_learning_joint_has_only_its_progress(capsys):
    learning = health_of("elbow", STALE, None)
    learning.cause, learning.reason = "", "learning: 4 records on 1 day"
    latest = received(learning)
    latest.add_baseline("/ema", baseline_of("elbow"))
    refused = FaultEstimate(actuator_id="elbow", reason_codes=["learning"], reason="learning: 4")
    latest.add_estimate("/ema", refused, 1.0)
    HealthTable("here").show(latest.rows(1.0, TEST_NS + 10**9, alive), "")
    line = capsys.readouterr().out.partition("UTC  ")[2]
    assert line == "◌ LEARNING 4 of 12  /ema/elbow  learning: 4 records on 1 day\n"
    # A defect of the record is shown as well as the progress.
    refused.reason_codes, refused.reason = ["learning", "wrong_scale"], "learning: 4; wrong scale"
    refused.header.stamp.sec = 1
    latest.add_estimate("/ema", refused, 1.0)
    [row] = latest.rows(1.0, TEST_NS + 10**9, alive)
    assert row.why.endswith("last test refused: learning: 4; wrong scale")
