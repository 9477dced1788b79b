# SPDX-License-Identifier: Apache-2.0
"""A claim expires by a steady clock, in the monitor and in the programs that show its health."""

import pytest

from ema_cli.show.health_table import LatestHealths
from ema_core.description import ActuatorDescription
from ema_core.levels import OK, STALE
from ema_interfaces.msg import Health
from ema_monitor.diagnosis import Diagnosed
from ema_monitor.node.moment import Moment
from ema_monitor.node.publish.actuator_status import ActuatorStatus
from ema_monitor.node.receive.arrivals import Arrivals
from ema_monitor.node.receive.receiver_clock import ReceiverClock
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit
from ema_monitor.windows.finder import WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_ros.claims import Claims, Received
from ema_ros.stamps import stamp_to_message

from ..prognosis.made_tests import FIRST_NS, UNIT, made_test

S = 10**9
LIVE = PrognosisSettings(good_for_s=30.0)
FLAP = ActuatorDescription(actuator_id=UNIT[0], serial_number=UNIT[1])


def judged() -> tuple[ActuatorStatus, list[Health]]:
    """Return an actuator whose healthy test just ended, at 1000 s of the steady clock."""
    published: list[Health] = []
    actuator = ActuatorStatus(
        "flap", WindowFinder(TriggerSettings()), published.append, 1000 * S, Arrivals()
    )
    actuator.finder.describe(FLAP)
    test = made_test(0, friction=0.02)
    outlook = Unit(History(*UNIT), LIVE).update(test, None, LIVE, received_ns=test.end_ns)
    actuator.record(Diagnosed(0, 0, FLAP, test), outlook, Moment(FIRST_NS, 1000 * S))
    assert published[-1].level == OK
    return actuator, published


def never_silent(_place: str, _author: str) -> bool:
    """Return False: the monitor is alive."""
    return False


@pytest.mark.parametrize("step_s", [0, -5, -3600])
def test_level_of_a_monitor_expires_regardless_of_steps_of_its_clock(step_s: int):
    actuator, published = judged()
    for passed_s in range(1, 40):
        now = Moment(FIRST_NS + (passed_s + step_s) * S, (1000 + passed_s) * S)
        actuator.expire(30.0, now)
        assert (published[-1].level == STALE) == (passed_s > 30)
    # The actuator also counts as silent.
    assert actuator.is_silent
    # The claim does not return when the clock goes back.
    assert (
        actuator.health.resume(FLAP, actuator.health.outlook, Moment(FIRST_NS + S, 1040 * S))
        is not None
    )
    assert published[-1].level == STALE


def test_step_of_the_clock_is_noticed_and_a_slow_adjustment_is_not():
    times = [(100.0, 50.0), (101.0, 51.0), (101.5, 52.0), (102.0, 53.0), (62.0, 54.0), (63.0, 55.0)]
    now = iter(times)
    clock_s, steady_s = 0.0, 0.0

    def tick() -> None:
        nonlocal clock_s, steady_s
        clock_s, steady_s = next(now)

    clock = ReceiverClock(lambda: round(clock_s * S), steady_ns=lambda: round(steady_s * S))
    steps = []
    for _ in times:
        tick()
        steps.append(clock.read()[1] / S)
    assert steps == [0.0, 0.0, 0.0, 0.0, 41.0, 0.0]


def test_time_of_claims_never_goes_back_with_simulated_time():
    times = iter([0, 0, 500, 510, 100, 140, 0])
    clock = ReceiverClock(lambda: next(times) * S, is_simulated=True)
    read = [clock.read() for _ in range(7)]
    assert [moment.steady_ns // S for moment, _ in read] == [0, 0, 500, 510, 510, 550, 550]
    assert [back_ns // S for _, back_ns in read] == [0, 0, 0, 0, 410, 0, 140]


def test_level_ends_when_the_clock_goes_back():
    actuator, published = judged()
    moment = Moment(FIRST_NS + S, 1001 * S)
    actuator.expire(30.0, moment)
    assert actuator.health.end_claim("the clock went back by 2 s") is not None
    assert (published[-1].level, published[-1].last_level) == (STALE, OK)
    assert published[-1].reason.startswith("the clock went back")


@pytest.mark.parametrize("behind_s", [0, 3600])
def test_shown_health_expires_regardless_of_steps_of_the_clock(behind_s: int):
    """The receiver's clock goes back after, or before, the health is received."""
    _, [health] = judged()
    healths, claims = LatestHealths(), Claims()
    received_ns = FIRST_NS - behind_s * S
    healths.add_health("/ema", health, 100.0, received_ns)
    claims.note(("/ema/health", "flap"), health, received_ns, 100.0)
    levels, shown = [], OK
    for passed_s in (0, 10, 29, 31):
        now_ns, now_s = FIRST_NS + (passed_s - 3600) * S, 100.0 + passed_s
        [row] = healths.rows(now_s, now_ns, never_silent)
        for _, held in claims.changes(now_ns, now_s, never_silent):
            shown = held.level
        levels.append((row.level, shown))
    assert levels == [(OK, OK)] * 3 + [(STALE, STALE)]


def test_claims_in_simulated_time_end_by_simulated_time_only():
    health = Health(level=OK, good_until=stamp_to_message(30 * S), tested=stamp_to_message(0))
    received = Received.at(health, 0, 100.0)
    assert received.ended_s(10 * S, 1000.0, is_real=False) < 0.0 < received.ended_s(10 * S, 1000.0)
    assert received.ended_s(31 * S, 100.1, is_real=False) == pytest.approx(1.0)
