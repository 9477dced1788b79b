# SPDX-License-Identifier: Apache-2.0
"""Fixtures: telemetry of simulated actuators, a calibration and estimates."""

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from ema_core.commands import THESIS_CHIRP, CommandCycle, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_core.parameters import ActuatorParameters
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.diagnosis import identify
from ema_monitor.identification.estimate import Estimate
from ema_monitor.model.monitor_model import MonitorModel
from ema_monitor.windows.trigger import WindowTrigger
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator

from .streams import only
from .windows import once


@pytest.fixture(scope="session")
def description() -> ActuatorDescription:
    return ActuatorDescription()


@pytest.fixture(scope="session")
def cycle(description) -> CommandCycle:
    return build_cycle(THESIS_CHIRP, description.sample_period)


@pytest.fixture(scope="session")
def windows_of(cycle) -> Callable[..., list[Window]]:
    """Return a function that simulates faults, one window per test cycle, with cached runs."""

    @once
    def windows_of(faults: Mapping[str, float], cycles: int = 1) -> list[Window]:
        actuator = SimulatedActuator()
        actuator.faults = fault_vector(dict(faults))
        telemetry = actuator.advance(np.tile(cycle.samples, cycles))
        windows = only(Window, WindowTrigger(ActuatorParameters()).feed(telemetry))
        assert len(windows) == cycles
        return windows

    return windows_of


@pytest.fixture(scope="session")
def stirred_window(cycle) -> Callable[..., Window]:
    """Return a function that simulates a window after a random tremble of the command.

    The tremble changes the course of the PWM. From rest and without noise, the simulation is
    bit-identical each time. The tremble of about 10 urad exceeds what the trigger accepts as rest,
    and ends before the test cycle approaches.
    """
    nominal = ActuatorParameters()

    @once
    def stirred_window(
        faults: Mapping[str, float], seed: int, plant: ActuatorParameters = nominal
    ) -> Window:
        rng = np.random.default_rng(seed)
        actuator = SimulatedActuator(plant)
        actuator.faults = fault_vector(dict(faults))
        tremble = 1.2e-5 * rng.standard_normal(int(rng.integers(50, 400)))
        telemetry = actuator.advance(np.concatenate([tremble, cycle.samples]))
        [window] = [w for w in WindowTrigger(nominal).feed(telemetry) if isinstance(w, Window)]
        return window

    return stirred_window


@pytest.fixture(scope="session")
def healthy_windows(windows_of) -> list[Window]:
    return windows_of({}, 6)[:5]


@pytest.fixture(scope="session")
def unseen_window(windows_of) -> Window:
    """Return a healthy window that the calibration does not include."""
    return windows_of({}, 6)[5]


@pytest.fixture(scope="session")
def calibration(healthy_windows, description) -> Calibration:
    return calibrate_model(healthy_windows, description)


@pytest.fixture(scope="session")
def estimates(windows_of, unseen_window, calibration, description) -> Callable[[str], Estimate]:
    """Return a function that estimates a reference case with the default algorithm, cached."""
    from .reference_cases import CASES

    @once
    def estimate(case: str) -> Estimate:
        [window] = windows_of(CASES[case]) if CASES[case] else [unseen_window]
        return identify(window, description, calibration)

    return estimate


@pytest.fixture(scope="session")
def stirred_estimates(stirred_window, calibration, description) -> Callable[[str], Estimate]:
    """Return a function that estimates a reference case after a tremble of the command, cached."""
    from .reference_cases import CASES

    @once
    def estimate(case: str) -> Estimate:
        return identify(stirred_window(CASES[case], 3), description, calibration)

    return estimate


@pytest.fixture
def counted(monkeypatch) -> list[int]:
    """Return a list that receives the number of windows in each call of the model."""
    counts = []
    respond = MonitorModel.respond

    def counting(model, window, faults, *arguments):
        counts.append(len(np.atleast_2d(faults)))
        return respond(model, window, faults, *arguments)

    monkeypatch.setattr(MonitorModel, "respond", counting)
    return counts
