"""Telemetry of simulated actuators, and a calibration, that the tests of the monitor share."""

from collections.abc import Callable, Mapping
from functools import cache

import numpy as np
import pytest

from ema_core.commands import THESIS_CHIRP, Cycle, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.windows.trigger import WindowTrigger
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator


@pytest.fixture(scope="session")
def description() -> ActuatorDescription:
    return ActuatorDescription()


@pytest.fixture(scope="session")
def cycle(description) -> Cycle:
    return build_cycle(THESIS_CHIRP, description.sample_period)


@pytest.fixture(scope="session")
def record(cycle) -> Callable[[Mapping[str, float], int], Telemetry]:
    """Telemetry of an actuator with faults through some test cycles; each run is made once."""

    @cache
    def run(faults: tuple[tuple[str, float], ...], cycles: int) -> Telemetry:
        actuator = SimulatedActuator()
        actuator.faults = fault_vector(dict(faults))
        return actuator.advance(np.tile(cycle.samples, cycles))

    def record(faults: Mapping[str, float], cycles: int = 1) -> Telemetry:
        return run(tuple(sorted(faults.items())), cycles)

    return record


@pytest.fixture(scope="session")
def windows_of(record) -> Callable[[Mapping[str, float], int], list[Window]]:
    """Windows of an actuator with faults, one of each test cycle."""

    def windows_of(faults: Mapping[str, float], cycles: int = 1) -> list[Window]:
        events = WindowTrigger(ActuatorParameters()).feed(record(faults, cycles))
        windows = [event for event in events if isinstance(event, Window)]
        assert len(windows) == len(events) == cycles
        return windows

    return windows_of


@pytest.fixture(scope="session")
def stirred_window(cycle) -> Callable[[Mapping[str, float], int, ActuatorParameters], Window]:
    """Window after a tremble of the command, which makes the PWM take another course each time.

    From rest and without noise the simulation repeats itself to the last bit. The tremble of some
    10 urad is beyond what the trigger takes for rest, and over before the test cycle approaches.
    """
    nominal = ActuatorParameters()

    @cache
    def run(faults: tuple[tuple[str, float], ...], seed: int, plant: ActuatorParameters) -> Window:
        rng = np.random.default_rng(seed)
        actuator = SimulatedActuator(plant)
        actuator.faults = fault_vector(dict(faults))
        tremble = 1.2e-5 * rng.standard_normal(int(rng.integers(50, 400)))
        telemetry = actuator.advance(np.concatenate([tremble, cycle.samples]))
        [window] = [w for w in WindowTrigger(nominal).feed(telemetry) if isinstance(w, Window)]
        return window

    def stirred_window(
        faults: Mapping[str, float], seed: int, plant: ActuatorParameters = nominal
    ) -> Window:
        return run(tuple(sorted(faults.items())), seed, plant)

    return stirred_window


@pytest.fixture(scope="session")
def healthy_windows(windows_of) -> list[Window]:
    return windows_of({}, 5)


@pytest.fixture(scope="session")
def calibration(healthy_windows, description) -> Calibration:
    return calibrate_model(healthy_windows, description)
