# SPDX-License-Identifier: Apache-2.0
"""Statuses on /diagnostics follow the conventions of their readers."""

import re
from dataclasses import replace

import numpy as np

from ema_core.description import ActuatorDescription
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_core.telemetry import Telemetry
from ema_monitor.diagnosis import Diagnosed
from ema_monitor.health import HealthLimits
from ema_monitor.node.moment import Moment
from ema_monitor.node.publish.actuator_status import ActuatorStatus
from ema_monitor.node.publish.unit_status import unit_tasks
from ema_monitor.node.receive.arrivals import Arrivals
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import UnusedCycle
from ema_monitor.prognosis.outlook import outlook_of_one, unknown_outlook
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit
from ema_monitor.windows.finder import WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_ros.status import LONGEST_CODE, Task, fault_code, status_message
from ema_ros.throttle import Throttle

from ..monitor.comparisons import CASES, compared
from ..prognosis.made_tests import made_test

BEGIN = Moment(0, 0)


def values_of(task: Task) -> dict[str, str]:
    return {item.key: item.value for item in status_message("/left/monitor", task).values}


def test_status_name_contains_namespace_and_node():
    left, right = (
        status_message(f"/{side}/monitor", Task("flap health", OK, "", f"/{side}/flap"))
        for side in ("left", "right")
    )
    assert left.name == "/left/monitor: flap health"
    assert left.name != right.name
    assert left.hardware_id != right.hardware_id


def test_fault_code_has_capitals_and_at_most_64_characters():
    long = [fault_code(f"/ema/monitor: {'very_' * 20}long_{side} health") for side in "lr"]
    for code in (*long, fault_code("/ema/monitor: Klappe (links) – health")):
        assert re.fullmatch(r"[A-Z0-9]+(_[A-Z0-9]+)*", code), code
        assert len(code) <= LONGEST_CODE
    assert long[0] != long[1]


def test_category_is_of_ne_107_or_normal():
    printed = [values_of(Task("x", level, "", "x"))["ne107"] for level in (OK, WARN, ERROR, STALE)]
    assert printed == ["NORMAL", "CHECK_FUNCTION", "FAILURE", "CHECK_FUNCTION"]
    assert values_of(Task("x", WARN, "", "x", {}, "OFF_SPEC"))["ne107"] == "OFF_SPEC"


def test_repeated_line_is_logged_periodically_with_its_count():
    throttle = Throttle(30.0)
    assert throttle.passed("flap: window 1 is dropped", 0.0) == "flap: window 1 is dropped"
    assert throttle.passed("flap: window 2 is dropped", 1.0) is None
    assert throttle.passed("rudder: window 1 is dropped", 1.0) is not None
    assert throttle.passed("flap: window 3 is dropped", 29.0) is None
    reported = throttle.passed("flap: window 4 is dropped", 30.0)
    assert reported == "flap: window 4 is dropped (and 2 similar before)"
    assert throttle.passed("flap: window 5 is dropped", 70.0) == "flap: window 5 is dropped"


def test_stopped_telemetry_is_stale_despite_valid_estimates():
    unit = ActuatorStatus("flap", WindowFinder(TriggerSettings()), lambda _: None, 0, Arrivals())
    unit.finder.describe(ActuatorDescription())
    zeros = np.zeros(10)
    unit.finder.feed(Telemetry(0, 1e-4, 1, zeros, zeros, zeros, zeros))
    unit.valid = 6
    seen = []
    for now_s in (9, 11):
        unit.expire(1e6, Moment(now_s * 10**9, now_s * 10**9))
        task = unit_tasks(unit, 0)[0]
        seen.append((task.level, task.message))
    assert seen == [(OK, "6 valid estimates"), (STALE, "telemetry has stopped; 6 valid estimates")]


def test_level_of_a_fault_agrees_with_its_value_or_awaits_confirmation():
    unit = ActuatorStatus("flap", WindowFinder(TriggerSettings()), lambda _: None, 0, Arrivals())
    description, settings = ActuatorDescription(), PrognosisSettings()
    unit.finder.describe(description)
    seen, tests = [], Unit(History("flap", "SIM-0001"), settings)
    for number, friction in enumerate((0.45, 0.5113, 0.02, 0.02)):
        estimate = made_test(number, friction=friction)
        diagnosed = Diagnosed(0, 0, description, estimate)
        unit.record(diagnosed, tests.update(estimate, None, settings), BEGIN)
        [task] = [status for status in unit_tasks(unit, 0) if status.name == "flap friction"]
        seen.append((task.level, task.message))
    assert seen == [
        (WARN, "0.45, warning limit 0.1, limit 0.5"),
        (ERROR, "0.5113, limit 0.5"),
        (ERROR, "0.02, limit 0.5; OK once later tests confirm it"),
        (OK, "0.02, limit 0.5"),
    ]
    item = replace(unit.health.outlook.health.faults[0], name="bandwidth", value=16.4, limit=12.0)
    health = replace(unit.health.outlook.health, requirements=(item,))
    unit.health.outlook = replace(unit.health.outlook, health=health)
    [task] = [status for status in unit_tasks(unit, 0) if status.name == "flap bandwidth"]
    assert task.message.startswith("16.4 Hz, limit 12 Hz")
    assert [*task.values] == ["value [Hz]", "sigma [Hz]", "limit [Hz]"]


def health_task(name: str) -> Task:
    """Return the health status after a record with the named comparison."""
    unit = ActuatorStatus("flap", WindowFinder(TriggerSettings()), lambda _: None, 0, Arrivals())
    description = ActuatorDescription()
    unit.finder.describe(description)
    estimate = compared(CASES[name])
    outlook = unknown_outlook("no valid test so far").after_refusal(UnusedCycle.of(estimate))
    if estimate.valid:
        outlook = outlook_of_one(estimate, HealthLimits(), "")
    unit.record(Diagnosed(0, 0, description, estimate), outlook, BEGIN)
    [task] = [status for status in unit_tasks(unit, 0) if status.name == "flap health"]
    return task


def test_quantities_are_plain_decimals_with_their_unit_in_the_key():
    values = values_of(health_task("friction"))
    assert values["friction change [%]"] == "15.2"
    assert values["friction smallest change [%]"] == "6"
    assert values["load change [N.m]"] == "0"
    assert values["tracking lag change [%]"] == "nan"


def test_record_without_a_judgement_is_stale_with_its_reason():
    task = health_task("nothing")
    assert task.level == STALE
    assert "no excitation: the motor stands still" in task.message
    assert values_of(task)["health index"] == "nan"
