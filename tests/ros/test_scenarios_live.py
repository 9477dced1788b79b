# SPDX-License-Identifier: Apache-2.0
"""Health, life and lives under scenarios are equal for a live monitor and for a bag."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_bags.writer import BagWriter
from ema_cli.bags.predicting import Predicting
from ema_cli.bags.reading import ReadingOptions
from ema_cli.bags.unit_course import Course, UnitRecord, follow, read_unit
from ema_cli.show.prognosis_table import table_of_scenarios
from ema_core.faults import fault_vector
from ema_core.telemetry import Telemetry
from ema_interfaces.msg import DutyScenario, ScenarioLife, Usage
from ema_interfaces.srv import PredictRemainingLife
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.node.publish.messages import health_to_message, message_of, scenarios_from_messages
from ema_monitor.prognosis.duty.course import REFERENCE_TESTS
from ema_monitor.prognosis.duty.damage import DamageSettings
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.reports import scenario_report
from ema_monitor.windows.trigger import TriggerSettings
from ema_ros import topics
from ema_ros.stamps import stamp_to_message
from ema_sim.actuator import SimulatedActuator

from ..commands import ema
from .monitor_session import CYCLE, FLAP, START_NS, MonitorSession, monitor
from .worn_actuator import SERVICE, live, plain

CountedTest = tuple[Telemetry, Usage]
SAMPLE = Path(__file__).parents[2] / "bags" / "faulty_flap.mcap"
TESTS = REFERENCE_TESTS + 4
COVERAGE = 1e-5
"""Least share of service hours covered by telemetry: tests of seconds stand for hours."""
SCENARIOS = [
    DutyScenario(name="as flown"),
    DutyScenario(name="idle", travel_per_hour=1.0, hours_per_cycle=2.0, hours_per_day=4.0),
    DutyScenario(name="loads", loads=[0.1, 0.8], load_shares=[0.5, 0.5], duty=1.5),
    DutyScenario(name="hot", winding_temperatures=[120.0], winding_shares=[1.0]),
]


@pytest.fixture(scope="module")
def tests() -> list[CountedTest]:
    """Tests of an actuator with growing friction at irregular intervals, with service counts."""
    actuator, flown = SimulatedActuator(stamp_ns=START_NS), list[CountedTest]()
    for number in range(TESTS):
        actuator.faults = fault_vector({"friction": 0.1 + 0.02 * number})
        block = actuator.advance(CYCLE.samples)
        hours = 12.0 * number + number % 3
        usage = Usage(actuator_id=FLAP.actuator_id, flight_hours=hours, cycles=100 + number)
        usage.header.stamp = stamp_to_message(block.stamp_ns)
        flown.append((block, usage))
    return flown


@pytest.fixture(scope="module")
def record(tests: list[CountedTest], tmp_path_factory: pytest.TempPathFactory) -> UnitRecord:
    """Unit record that the commands read from a bag of the tests."""
    path = tmp_path_factory.mktemp("flown") / "life.mcap"
    with BagWriter(path) as writer, SimulatedActuatorBag(writer, FLAP) as bag:
        for block, usage in tests:
            writer.write(f"{topics.NAMESPACE}/{topics.USAGE}", usage, block.stamp_ns)
            bag.write_block(block, 0.0)
    return read_unit([path], ReadingOptions(trigger=TriggerSettings()))


@pytest.fixture(scope="module")
def session(tests: list[CountedTest]) -> Iterator[MonitorSession]:
    """A monitor that has received all counts, and then the tests."""
    with monitor({"damage.least_coverage": COVERAGE}) as running:
        running.mount()
        for _, usage in tests:
            running.send(topics.USAGE, usage)
        # When the impossible last count is reported, all counts before it have been received.
        running.send(topics.USAGE, Usage(actuator_id=FLAP.actuator_id, flight_hours=-5.0))
        running.until_status("flap telemetry", "flight_hours = -5 h")
        live(running, [block for block, _ in tests])
        yield running


def asked(session: MonitorSession, *scenarios: DutyScenario):
    request = PredictRemainingLife.Request(duty=1.0, scenarios=list(scenarios))
    return session.call(PredictRemainingLife, SERVICE, request)


@pytest.fixture(scope="module")
def course(record: UnitRecord) -> Course:
    """Course of the unit that the command computes from the bag."""
    calibration = Calibration.builtin()
    options = Predicting(
        prognosis=PrognosisSettings(damage=DamageSettings(least_coverage=COVERAGE)),
        scenarios=scenarios_from_messages(SCENARIOS),
    )
    return follow(record, options.estimate(record.windows, calibration), calibration, options)


def test_health_messages_of_a_bag_equal_the_live_messages(session, course, tests):
    reported = [
        health_to_message(outlook, course.record.description) for outlook in course.outlooks
    ]
    assert [plain(message) for message in reported] == [
        plain(health) for health in session.healths()
    ]
    assert [message.flight_hours for message in reported] == [
        item.flight_hours for _, item in tests
    ]
    assert reported[-1].rul.known


def test_live_and_offline_answers_are_equal_to_the_last_digit(session, course):
    live = asked(session, *SCENARIOS)
    assert live.success, live.message
    reported = [message_of(ScenarioLife, scenario_report(*life)) for life in course.scenarios]
    assert [str(life) for life in reported] == [str(life) for life in live.scenarios]
    assert course.growth.duty is not None
    assert "as flown since" in live.health.assumption
    lives = {life.name: life for life in reported}
    assert str(lives["as flown"].rul) == str(live.health.rul)
    assert live.health.rul.known
    assert lives["idle"].rul.known
    assert lives["idle"].rul.hours_50 > lives["as flown"].rul.hours_50
    assert lives["idle"].days_50 == pytest.approx(lives["idle"].rul.hours_50 / 4.0)
    assert lives["idle"].rul.cycles_50 == pytest.approx(lives["idle"].rul.hours_50 / 2.0)
    assert lives["loads"].rul.known
    assert not lives["hot"].rul.known
    assert "the temperature of its winding so far is unknown" in lives["hot"].rul.reason


@pytest.mark.parametrize(
    ("scenarios", "texts"),
    [
        ([DutyScenario(name="a", duty=0.0)], ["scenario 1", "duty = 0", "[0.001, 1000]"]),
        ([DutyScenario(name="a", loads=[0.1])], ["loads", "0 shares for 1 values"]),
        (
            [DutyScenario(name="a", loads=[0.1, 0.1], load_shares=[0.5, 0.5])],
            ["loads = [0.1, 0.1]", "different values"],
        ),
        ([DutyScenario(name=str(n)) for n in range(21)], ["21 scenarios", "at most 20"]),
    ],
)
def test_wrong_scenarios_are_refused_by_name(
    session: MonitorSession, scenarios: list[DutyScenario], texts: list[str]
):
    answer = asked(session, *scenarios)
    assert not answer.success
    assert all(text in answer.message for text in texts), answer.message


def test_command_prints_lives_under_scenarios(course: Course, tmp_path: Path):
    table = table_of_scenarios([scenario_report(*life) for life in course.scenarios])
    names, *_, days, _ = (list(column.cells) for column in table.columns)
    shown = dict(zip(names, days, strict=True))
    assert (str(shown["idle"]).count(" / "), shown["hot"]) == (2, "")
    file = tmp_path / "scenarios.yaml"
    file.write_text("scenarios: [{name: as flown}, {name: idle, travel_per_hour: 1}]")
    result = ema("predict", SAMPLE, "--scenarios", file, "--hours-per-cycle", "10")
    assert result.exit_code == 0, result.stderr
    assert all(text in result.stdout for text in ("idle", "as flown", "RUL [days]"))
    file.write_text("scenarios: [{name: idle, travel_per_hour: far}]")
    refused = ema("predict", SAMPLE, "--scenarios", file)
    assert refused.exit_code == 1
    assert "travel_per_hour = 'far'" in refused.stderr
