# SPDX-License-Identifier: Apache-2.0
"""Messages about a drive with an unknown controller: records, quantities and health."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_core.event_kinds import EventKind
from ema_core.faults import fault_vector
from ema_core.telemetry import Telemetry
from ema_interfaces.msg import FaultEstimate, Health, QuantityChange
from ema_interfaces.srv import Calibrate
from ema_monitor.calibration.joint_calibration import JointCalibration
from ema_monitor.calibrations import calibrate, load_calibration
from ema_monitor.health import TORQUE_PER_AMPERE
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator

from ..waiting import wait_for
from .monitor_session import START_NS, monitor

UNKNOWN = ActuatorDescription(sample_period=1e-3, drive="unknown")
RECORDS = 6


def motion(number: int = 0, noise_a: float = 0.05, **faults: float) -> Telemetry:
    """Return 10 s of motion between rests; the rest after it is long enough to end a record."""
    actuator = SimulatedActuator(sample_period=1e-3, stamp_ns=START_NS + number * 20 * 10**9)
    actuator.faults = fault_vector(faults)
    time = np.arange(0.0, 10.0, 1e-3)
    moves = 0.03 * np.sin(2 * np.pi * 0.7 * time) + 0.015 * np.sin(2 * np.pi * 1.9 * time)
    whole = actuator.advance(np.concatenate([np.zeros(1000), moves, np.full(6000, moves[-1])]))
    noise = noise_a * np.random.default_rng(number).standard_normal(len(whole))
    return replace(whole, current=whole.current + noise)


def record_of(telemetry: Telemetry) -> Window:
    finder = WindowFinder(TriggerSettings(), UNKNOWN)
    windows = [event.window for event in finder.feed(telemetry) if isinstance(event, Segment)]
    return next(window for window in windows if isinstance(window, Window))


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("unit") / "unit.yaml"
    calibrate([record_of(motion(number)) for number in range(RECORDS)], UNKNOWN).save(path)
    return path


@pytest.mark.slow
def test_quantities_and_health_of_an_unknown_drive_are_published(calibration: Path):
    with monitor({"calibration_file": str(calibration)}) as session:
        session.describe(UNKNOWN)
        session.feed([motion(7)])
        healthy = session.next_estimate()
        assert healthy.verdict == FaultEstimate.VALID
        health = session.until(session.healths)[-1]
        assert (health.level, health.health_index) == (Health.OK, pytest.approx(1.0, abs=0.01))
        session.feed([motion(8, friction=0.2)])
        estimate = session.next_estimate()
        assert (estimate.verdict, estimate.algorithm) == (
            FaultEstimate.DEPARTED,
            "inverse_dynamics",
        )
        assert estimate.faults.friction == pytest.approx(0.2, abs=0.03)
        assert math.isnan(estimate.faults.short_circuit_a)
        assert estimate.unobservable & FaultEstimate.GAIN
        changes = {quantity.name: quantity for quantity in estimate.quantities}
        assert changes["friction"].judgement == QuantityChange.CHANGED
        assert changes["friction"].change == pytest.approx(0.4, abs=0.06)
        assert changes["inertia"].judgement == QuantityChange.UNCHANGED
        assert changes["gravity"].judgement == QuantityChange.NOT_JUDGED
        health = session.until(lambda: session.healths()[1:])[-1]
        assert health.level == Health.WARN
        assert health.health_index < 0.9
        item = next(
            requirement
            for requirement in health.requirements
            if requirement.name == TORQUE_PER_AMPERE
        )
        assert (item.value, item.unit) == (pytest.approx(1.0, abs=0.02), "1")


@pytest.mark.slow
def test_departure_of_a_figure_is_published_held_and_stored(calibration: Path, tmp_path: Path):
    settings = {"calibration_file": str(calibration), "history_folder": f"{tmp_path}/history"}
    with monitor(settings) as session:
        session.describe(UNKNOWN)
        session.feed([motion(8, noise_a=0.5)])
        estimate = session.next_estimate()
        assert estimate.verdict == FaultEstimate.DEPARTED
        assert estimate.reason.startswith("Effort roughness is ")
        health = session.until(session.healths)[-1]
        assert (health.level, health.health_index) == (Health.WARN, pytest.approx(0.99, abs=0.01))
        assert estimate.reason.startswith(health.cause)
        assert [(event.kind, event.text) for event in health.events] == [
            (EventKind.DEPARTURE, health.cause)
        ]
        session.feed([motion(9)])
        assert session.next_estimate().verdict == FaultEstimate.VALID
        held = session.until(lambda: session.healths()[1:])[-1]
        assert held.level == Health.WARN
        assert "the next record must confirm that it has ended" in held.cause
        session.feed([motion(10)])
        assert session.next_estimate().verdict == FaultEstimate.VALID
        assert session.until(lambda: session.healths()[2:])[-1].level == Health.OK
    with monitor(settings) as session:
        session.mount(UNKNOWN)
        health = session.until(session.healths)[-1]
        # The stamp is years ago.
        assert (health.level, health.last_level) == (Health.STALE, Health.OK)


@pytest.mark.slow
@pytest.mark.parametrize("has_clock", [True, False])
def test_healthy_records_of_a_drive_without_a_clock_have_no_date(tmp_path: Path, has_clock: bool):
    file = tmp_path / "unit.yaml"
    settings = {"calibration_file": str(file), "calibration_folder": str(tmp_path)}
    with monitor({**settings, "has_clock": has_clock}) as session:
        session.describe(UNKNOWN)
        request = Calibrate.Request(windows=2)
        future = session.start(Calibrate, "/ema/monitor/calibrate", request)
        works = session.node.work.worker.works.values
        wait_for(lambda: any(work.awaiting for work in works()), "the call to wait for records")
        session.feed([motion(0)])
        session.next_estimate()
        session.feed([motion(1)])
        answer = session.result(future)
        assert answer.success, answer.message
    calibration = load_calibration(file)
    assert isinstance(calibration, JointCalibration)
    assert (0 in calibration.baseline.days) == (not has_clock)
