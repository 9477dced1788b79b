# SPDX-License-Identifier: Apache-2.0
"""A measured load or temperature is used for the windows that follow it."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_bags.writer import BagWriter
from ema_cli.bags import reading
from ema_cli.bags.identifying import Identifying
from ema_core.telemetry import Telemetry
from ema_interfaces.msg import FaultEstimate, HiddenCause, MeasuredCauses
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.node.publish.messages import estimate_to_message
from ema_monitor.windows.trigger import TriggerSettings
from ema_ros import topics
from ema_ros.stamps import stamp_from_message, stamp_to_message

from ..waiting import wait_for
from .monitor_session import CYCLE, FLAP, START_NS, MonitorSession, Source, monitor

LOAD, SIGMA = 0.3, 0.01
CYCLES = 3
S = 1_000_000_000
PERIOD_NS = 100_000
CYCLE_NS = len(CYCLE.samples) * PERIOD_NS
MAX_AGE_S = 1.5
TOPIC = f"{topics.NAMESPACE}/{topics.MEASURED_CAUSES}"
WARN = b"\x01"


def measurement(
    stamp_ns: int, value: float = LOAD, *, actuator_id: str = "flap", **fields: Any
) -> MeasuredCauses:
    """Return a message with a measured load; ``given`` replaces fields of the cause."""
    values = {"name": "load_torque", "value": value, "sigma": SIGMA} | fields
    message = MeasuredCauses(actuator_id=actuator_id, causes=[HiddenCause(**values)])
    message.header.stamp = stamp_to_message(stamp_ns)
    return message


def window_start(cycle: int) -> int:
    """Return a time just before the window of a cycle, when the command is at rest [ns]."""
    return START_NS + cycle * CYCLE_NS + CYCLE.start * PERIOD_NS - 10_000_000


@pytest.fixture(scope="module")
def cycles() -> list[list[Telemetry]]:
    """Test cycles of an actuator with friction under a load, in blocks."""
    loaded = Source(friction=0.2)
    loaded.actuator.causes = {"load_torque": LOAD}
    return [loaded.cycle() for _ in range(CYCLES)]


@pytest.fixture(scope="module")
def messages() -> list[MeasuredCauses]:
    """Measurements that are valid for the windows of cycles 0 and 2 only."""
    return [
        measurement(window_start(0) - S, 0.1),
        measurement(window_start(0) - S // 2),
        # Cycle 1 has no valid one: too old, of another actuator, or during the window.
        measurement(window_start(1) - round((MAX_AGE_S + 0.1) * S), 0.1),
        measurement(window_start(1) - S // 2, 0.1, actuator_id="rudder"),
        measurement(window_start(1) + S // 4, 0.1),
        measurement(window_start(2) - S // 2),
        # Causes measured at different times all count.
        measurement(window_start(2) - S, 0.0, name="winding_temperature", sigma=2.0, unit="K"),
    ]


@pytest.fixture(scope="module")
def bag(tmp_path_factory, cycles, messages) -> Path:
    path = tmp_path_factory.mktemp("bags") / "loaded.mcap"
    writer = BagWriter(path)
    with SimulatedActuatorBag(writer, FLAP, START_NS) as recording:
        writer.add_topic(TOPIC, *topics.SYSTEM_TOPICS[topics.MEASURED_CAUSES])
        for block in (block for blocks in cycles for block in blocks):
            recording.write_block(block, 0.0)
        # Their stamps count, not their log times.
        for message in (*messages, measurement(START_NS, name="cogging")):
            writer.write(TOPIC, message, START_NS, stamp_from_message(message.header.stamp))
    return path


@pytest.fixture(scope="module")
def offline(bag: Path) -> list[FaultEstimate]:
    """Estimates of `ema estimate`, as messages."""
    settings = TriggerSettings()
    windows = reading.read_windows(
        bag, reading.ReadingOptions(trigger=settings, measured_max_age_s=MAX_AGE_S)
    )
    assert any(
        "1 impossible measurement" in remark and "cogging" in remark for remark in windows.remarks
    )
    estimates = Identifying().estimate(windows.windows, Calibration.builtin())
    return [
        estimate_to_message(estimate, item.number, item.description)
        for estimate, item in zip(estimates, windows.windows, strict=True)
    ]


@pytest.fixture(scope="module")
def session() -> Iterator[MonitorSession]:
    with monitor({"measured_max_age_s": MAX_AGE_S}) as running:
        running.describe()
        yield running


@pytest.fixture(scope="module")
def live(session: MonitorSession, cycles, messages) -> list[FaultEstimate]:
    for message in messages:
        session.send(topics.MEASURED_CAUSES, message)
    log = session.node.sources.measurements
    wait_for(lambda: len(log.at("flap", window_start(2))) == 2, "the measurements")
    estimates = []
    for blocks in cycles:
        session.feed(blocks)
        # At most two windows wait.
        estimates.append(session.next_estimate())
    return estimates


def loads(causes: Any) -> list[tuple[str, float, str]]:
    return [(cause.name, cause.value, cause.unit) for cause in causes]


def test_only_measurements_before_a_window_are_used(live: list[FaultEstimate]):
    load = ("load_torque", LOAD, "N.m")
    assert [loads(estimate.measured) for estimate in live] == [
        [load],
        [],
        [load, ("winding_temperature", 0.0, "K")],
    ]
    assert next(iter(live[0].measured)).sigma == SIGMA
    for number in (0, 2):
        assert (live[number].verdict, list(live[number].causes)) == (FaultEstimate.VALID, [])
    # A load that was not measured is estimated.
    [cause] = list(live[1].causes)
    assert cause.name == "load_torque"
    assert abs(cause.value - LOAD) < 3.0 * cause.sigma


def test_bag_gives_the_estimates_of_the_monitor(live, offline):
    for estimate, expected in zip(live, offline, strict=True):
        assert estimate.measured == expected.measured
        assert (estimate.causes, estimate.reason) == (expected.causes, expected.reason)
        assert estimate.faults == expected.faults
        np.testing.assert_array_equal(estimate.covariance, expected.covariance)
        assert estimate.evaluations == expected.evaluations


WRONG: dict[str, tuple[Callable[[], MeasuredCauses], str]] = {
    "value": (lambda: measurement(S, 11.0), "load_torque = 11.0: expected a number in [-10, 10]"),
    "unit": (lambda: measurement(S, unit="mN.m"), "unit = 'mN.m': expected 'N.m'"),
    "stamp": (lambda: measurement(0), "stamp = 0 ns: expected the measurement time"),
}


@pytest.mark.usefixtures("live")
@pytest.mark.parametrize("case", WRONG)
def test_impossible_measurement_is_named_and_counted(session: MonitorSession, case: str):
    make, printed = WRONG[case]
    before = session.node.actuators["flap"].defect_count
    session.send(topics.MEASURED_CAUSES, make())
    status = session.until_status("flap telemetry", printed, WARN)
    assert {item.key: item.value for item in status.values}["defects"] == str(before + 1)


@pytest.mark.usefixtures("live")
def test_measurement_without_or_with_an_unknown_actuator_is_reported(session: MonitorSession):
    session.send(topics.MEASURED_CAUSES, measurement(S, actuator_id=""))
    session.until_status("input", "measured causes without actuator_id", WARN)
    session.send(topics.MEASURED_CAUSES, measurement(S, 11.0, actuator_id="tab"))
    session.until_status("input", "'tab': measured cause load_torque = 11.0", WARN)
    for name in ("rudder", "tab"):
        session.send(topics.MEASURED_CAUSES, measurement(S, actuator_id=name))
    unused = "measured causes of 'rudder', 'tab', which are not monitored"
    session.until_status("input", unused, WARN)
    assert "tab" not in session.node.actuators
    # They are used as soon as the actuator is known.
    session.feed(Source().cycle()[:1], "tab")
    session.until(lambda: unused not in session.statuses("input")[-1].message)
    assert session.node.sources.measurements.at("tab", S)


def test_measured_causes_of_an_unlisted_actuator_are_reported():
    with monitor({"actuators": ["flap"]}) as session:
        session.send(topics.MEASURED_CAUSES, measurement(S, actuator_id="flip"))
        unused = "measured causes of 'flip', which is not monitored"
        session.until_status("input", unused, WARN)
        assert not session.node.sources.measurements.at("flip", S)
