# SPDX-License-Identifier: Apache-2.0
"""A monitor among unknown nodes: other publishers, wrong names and changing settings."""

import math
from collections.abc import Iterator
from dataclasses import replace

import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rosgraph_msgs.msg import Clock

from ema_core.levels import ERROR, OK, STALE, WARN
from ema_interfaces.msg import Health, HealthSummary, Usage
from ema_interfaces.srv import Calibrate, ForgetActuator, PredictRemainingLife
from ema_monitor.node.publish.messages import summary_of, unknown_estimate
from ema_ros import topics
from ema_ros.messages import description_to_message
from ema_ros.stamps import stamp_to_message

from ..waiting import wait_for
from .monitor_session import FLAP, START_NS, MonitorSession, Source, in_window, monitor

DEFAULT_QOS = QoSProfile(depth=10)


@pytest.fixture
def session() -> Iterator[MonitorSession]:
    with monitor() as running:
        yield running


def test_default_and_latched_publishers_are_received_once(session):
    latched = session.probe.create_publisher(Usage, topics.USAGE, topics.LATCHED)
    latched.publish(Usage(actuator_id="rudder", flight_hours=-1.0))
    plain = session.probe.create_publisher(Usage, topics.USAGE, DEFAULT_QOS)
    message = description_to_message(FLAP)
    described = session.probe.create_publisher(type(message), topics.DESCRIPTION, DEFAULT_QOS)
    wait_for(
        lambda: all(item.get_subscription_count() for item in (plain, described)), "the monitor"
    )
    described.publish(message)
    session.until_status("flap telemetry", "no telemetry so far")
    for hours in (-3.0, -2.0):
        plain.publish(Usage(actuator_id="rudder", flight_hours=hours))
    # Both subscriptions match the latched publisher, but its message counts once.
    session.until_status("input", "ignored: 3 malformed messages")
    latched.publish(Usage(actuator_id="rudder", flight_hours=-4.0))
    session.until_status("input", "ignored: 4 malformed messages")
    sensor = session.probe.create_publisher(Usage, topics.USAGE, qos_profile_sensor_data)
    wait_for(sensor.get_subscription_count, "the monitor")
    # The subscription may be matched after the publisher, and messages are not repeated.
    wait_for(
        lambda: (
            sensor.publish(Usage(actuator_id="rudder", flight_hours=-5.0))
            or "-5" in session.statuses("input")[-1].message
        ),
        "what is sent by best effort",
    )


def test_monitor_survives_jumps_of_the_clock():
    with monitor({"use_sim_time": True, "expected_period_s": 10.0}) as session:
        best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        clock = session.probe.create_publisher(Clock, "/clock", best_effort)
        now = [START_NS]

        def until_it_is(moment_ns: int) -> None:
            now[0] = moment_ns

            def reported() -> bool:
                clock.publish(Clock(clock=stamp_to_message(now[0])))
                return session.node.get_clock().now().nanoseconds == now[0]

            wait_for(reported, "the clock")

        session.describe()
        # A replay starts, goes back by an hour, and jumps ahead by a day, when all is old.
        for number, jump_s in enumerate((0, -3600, 86_400)):
            start_ns = START_NS + jump_s * 1_000_000_000
            until_it_is(start_ns)
            if jump_s > 0:
                session.until(lambda: session.healths()[-1].level == STALE)
            session.feed(Source(stamp_ns=start_ns).cycle())
            estimate = session.next_estimate()
            assert estimate.valid, (number, estimate.reason)
            session.until(lambda n=number: len(session.healths()) > n)
            session.until(lambda: session.healths()[-1].level == OK)
        assert session.node.state == "active"


def test_forgotten_actuator_loses_its_topics_and_may_return(session):
    session.describe()
    session.feed(Source().cycle())
    session.next_estimate()
    session.until(lambda: session.received(topics.HEALTH_SUMMARY))

    def forget(name: str) -> ForgetActuator.Response:
        request = ForgetActuator.Request(actuator_id=name)
        return session.call(ForgetActuator, "/ema/monitor/forget_actuator", request)

    refused = forget("rudder")
    assert not refused.success
    assert "'rudder' is not monitored; monitored: flap" in refused.message
    assert forget("flap").success
    session.until(lambda: "the actuator is forgotten" in session.healths()[-1].reason)
    assert session.healths()[-1].level == STALE
    session.until_status("input", "no message from an actuator so far")
    tasks = ("telemetry", "health", "history")
    counts = []
    for _ in range(2):  # a report begun before may be published after
        reports = len(session.statuses("input"))
        session.until(lambda before=reports: len(session.statuses("input")) > before + 1)
        counts.append([len(session.statuses(f"flap {task}")) for task in tasks])
    assert counts[0] == counts[1]
    wait_for(lambda: not session.probe.count_publishers("/ema/health"), "no publisher of health")
    # Each description was received once.
    session.feed(Source().cycle())
    assert session.next_estimate().window == 0
    session.describe_latched(replace(FLAP, serial_number="SIM-0002"))
    session.until(lambda: session.node.actuators["flap"].description != FLAP)
    assert forget("flap").success
    session.feed(Source().cycle())
    assert session.next_estimate().serial_number == "SIM-0002"
    # A restarted bridge sends the description once, and counts samples from 1.
    session.describe_latched(FLAP)
    session.until(lambda: session.node.actuators["flap"].description == FLAP)
    session.feed(Source().cycle())
    assert session.next_estimate().valid


def test_settings_changed_in_a_window_apply_from_the_next_window_on(session):
    session.describe()
    source = Source(friction=0.2)
    blocks = source.cycle()
    middle = in_window(blocks)
    session.feed(blocks[:middle])
    session.until(lambda: session.node.actuators["flap"].finder.blocks == middle)
    changes = {"window_s": 0.4, "algorithm": "pso", "budget": 700}
    changes |= {"limits.friction": 0.1, "costs.unit": "guineas"}
    assert all(r.successful for r in session.set_parameters(**changes))
    session.feed([*blocks[middle:], *source.cycle()])
    first, second = session.next_estimate(), session.next_estimate()
    assert (first.valid, first.reason) == (False, "the settings of the window changed")
    length_s = (second.window_end.sec - second.window_start.sec) + 1e-9 * (
        second.window_end.nanosec - second.window_start.nanosec
    )
    assert length_s == pytest.approx(0.4, abs=1e-6)
    assert second.algorithm == "pso"
    session.until(lambda: session.healths() and session.received(topics.ADVICE))
    # Friction of 0.2 is far from the default limit and above the new one.
    assert [health.level for health in session.healths()] == [STALE, ERROR]
    assert session.healths()[-1].health_index == 0.0
    assert session.received(topics.ADVICE)[0].cost_unit == "guineas"


def test_log_has_a_line_for_a_calibration_and_for_each_change_of_level(tmp_path, capfd):
    settings = {"calibration_file": str(tmp_path / "flap.yaml"), "level_confirmations": 2}
    printed = ""

    def lines(text: str) -> list[str]:
        nonlocal printed
        printed += capfd.readouterr().err
        return [line for line in printed.splitlines() if "[INFO]" in line and text in line]

    with monitor(settings) as session:
        session.describe()
        calibrate = Calibrate.Request(windows=1)
        answer = session.start(Calibrate, "/ema/monitor/calibrate", calibrate)
        wait_for(lambda: lines("flap: calibration is requested"), "the request")
        session.feed(Source().cycle())
        assert session.result(answer).success
        wait_for(lambda: lines("calibration: fitted to 1 window"), "the calibration")
        # With the calibration the level is unknown, OK, and ERROR as soon as confirmed.
        source = Source(stamp_ns=START_NS + 10_000_000_000)
        session.next_estimate()
        for friction in (0.0, 0.9, 0.9):
            source.set(friction=friction)
            session.feed(source.cycle())
            session.next_estimate()
        changes = ("flap: health STALE -> OK", "flap: health OK -> ERROR: friction")
        wait_for(lambda: all(map(lines, changes)), "the changes of level")
    assert [len(lines(text)) for text in ("calibration: fitted to", *changes)] == [1, 1, 1], printed
    assert "after a restart" not in printed


def test_impossible_name_creates_no_actuator_and_answers_have_nan(session):
    for name in (" flap", "flap\n", "f" * 101):
        printed = len(session.statuses("input"))
        session.feed(Source().cycle()[:1], name)
        session.until_status("input", "impossible actuator_id", since=printed)
        assert not session.statuses(f"{name} telemetry")
    request = PredictRemainingLife.Request(duty=2.0)
    answer = session.call(PredictRemainingLife, "/ema/monitor/predict_remaining_life", request)
    assert not answer.success
    health = answer.health
    assert (health.level, health.reason) == (STALE, answer.message)
    figures = (health.health_index, health.flight_hours, health.growth_factor, health.rul.hours_50)
    assert all(map(math.isnan, figures))
    assert math.isnan(unknown_estimate("flap", "").faults.gain)


def test_summary_is_a_line_of_the_health():
    health = Health(actuator_id="flap", serial_number="1", level=WARN, health_index=0.4)
    health.dominant_fault = "short_circuit_a"
    health.rul.known, health.rul.hours_50 = True, 120.0
    summary = summary_of(health)
    assert isinstance(summary, HealthSummary)
    assert (summary.level, summary.rul_50) == (WARN, 120.0)
    assert summary.text == "WARN: short circuit A; remaining life 120 service hours"
    health.rul.known, health.level, health.dominant_fault = False, OK, ""
    assert math.isnan(summary_of(health).rul_50)
    assert summary_of(health).text == "OK"
