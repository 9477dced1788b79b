# SPDX-License-Identifier: Apache-2.0
"""Interface of the monitor to other nodes: estimates, health, settings and lifecycle."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lifecycle_msgs.msg import Transition

from ema_interfaces.msg import FaultEstimate, Health
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.diagnosis import identify
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.node.publish.messages import estimate_to_message
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_ros.topics import LATCHED_BY_MANY

from .monitor_session import CYCLE, FLAP, MonitorSession, Source, monitor
from .spinning import figures

OK, WARN, STALE = 0, 1, 3


@pytest.fixture(scope="module")
def session() -> Iterator[MonitorSession]:
    """A monitor that has identified one window of an actuator with friction."""
    with monitor() as running:
        running.describe()
        running.feed(Source(friction=0.3).cycle())
        running.next_estimate()
        running.until(running.healths)
        yield running


@pytest.fixture(scope="module")
def estimate(session: MonitorSession) -> FaultEstimate:
    return session.estimates()[0]


@pytest.fixture(scope="module")
def health(session: MonitorSession) -> Health:
    return session.healths()[0]


def test_estimate_equals_the_estimate_of_the_library(estimate: FaultEstimate):
    watch = WindowFinder(TriggerSettings(), FLAP)
    [segment] = [e for block in Source(friction=0.3).cycle() for e in watch.feed(block)]
    assert isinstance(segment, Segment)
    expected = estimate_to_message(identify(segment.window, FLAP, Calibration.builtin()), 0, FLAP)
    assert expected.valid
    assert 0.0 < estimate.computing_time < 8.0
    expected.computing_time = estimate.computing_time
    assert str(estimate) == str(expected)
    assert estimate.excitation == pytest.approx(np.ptp(CYCLE.samples[CYCLE.start : CYCLE.stop]))
    assert 0.0 < estimate.excitation_limit < estimate.excitation
    assert (estimate.algorithm, estimate.seed) == (SearchSettings().algorithm, 0)
    assert (estimate.actuator_id, estimate.serial_number) == (FLAP.actuator_id, FLAP.serial_number)


def test_health_reports_the_fault(estimate: FaultEstimate, health: Health):
    assert health.header.stamp == estimate.window_end
    assert (health.actuator_id, health.serial_number) == (FLAP.actuator_id, FLAP.serial_number)
    assert (health.level, health.dominant_fault) == (WARN, "friction")
    share = estimate.faults.friction / 0.5
    assert health.health_index == pytest.approx(1.0 - share)
    assert (health.severity, health.cycles) == (2, 1)
    assert 0.8 < health.confidence <= 1.0
    [friction] = [item for item in health.faults if item.name == "friction"]
    assert (friction.level, friction.limit, friction.limit_is_lower) == (WARN, 0.5, False)
    assert friction.value == estimate.faults.friction
    assert friction.sigma == pytest.approx(np.sqrt(estimate.covariance[0]))


def test_status_contains_counts_and_health_index(session: MonitorSession):
    telemetry = session.until_status("flap telemetry", "1 valid estimates", b"\x00")
    assert telemetry.hardware_id == f"/ema/flap/{FLAP.serial_number}"
    values = {item.key: item.value for item in telemetry.values}
    expected = {"blocks": "34", "samples lost": "0", "windows": "1", "estimates valid": "1"}
    assert expected.items() <= values.items()
    health = session.until_status("flap health", "WARN: friction", b"\x01")
    values = figures(health)
    assert values["health index"] == pytest.approx(session.healths()[0].health_index, rel=1e-6)


def test_latched_descriptions_of_all_actuators_are_received():
    tabs = [replace(FLAP, actuator_id=f"tab_{i}", serial_number=f"T{i}") for i in range(3)]
    with monitor(up=False) as session:
        for described in (FLAP, *tabs):
            session.describe_latched(described)
        session.bring_up()
        session.until_status("input", "4 actuators monitored")


def test_late_subscriber_receives_the_health_of_all_actuators(tmp_path: Path):
    names = ("flap", "rudder")
    shipped = Calibration.builtin()
    for name in names:
        replace(shipped, actuator_id=name).save(tmp_path / f"{name}.yaml")
    with monitor({"calibration_file": f"{tmp_path}/{{actuator_id}}.yaml"}) as session:
        blocks = Source().cycle()
        for name in names:
            session.describe(replace(FLAP, actuator_id=name))
            session.feed(blocks, name)
            session.until(lambda name=name: [e for e in session.estimates(name) if e.valid])
        session.subscribe(Health, "health", LATCHED_BY_MANY, key="late")
        session.until(lambda: {h.actuator_id for h in session.received("late")} == set(names))


def test_health_is_stale_while_the_monitor_is_not_active_and_after_three_expected_periods():
    with monitor() as session:
        session.describe()
        session.feed(Source().cycle())
        assert session.next_estimate().valid
        session.until(lambda: [h for h in session.healths() if h.level == OK])
        printed = len(session.statuses("flap health"))
        assert session.change_state(Transition.TRANSITION_DEACTIVATE)
        session.until(lambda: session.healths()[-1].level == STALE)
        assert session.healths()[-1].reason.startswith("the monitor is not active")
        for task in ("flap health", "flap telemetry", "flap friction"):
            session.until_status(task, "the monitor is not active", b"\x03", since=printed)
        # After the next test the level is known again.
        assert session.change_state(Transition.TRANSITION_ACTIVATE)
        session.until_subscribed()
        session.feed(Source().cycle())
        latest = session.next_estimate()
        session.until(lambda: session.healths()[-1].level == OK)
        healths = len(session.healths())
        assert session.set_parameters(expected_period_s=0.1)[0].successful
        later = lambda: [h for h in session.healths()[healths:] if h.level == STALE]  # noqa: E731
        stale = session.until(later)[0]
        assert stale.confidence == 0.0
        assert "no valid estimate for more than 0.3 s" in stale.reason
        assert stale.header.stamp == latest.window_end
        session.until_status("flap health", "unknown, last OK (no valid estimate for", b"\x03")
        session.until_status("flap telemetry", "telemetry has stopped", b"\x03")


def test_parameter_that_does_not_exist_is_answered_once(session: MonitorSession):
    [answer] = session.set_parameters(no_such_parameter=1)
    assert not answer.successful
    assert answer.reason.count("no_such_parameter") == 1
