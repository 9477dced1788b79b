"""Service life reaches the unit that it is of, and is known again after a restart."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ema_core.telemetry import Telemetry
from ema_monitor.node.actuator import Actuator
from ema_monitor.unit import Unit

from .monitor_session import FLAP, monitor
from .mounted_units import mount
from .worn_actuator import HOURS, live, predict, use, worn_cycles

OK, STALE = 0, 3
OTHER = replace(FLAP, serial_number="SIM-0002")


@pytest.fixture(scope="module")
def cycles() -> list[Telemetry]:
    return worn_cycles(6)


def test_hours_are_those_of_the_usage_topic(cycles: list[Telemetry]):
    ends = [int(block.stamps_ns[-1]) for block in cycles]
    with monitor() as session:
        session.describe()
        [first] = live(session, cycles[:1])
        assert math.isnan(first.flight_hours)
        assert "usage" in first.reason
        assert "hours_per_cycle" in first.rul.reason
        # One that is read only later does not count for this test; nor what is impossible.
        for hours, stamp_ns in ((123.0, ends[0]), (-5.0, ends[0] + 1), (999.0, ends[1])):
            use(session, hours, stamp_ns, cycles=40)
        session.until_status("flap telemetry", "flight_hours = -5 h")
        [second] = live(session, cycles[1:2])
        assert (second.flight_hours, second.cycles) == (123.0, 40)


def test_latched_usage_reaches_a_monitor_that_comes_later(cycles: list[Telemetry]):
    with monitor(up=False) as session:
        use(session, 50.0, 1)
        session.bring_up()
        session.describe()
        # The count may come after the first test.
        healths = live(session, cycles[:3])
        assert healths[-1].flight_hours == 50.0


def test_unit_that_is_exchanged_begins_a_history_of_its_own(
    cycles: list[Telemetry], tmp_path: Path
):
    other = replace(FLAP, serial_number="SIM-0002")
    given = {"hours_per_cycle": HOURS, "history_folder": str(tmp_path)}
    with monitor(given) as session:
        session.describe()
        live(session, cycles[:2])
        mount(session, other)
        session.feed(cycles[2:3])
        # The shipped calibration belongs to the first one.
        session.until_status("flap telemetry", "SIM-0002")
        answer = predict(session, 1.0)
        assert "no history yet" in answer.message
        before = len(session.healths())
        session.describe()
        # The history of the first one goes on.
        session.until(lambda: len(session.healths()) > before)
        [back] = live(session, cycles[3:4])
        assert (back.serial_number, back.cycles) == ("SIM-0001", 3)


def test_unit_that_is_fitted_has_no_health_of_the_one_before(cycles: list[Telemetry]):
    with monitor({"hours_per_cycle": HOURS}) as session:
        mount(session, FLAP)
        live(session, cycles[:1])
        session.until_status("flap health", "", bytes([OK]))
        said = len(session.statuses("flap health"))
        mount(session, OTHER)
        status = session.until_status("flap health", "no valid estimate so far", since=said)
        assert (status.hardware_id, status.level) == ("/ema/flap/SIM-0002", bytes([STALE]))


def test_service_that_fails_says_so_and_goes_on(
    cycles: list[Telemetry], monkeypatch: pytest.MonkeyPatch
):
    def fail(*_: Any) -> Any:
        raise FloatingPointError("made up")

    with monitor({"hours_per_cycle": HOURS}) as session:
        mount(session, FLAP)
        live(session, cycles[:1])
        with monkeypatch.context() as patched:
            patched.setattr(Unit, "outlook", fail)
            answer = predict(session, 1.0)
        assert not answer.success
        assert "the prognosis failed: FloatingPointError('made up')" in answer.message
        assert predict(session, 1.0).success


def test_health_that_cannot_be_published_costs_no_second_estimate(
    cycles: list[Telemetry], monkeypatch: pytest.MonkeyPatch
):
    def fail(*_: Any) -> Any:
        raise OverflowError("made up")

    with monitor({"hours_per_cycle": HOURS}) as session:
        mount(session, FLAP)
        with monkeypatch.context() as patched:
            patched.setattr(Actuator, "record", fail)
            session.feed(cycles[:1])
            session.until_status("flap telemetry", "publishing health failed: OverflowError")
        live(session, cycles[1:2])
        assert [(item.window, item.valid) for item in session.estimates()] == [(0, True), (1, True)]
