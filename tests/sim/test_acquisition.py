"""How the simulated current is sampled, and columns that are not measured."""

import numpy as np

from ema_core.acquisition import Acquisition
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry, join
from ema_ros.messages import telemetry_from_message, telemetry_to_message
from ema_sim import simulate
from ema_sim.actuator import SimulatedActuator

COMMAND = 2e-3 * np.sin(80.0 * 1e-3 * np.arange(200))
FINE = 100


def sampled(acquisition: Acquisition, period: float = 1e-3, parts: int = 1) -> Telemetry:
    actuator = SimulatedActuator(sample_period=period, acquisition=acquisition)
    return join([actuator.advance(part) for part in np.array_split(COMMAND, parts)])


def fine() -> Telemetry:
    """The same motion in samples of 10 us, whose means are nearly the current itself."""
    knots = np.arange(len(COMMAND) + 1)
    command = np.interp(
        np.arange(1, FINE * len(COMMAND) + 1) / FINE, knots, np.concatenate([[0.0], COMMAND])
    )
    return SimulatedActuator(sample_period=1e-3 / FINE).advance(command)


def test_mean_filtered_and_instantaneous_are_of_one_current():
    """Each sampling against the current in steps of 10 us.

    The motion is one to the last bits, chaos would show; the instant differs from the mean over the
    10 us before it by what three lags of 10 us let through of 67 A/ms in 5 us.
    """
    reference = fine().current.reshape(-1, FINE)
    np.testing.assert_allclose(sampled(Acquisition()).current, reference.mean(axis=1), atol=1e-6)
    instant = sampled(Acquisition("instantaneous")).current
    assert np.max(np.abs(instant - reference[:, -1])) < 0.2
    assert np.std(instant - reference.mean(axis=1)) > 0.1  # the ripple
    tau, state, expected = 3e-4, 0.0, []
    share = -np.expm1(-1e-5 / tau)
    for row in reference:
        for value in row:
            state += share * (value - state)
        expected.append(state)
    filtered = sampled(Acquisition("filtered", tau)).current
    np.testing.assert_allclose(filtered, expected, atol=5e-3)


def test_what_is_not_measured_is_an_empty_column():
    telemetry = simulate(
        description=ActuatorDescription(
            sample_period=1e-3, acquisition=Acquisition("none", speed=False)
        ),
        current_noise=0.05,
        resolutions={"current": 0.01, "speed": 0.1},
        causes={"current_offset": 0.1, "speed_delay": 1e-3},
    )
    assert telemetry.missing == ("current", "speed")
    assert len(telemetry.position) == len(telemetry) > 0
    again = telemetry_from_message(telemetry_to_message(telemetry, "flap"))
    assert again.missing == telemetry.missing
    assert telemetry.part(3, 9).missing == telemetry.missing
