# SPDX-License-Identifier: Apache-2.0
"""Status of an unknown drive, whose tests are records of up to two minutes."""

import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_core.faults import FAULTS
from ema_core.labels import label_of
from ema_core.levels import WARN
from ema_core.telemetry import Telemetry
from ema_monitor.diagnosis import Diagnosed
from ema_monitor.health import HealthLimits
from ema_monitor.node.moment import Moment
from ema_monitor.node.publish.actuator_status import ActuatorStatus
from ema_monitor.node.publish.unit_status import unit_tasks
from ema_monitor.node.receive.arrivals import Arrivals
from ema_monitor.node.settings import Operation
from ema_monitor.prognosis.outlook import outlook_of_one
from ema_monitor.windows.finder import WindowFinder
from ema_monitor.windows.trigger import TriggerSettings

from ..monitor.comparisons import CASES, compared

H = 0.01
UNKNOWN = ActuatorDescription(sample_period=H, drive="unknown")
SECOND = 0.3 * np.sin(2.0 * np.pi * H * np.arange(1.0, 101.0))


def actuator(
    description: ActuatorDescription, settings: TriggerSettings | None = None
) -> ActuatorStatus:
    unit = ActuatorStatus(
        "flap", WindowFinder(settings or TriggerSettings()), lambda _: None, 0, Arrivals()
    )
    unit.finder.describe(description)
    return unit


def test_status_states_what_a_record_needs_after_three_short_motions():
    unit = actuator(UNKNOWN)
    tasks = []
    for number in range(3):
        # 1 s of motion and 7 s of rest, in blocks of 1 s.
        for second, position in enumerate((SECOND, *np.zeros((7, 100)))):
            index = 1 + 800 * number + 100 * second
            block = Telemetry(index * 10**7, H, index, position, position, position, position)
            assert unit.finder.feed(block) == []
        tasks.append(unit_tasks(unit, 0)[0])
    assert [task.message for task in tasks[:2]] == ["0 valid estimates"] * 2
    assert tasks[2].message.startswith("no record so far: a record needs 2 s of motion")
    assert tasks[2].level == WARN
    assert tasks[2].values["pieces too short for a record"] == 3


@pytest.mark.parametrize(
    ("description", "faults"),
    [
        (UNKNOWN, ["friction", "backlash"]),
        (ActuatorDescription(), [fault.label for fault in FAULTS if fault.limit is not None]),
    ],
)
def test_status_lists_the_faults_that_the_drive_can_show(
    description: ActuatorDescription, faults: list[str]
):
    """A record cannot show short circuits, eccentricity or gain of a joint."""
    unit = actuator(description)
    estimate = compared(CASES["friction"])
    outlook = outlook_of_one(estimate, HealthLimits(), "")
    unit.record(Diagnosed(0, 0, description, estimate), outlook, Moment(0, 0))
    tasks = unit_tasks(unit, 0)
    shown = [task.name.removeprefix("flap ") for task in tasks]
    requirements = [label_of(item.name) for item in outlook.health.requirements]
    assert shown == ["telemetry", "health", *requirements, *faults]
    figures = tasks[1].values
    assert ("gain" in figures) == ("gain" in faults)


@pytest.mark.parametrize(
    ("description", "record_s", "expected"),
    [
        # Three expected periods of 10 s.
        (ActuatorDescription(), 60.0, 30.0),
        # Three records of at most 2 x 60 s; the expected period is longer than 2 x 4 s.
        (UNKNOWN, 60.0, 360.0),
        (UNKNOWN, 4.0, 30.0),
        # 200,000 samples at 10 kHz.
        (ActuatorDescription(sample_period=1e-4, drive="unknown"), 60.0, 60.0),
    ],
)
def test_level_holds_for_three_of_the_longest_tests(
    description: ActuatorDescription, record_s: float, expected: float
):
    unit = actuator(description, TriggerSettings(record_s=record_s))
    assert unit.good_for_s(Operation()) == pytest.approx(expected)
