"""What is wrong with the telemetry is named, costs the window that it falls in, and no more."""

import array
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from ema_core.telemetry import COLUMNS, Telemetry
from ema_interfaces.msg import TelemetryBlock
from ema_ros import topics
from ema_ros.messages import description_to_message, telemetry_to_message

from ..waiting import DEADLINE_S
from .monitor_session import FLAP, MonitorSession, Source, corrupted, in_window, monitor

Messages = list[TelemetryBlock]
WARN, ERROR = b"\x01", b"\x02"


@pytest.fixture(scope="module")
def session() -> Iterator[MonitorSession]:
    with monitor() as running:
        running.describe()
        yield running


@pytest.fixture(scope="module")
def source() -> Source:
    """One actuator for all tests, whose telemetry goes on from one to the next."""
    return Source(friction=0.3)


def message(block: Telemetry) -> TelemetryBlock:
    return telemetry_to_message(block, FLAP.actuator_id)


def not_finite(column: str, value: float) -> Callable[[Telemetry], Messages]:
    return lambda block: [message(corrupted(block, column, 3, value))]


def stamped_s_later(block: Telemetry, s: float) -> Messages:
    return [message(replace(block, stamp_ns=block.stamp_ns + round(s * 1e9)))]


def with_period(block: Telemetry, sample_period: float) -> Messages:
    spoilt = message(block)
    spoilt.sample_period = sample_period
    return [spoilt]


def with_column(block: Telemetry, column: str, length: int) -> Messages:
    spoilt = message(block)
    setattr(spoilt, column, array.array("d", np.zeros(length).tobytes()))
    return [spoilt]


def empty(block: Telemetry) -> Messages:
    spoilt = message(block)
    for column in COLUMNS:
        setattr(spoilt, column, array.array("d"))
    return [spoilt]


WRONG: dict[str, tuple[Callable[[Telemetry], Messages], list[str]]] = {
    "NaN command": (not_finite("command", np.nan), ["command is nan at index", "finite"]),
    "NaN current": (not_finite("current", np.nan), ["current is nan at index", "finite"]),
    "infinite position": (not_finite("position", np.inf), ["position is inf at index", "finite"]),
    "gap": (lambda _: [], ["gap of 500 samples"]),
    "block twice": (lambda b: [message(b), message(b)], ["the sample index went back from"]),
    "period": (lambda b: with_period(b, 2e-4), ["period changed from 0.0001 s to 0.0002 s"]),
    "period of 0": (lambda b: with_period(b, 0.0), ["sample_period = 0.0 s", "outside"]),
    "NaN period": (lambda b: with_period(b, np.nan), ["sample_period = nan s", "outside"]),
    "short column": (lambda b: with_column(b, "current", 499), ["current 499", "command 500"]),
    "no column": (
        lambda b: with_column(b, "speed", 0),
        ["no speed measured from index", "all columns before"],
    ),
    "no samples": (empty, ["command 0", "one length of at least 1"]),
    "time": (lambda b: stamped_s_later(b, -10.0), ["time ran backwards by"]),
    # Mean of the stamps in the window over that of the blocks: 0.5 s + 0.4 s over 0.5 s.
    "time leaps": (lambda b: stamped_s_later(b, 0.4), ["the stamps give one sample every"]),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_telemetry_costs_its_window_and_is_named(
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
    if name == "time leaps":
        blocks = [replace(b, stamp_ns=b.stamp_ns + 400_000_000) for b in blocks]
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


def test_defect_outside_of_a_window_is_named_and_costs_none(
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


def test_every_wrong_input_of_a_row_is_named(session: MonitorSession, source: Source):
    before = len(session.statuses("flap telemetry"))
    blocks = source.cycle()[:8]
    blocks[2] = corrupted(blocks[2], "speed", 0, np.nan)
    blocks[4] = corrupted(blocks[4], "current", 0, np.inf)
    blocks[6] = corrupted(blocks[6], "position", 0, np.nan)
    session.feed(blocks)
    for text in ("speed is nan", "current is inf", "position is nan"):
        session.until_status("flap telemetry", text, WARN, since=before)


def test_defect_is_told_although_an_older_window_is_being_identified():
    source = Source()
    with monitor() as session:
        session.describe()
        blocks = source.cycle()
        blocks[-1] = corrupted(blocks[-1], "speed", 0, np.nan)
        session.feed(blocks)
        assert session.next_estimate().valid
        # The window is sound, but what came after it is not: that must not be forgotten.
        reports = len(session.statuses("flap telemetry"))
        session.until(lambda: len(session.statuses("flap telemetry")) > reports)
        status = session.statuses("flap telemetry")[-1]
        assert "speed is nan" in status.message


def test_defect_is_told_while_the_status_is_being_published(monkeypatch: pytest.MonkeyPatch):
    with monitor() as session:
        session.describe()
        session.until_status("flap telemetry", "no telemetry so far")
        asked, fed = threading.Event(), threading.Event()
        tasks = session.node.tasks

        def slow_tasks():
            asked.set()
            assert fed.wait(DEADLINE_S)
            return tasks()

        monkeypatch.setattr(session.node, "tasks", slow_tasks)
        assert asked.wait(DEADLINE_S)
        block = Source().cycle()[0]
        session.feed([corrupted(block, "speed", 0, np.nan)])
        fed.set()
        session.until_status("flap telemetry", "speed is nan")


@pytest.mark.parametrize(
    "sample_period",
    [
        # What a whole number in a float64 field is sent as where fields are not checked.
        5e-324,
        1e300,
    ],
)
def test_absurd_sample_period_is_named(source: Source, sample_period: float):
    with monitor() as session:
        session.describe()
        blocks = source.cycle()
        number = in_window(blocks)
        session.feed(blocks[:number])
        session.send(topics.TELEMETRY, with_period(blocks[number], sample_period)[0])
        session.feed(blocks[number + 1 :])
        assert "sample" in session.next_estimate().reason
        session.until_status("flap telemetry", f"{sample_period!r}", WARN)
        session.feed(source.cycle())
        assert session.next_estimate().valid


def test_window_that_ends_beyond_what_stamps_hold_does_not_end_the_work(source: Source):
    beyond_ns = 2**31 * 10**9
    with monitor() as session:
        session.describe()
        blocks = Source(stamp_ns=beyond_ns - 10**9).cycle(size=7000)
        # The window begins 0.2 s before and ends 0.3 s behind.
        session.feed(b for b in blocks if b.stamp_ns < beyond_ns)
        session.feed(source.cycle())
        session.until(lambda: [e for e in session.estimates() if e.valid])


def test_telemetry_waits_for_the_description(source: Source):
    with monitor() as session:
        session.feed(source.cycle())
        status = session.until_status("flap telemetry", "no description", ERROR)
        assert status.hardware_id == f"/ema/{FLAP.actuator_id}"
        assert session.estimates() == []
        session.describe()
        assert session.next_estimate().valid


def test_wrong_description_is_named(source: Source):
    wrong = description_to_message(FLAP)
    wrong.resistance = -1.0
    with monitor() as session:
        session.send(topics.DESCRIPTION, wrong)
        session.until_status("flap telemetry", "the description is impossible", None)
        session.until_status("flap telemetry", "-1")
        session.feed(source.cycle())
        session.describe()
        assert session.next_estimate().valid
        before = len(session.statuses("flap telemetry"))
        session.send(topics.DESCRIPTION, wrong)
        session.until_status("flap telemetry", "the description is impossible", WARN, since=before)
        session.feed(source.cycle())
        assert session.next_estimate().valid


def test_description_with_another_sample_period_is_named(source: Source):
    with monitor() as session:
        session.describe(replace(FLAP, sample_period=2e-4))
        session.feed(source.cycle())
        session.until_status(
            "flap telemetry", "the description gives one sample every 0.0002 s", WARN
        )


def test_messages_without_actuator_are_counted_and_named(source: Source):
    nameless = description_to_message(FLAP)
    nameless.actuator_id = ""
    with monitor() as session:
        session.until_status("input", "no message of an actuator so far", WARN)
        session.feed(source.cycle()[:2], actuator_id="")
        session.until_status("input", "2 messages without actuator_id", WARN)
        session.send(topics.DESCRIPTION, nameless)
        session.until_status("input", "3 messages without actuator_id", WARN)
        session.describe()
        session.feed(source.cycle())
        assert session.next_estimate().valid
