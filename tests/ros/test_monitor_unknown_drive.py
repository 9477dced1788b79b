"""A drive whose controller is unknown, as other nodes see it: estimate and health by current."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema_core.commands import THESIS_CHIRP, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_core.telemetry import Telemetry
from ema_interfaces.msg import FaultEstimate, Health
from ema_monitor.calibrations import calibrate
from ema_monitor.health import TORQUE_PER_AMPERE
from ema_monitor.prognosis.history_entry import DEPARTURE
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator

from .monitor_session import START_NS, monitor

UNKNOWN = ActuatorDescription(sample_period=1e-3, drive="unknown")


def cycle(
    number: int = 0, torque_constant: float = 0.0, noise_a: float = 0.05, **faults: float
) -> Telemetry:
    actuator = SimulatedActuator(sample_period=1e-3, stamp_ns=START_NS + number * 10**10)
    actuator.faults = fault_vector(faults)
    actuator.causes = {"torque_constant": torque_constant}
    whole = actuator.advance(build_cycle(THESIS_CHIRP, 1e-3).samples)
    noise = noise_a * np.random.default_rng(number).standard_normal(len(whole))
    return replace(whole, current=whole.current + noise)


def window_of(telemetry: Telemetry) -> Window:
    finder = WindowFinder(TriggerSettings(), UNKNOWN)
    found = [one.window for one in finder.feed(telemetry) if isinstance(one, Segment)]
    return next(one for one in found if isinstance(one, Window))


@pytest.mark.slow
def test_faults_and_torque_of_an_unknown_drive_are_published(tmp_path: Path):
    calibration = calibrate([window_of(cycle(n)) for n in range(4)], UNKNOWN)
    calibration.save(tmp_path / "unit.yaml")
    with monitor({"calibration_file": f"{tmp_path}/unit.yaml"}) as session:
        session.describe(UNKNOWN)
        session.feed([cycle(9, -0.15, friction=0.4)])
        estimate = session.next_estimate()
        assert estimate.verdict == FaultEstimate.DEGRADED  # a loss of torque has other causes, too
        assert estimate.faults.friction == pytest.approx(0.4, abs=0.02)
        assert math.isnan(estimate.faults.short_circuit_a)
        assert estimate.unobservable & FaultEstimate.GAIN
        torque = next(one for one in estimate.hidden_causes if one.name == "torque_constant")
        assert torque.value == pytest.approx(-0.15, abs=0.02)
        assert "drive unknown" in estimate.reason
        health = session.until(session.healths)[-1]
        item = next(one for one in health.requirements if one.name == TORQUE_PER_AMPERE)
        assert (item.value, item.unit) == (pytest.approx(0.85, abs=0.02), "1")


@pytest.mark.slow
def test_departure_that_no_fault_explains_is_told_and_kept(tmp_path: Path):
    calibration = calibrate([window_of(cycle(n)) for n in range(4)], UNKNOWN)
    calibration.save(tmp_path / "unit.yaml")
    given = {"calibration_file": f"{tmp_path}/unit.yaml", "history_folder": f"{tmp_path}/history"}
    with monitor(given) as session:
        session.describe(UNKNOWN)
        session.feed([cycle(8)])
        assert session.next_estimate().verdict != FaultEstimate.DEPARTED
        assert session.until(session.healths)[-1].level == Health.OK
        session.feed([cycle(9, noise_a=0.5)])
        estimate = session.next_estimate()
        assert estimate.verdict == FaultEstimate.DEPARTED
        assert "the roughness of the current in the forward stroke" in estimate.reason
        health = session.until(lambda: session.healths()[1:])[-1]
        assert (health.level, health.cause) == (Health.WARN, estimate.reason)
        assert [(one.kind, one.text) for one in health.events] == [(DEPARTURE, estimate.reason)]
    with monitor(given) as session:
        session.mount(UNKNOWN)
        health = session.until(session.healths)[-1]
        # Its stamp is of another year.
        assert (health.level, health.last_level) == (Health.STALE, Health.WARN)
        assert estimate.reason in health.cause
