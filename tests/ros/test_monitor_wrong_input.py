# SPDX-License-Identifier: Apache-2.0
"""Defects of the telemetry are named, and invalidate only the window that contains them."""

import array
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from ema_core.telemetry import Telemetry
from ema_interfaces.msg import TelemetryBlock
from ema_ros import topics
from ema_ros.messages import description_to_message, telemetry_to_message

from ..waiting import wait_for
from .monitor_session import FLAP, MonitorSession, Source, corrupted, in_window, monitor

Messages = list[TelemetryBlock]
OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"


@pytest.fixture(scope="module")
def session() -> Iterator[MonitorSession]:
    with monitor() as running:
        running.describe()
        yield running


@pytest.fixture(scope="module")
def source() -> Source:
    """Source of one actuator for all tests, whose telemetry continues from test to test."""
    return Source(friction=0.3)


def value(status: DiagnosticStatus, key: str) -> str:
    return next(item.value for item in status.values if item.key == key)


def message(block: Telemetry) -> TelemetryBlock:
    return telemetry_to_message(block, FLAP.actuator_id)


def with_column(block: Telemetry, column: str, length: int) -> Messages:
    spoilt = message(block)
    setattr(spoilt, column, array.array("d", np.zeros(length).tobytes()))
    return [spoilt]


WRONG: dict[str, tuple[Callable[[Telemetry], Messages], list[str]]] = {
    "NaN current": (
        lambda b: [message(corrupted(b, "current", 3, np.nan))],
        ["current is nan at index", "finite"],
    ),
    "short column": (lambda b: with_column(b, "current", 499), ["current 499", "command 500"]),
}
"""Defects of a block and of a message by name: function that makes them, and reported texts."""


@pytest.mark.parametrize("name", WRONG)
def test_wrong_telemetry_is_named_and_invalidates_its_window(
    session: MonitorSession, source: Source, name: str
):
    spoil, texts = WRONG[name]
    blocks = source.cycle()
    number = in_window(blocks)
    before, estimates = len(session.statuses("flap telemetry")), len(session.estimates())
    for block in blocks[:number]:
        session.send(topics.TELEMETRY, message(block))
    for spoilt in spoil(blocks[number]):
        session.send(topics.TELEMETRY, spoilt)
    session.feed(blocks[number + 1 :])

    refused = session.until(lambda: session.estimates()[estimates:])[0]
    assert not refused.valid
    assert refused.evaluations == 0
    assert all(np.isnan(getattr(refused.faults, k)) for k in ("friction", "gain"))
    for text in texts:
        assert text in refused.reason
        status = session.until_status("flap telemetry", text, WARN, since=before)
        assert status.hardware_id == f"/ema/flap/{FLAP.serial_number}"

    session.feed(source.cycle())
    session.until(lambda: [e for e in session.estimates()[estimates:] if e.valid])
    session.until_status("flap telemetry", "valid estimates", b"\x00", since=before)
    after = session.estimates()[estimates:]
    assert [e.valid for e in after] == [False, True]
    assert after[1].window == refused.window + 1
    assert after[1].faults.friction == pytest.approx(0.3, abs=0.02)


def test_defect_outside_of_a_window_is_named_and_invalidates_none(
    session: MonitorSession, source: Source
):
    before, estimates = len(session.statuses("flap telemetry")), len(session.estimates())
    blocks = source.cycle()
    blocks[2] = corrupted(blocks[2], "speed", 0, np.nan)
    session.feed(blocks[:3])
    session.until_status("flap telemetry", "speed is nan at index", WARN, since=before)
    session.feed(blocks[3:])
    session.until(lambda: session.estimates()[estimates:])
    assert [e.valid for e in session.estimates()[estimates:]] == [True]


def test_defect_is_reported_although_an_older_window_is_being_identified():
    source = Source()
    with monitor() as session:
        session.describe()
        blocks = source.cycle()
        blocks[-1] = corrupted(blocks[-1], "speed", 0, np.nan)
        session.feed(blocks)
        assert session.next_estimate().valid
        # The window is valid, but the defect after it must still be reported.
        reports = len(session.statuses("flap telemetry"))
        session.until(lambda: len(session.statuses("flap telemetry")) > reports)
        status = session.statuses("flap telemetry")[-1]
        assert "speed is nan" in status.message


def test_window_that_ends_after_the_largest_stamp_does_not_stop_the_monitor(source: Source):
    beyond_ns = 2**31 * 10**9
    with monitor() as session:
        session.describe()
        blocks = Source(stamp_ns=beyond_ns - 10**9).cycle(size=7000)
        # The window begins 0.2 s before and ends 0.3 s after the largest stamp.
        session.feed(b for b in blocks if b.stamp_ns < beyond_ns)
        session.feed(source.cycle())
        session.until(lambda: [e for e in session.estimates() if e.valid])


def test_telemetry_waits_for_a_description_and_defects_of_it_are_named(source: Source):
    nameless, wrong = description_to_message(FLAP), description_to_message(FLAP)
    nameless.actuator_id, wrong.resistance = "", -1.0
    with monitor() as session:
        session.until_status("input", "no message from an actuator so far", WARN)
        session.feed(source.cycle()[:2], actuator_id="")
        session.until_status("input", "2 messages without actuator_id", WARN)
        session.send(topics.DESCRIPTION, nameless)
        session.until_status("input", "3 messages without actuator_id", WARN)
        session.feed(source.cycle())
        status = session.until_status("flap telemetry", "no description", ERROR)
        assert status.hardware_id == f"/ema/{FLAP.actuator_id}"
        session.send(topics.DESCRIPTION, wrong)
        session.until_status("flap telemetry", "invalid description")
        session.until_status("flap telemetry", "-1")
        assert session.estimates() == []
        session.describe()
        assert session.next_estimate().valid
        before = len(session.statuses("flap telemetry"))
        session.send(topics.DESCRIPTION, wrong)
        session.until_status("flap telemetry", "invalid description", WARN, since=before)
        session.feed(source.cycle())
        assert session.next_estimate().valid


def test_two_publishers_of_one_actuator_are_named_and_lose_nothing():
    source = Source()
    with monitor() as session:
        session.describe()
        for block in source.cycle():
            session.feed([block, replace(block, first_index=block.first_index + 2_562_100)])
        expected = "several publishers send actuator_id flap (/ema/probe): stop all but one"
        status = session.until_status("flap telemetry", expected, WARN)
        assert (status.message, value(status, "samples lost")) == (expected, "0")
        # One publisher continues alone, and its next window is used.
        since = len(session.statuses("flap telemetry"))
        wait_for(lambda: not session.node.actuators["flap"].runs.are_several, "the end of it")
        session.feed(source.cycle())
        status = session.until_status("flap telemetry", "1 valid estimates", OK, since=since)
        assert value(status, "samples lost") == "0"


def test_lost_samples_are_counted_once_the_gap_is_certain(source: Source):
    with monitor() as session:
        session.describe()
        blocks = source.cycle()
        del blocks[in_window(blocks)]
        session.feed(blocks)

        def are_counted() -> bool:
            return value(session.statuses("flap telemetry")[-1], "samples lost") == "500"

        session.until(lambda: session.statuses("flap telemetry"))
        wait_for(are_counted, "the lost samples")
