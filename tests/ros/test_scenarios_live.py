"""Lives under scenarios of future duty: of a live monitor, and of the same tests from a bag."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from ema_cli.bags.predicting import Predicting
from ema_cli.bags.unit_course import follow
from ema_cli.bags.unit_record import UnitRecord
from ema_interfaces.msg import DutyScenario, ScenarioLife
from ema_interfaces.srv import PredictRemainingLife
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.node.messages import message_of, scenarios_from_messages
from ema_monitor.prognosis.duty.course import REFERENCE_TESTS
from ema_monitor.prognosis.duty.damage import DamageSettings
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.reports import scenario_report

from ..commands import ema
from .counted_tests import CountedTest, counted_tests, let_hear, recorded
from .monitor_session import MonitorSession, monitor
from .worn_actuator import SERVICE

TESTS = REFERENCE_TESTS + 4
COVERAGE = 1e-5
"""Telemetry of a test of some seconds stands for the hours between tests."""
SCENARIOS = [
    DutyScenario(name="as flown"),
    DutyScenario(name="idle", travel_per_hour=1.0, hours_per_cycle=2.0, hours_per_day=4.0),
    DutyScenario(name="loads", loads=[0.1, 0.8], load_shares=[0.5, 0.5], duty=1.5),
    DutyScenario(name="hot", winding_temperatures=[120.0], winding_shares=[1.0]),
]


@pytest.fixture(scope="module")
def tests() -> list[CountedTest]:
    """Tests of an actuator whose friction grows."""
    return counted_tests(TESTS, 0.02)


@pytest.fixture(scope="module")
def record(tests: list[CountedTest], tmp_path_factory: pytest.TempPathFactory) -> UnitRecord:
    return recorded(tmp_path_factory.mktemp("flown") / "life.mcap", tests)


@pytest.fixture(scope="module")
def session(tests: list[CountedTest]) -> Iterator[MonitorSession]:
    """A monitor that has heard all of the tests."""
    with monitor({"damage.least_coverage": COVERAGE}) as running:
        let_hear(running, tests)
        yield running


def asked(session: MonitorSession, *scenarios: DutyScenario):
    request = PredictRemainingLife.Request(duty=1.0, scenarios=list(scenarios))
    return session.call(PredictRemainingLife, SERVICE, request)


def test_live_and_offline_answers_are_equal_to_the_last_digit(session, record):
    live = asked(session, *SCENARIOS)
    assert live.success, live.message
    calibration = Calibration.builtin()
    given = Predicting(
        prognosis=PrognosisSettings(damage=DamageSettings(least_coverage=COVERAGE)),
        scenarios=scenarios_from_messages(SCENARIOS),
    )
    estimates = given.estimate(record.windows, calibration)
    course = follow(record, estimates, calibration, given)
    told = [message_of(ScenarioLife, scenario_report(*one)) for one in course.scenarios]
    assert [str(one) for one in told] == [str(one) for one in live.scenarios]
    assert course.growth.duty is not None
    assert "as flown since" in live.health.assumption
    lives = {one.name: one for one in told}
    assert str(lives["as flown"].rul) == str(live.health.rul)
    assert live.health.rul.known
    assert lives["idle"].rul.known
    assert lives["idle"].rul.hours_50 > lives["as flown"].rul.hours_50
    assert lives["idle"].days_50 == pytest.approx(lives["idle"].rul.hours_50 / 4.0)
    assert lives["idle"].rul.cycles_50 == pytest.approx(lives["idle"].rul.hours_50 / 2.0)
    assert lives["loads"].rul.known
    assert not lives["hot"].rul.known
    assert "the temperature of its winding so far is not known" in lives["hot"].rul.reason


@pytest.mark.parametrize(
    ("scenarios", "texts"),
    [
        ([DutyScenario(name="a", duty=0.0)], ["scenario 1", "duty = 0", "[0.001, 1000]"]),
        ([DutyScenario(name="a", loads=[0.1])], ["loads", "0 shares of 1 values"]),
        (
            [DutyScenario(name="a", loads=[0.1, 0.1], load_shares=[0.5, 0.5])],
            ["loads = [0.1, 0.1]", "each value once"],
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


def test_command_prints_lives_under_scenarios(record: UnitRecord, tmp_path: Path):
    [bag] = set(record.bags.values())
    file = tmp_path / "scenarios.yaml"
    file.write_text("scenarios: [{name: as flown}, {name: idle, travel_per_hour: 1}]")
    result = ema("prognose", bag, "--scenarios", file, "-p", f"damage.least_coverage={COVERAGE}")
    assert result.exit_code == 0, result.stderr
    assert all(text in result.stdout for text in ("idle", "as flown", "RUL [days]"))
    file.write_text("scenarios: [{name: idle, travel_per_hour: far}]")
    refused = ema("prognose", bag, "--scenarios", file)
    assert refused.exit_code == 1
    assert "travel_per_hour = 'far'" in refused.stderr
