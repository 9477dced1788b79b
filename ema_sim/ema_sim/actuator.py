# SPDX-License-Identifier: Apache-2.0
"""Simulated actuator that advances the reference kernels block by block."""

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.acquisition import Acquisition
from ema_core.cause_profiles import Causes, Profile, cause_profiles
from ema_core.causes import COPPER
from ema_core.current_loop import current_loop
from ema_core.description import SAMPLE_PERIOD
from ema_core.dynamics import current_sampling, lag_factor
from ema_core.faults import degrade, fault_vector, healthy_faults
from ema_core.parameters import ActuatorParameters, MotorConstants, constants
from ema_core.quantity import finite_samples
from ema_core.telemetry import Telemetry, elapsed_ns
from ema_sim.effects import NO_PAUSES, courses
from ema_sim.field_oriented import (
    FieldOrientedState,
    advance_field_oriented,
    field_oriented_at_rest,
    unlike_causes,
)
from ema_sim.reference import DT, State, Stepping, advance

_NOT_MEASURED = np.zeros(0)

SIMULATED_DRIVES: Final = ("six_step", "field_oriented")
"""Drives that can be simulated."""


class SimulatedActuator:
    """High-fidelity model of an actuator that converts commands to telemetry.

    The samples do not depend on how a command is divided into calls of ``advance``.

    Parameters
    ----------
    parameters
        True parameters of the plant.
    sample_period
        Period of the telemetry [s], a whole multiple of 1 us.
    acquisition
        Acquisition of the telemetry. By default the current is averaged and all columns are
        measured.
    noise_gain
        K_noise, power of the white noise on the reference current: its variance is
        ``K_noise`` 1e-6 / ``noise_hold_s`` [A^2].
    noise_hold_s
        Hold time t_n of each noise value [s]; a multiple of 1 us that divides the sample period.
    rng
        Random generator for the noise; only used if ``noise_gain`` is not 0.
    stamp_ns
        Start time [ns].
    drive
        One of ``SIMULATED_DRIVES``.

    Raises
    ------
    ValueError
        If a period is not a whole multiple of the step below 1 s, ``noise_hold_s`` does not divide
        the sample period, the noise gain is negative or not finite, ``rng`` is missing although the
        noise gain is not 0, or the drive cannot be simulated.
    """

    def __init__(
        self,
        parameters: ActuatorParameters | None = None,
        *,
        sample_period: float = SAMPLE_PERIOD,
        acquisition: Acquisition | None = None,
        noise_gain: float = 0.0,
        noise_hold_s: float = DT,
        rng: np.random.Generator | None = None,
        stamp_ns: int = 0,
        drive: str = "six_step",
    ) -> None:
        if drive not in SIMULATED_DRIVES:
            raise ValueError(
                f"drive {drive!r} cannot be simulated, expected {' or '.join(SIMULATED_DRIVES)}"
            )
        self.drive = drive
        self.parameters = parameters or ActuatorParameters()
        self.sample_period = sample_period
        self._steps = _whole_steps("sample_period", sample_period)
        self.acquisition = acquisition or Acquisition()
        self._sampling = current_sampling(self.acquisition, self._steps, DT)
        self._sample = 0.0
        self._hold = _whole_steps("noise_hold_s", noise_hold_s)
        if self._steps % self._hold:
            raise ValueError(
                f"noise_hold_s = {noise_hold_s:g} s does not divide sample_period = "
                f"{sample_period:g} s"
            )
        if not 0.0 <= noise_gain < math.inf:
            raise ValueError(f"noise_gain = {noise_gain!r} is not a non-negative number")
        if noise_gain > 0.0 and rng is None:
            raise ValueError("noise_gain > 0 requires a random generator: pass rng")
        self._noise_sigma = math.sqrt(noise_gain * 1e-6 / noise_hold_s)
        self._rng = rng
        self._start_ns = stamp_ns
        self._index = 1
        self._last_command = 0.0
        self._last_load = 0.0
        self._causes: dict[str, Profile] = {}
        self.faults = healthy_faults()
        self._loop = current_loop(self.parameters)
        # A `State` or a `FieldOrientedState`, depending on the drive.
        self.state: Any = at_rest() if drive == "six_step" else field_oriented_at_rest()
        self.causes = {}

    @property
    def faults(self) -> NDArray[np.float64]:
        """Fault vector, ``(8,)``; assignments take effect at the next sample.

        Raises
        ------
        ValueError
            If the value is not a fault vector, or the inductance of a phase becomes too small for
            the step of 1 us.
        """
        return self._faults.copy()

    @faults.setter
    def faults(self, values: Mapping[str, float] | ArrayLike) -> None:
        k = fault_vector(values)
        if k.ndim != 1:
            raise ValueError(f"faults: expected one vector of shape ({len(k.T)},), not {k.shape}")
        plant = degrade(constants(self.parameters), k)
        self._check(plant.motor, self._causes)
        self._plant, self._faults = plant, k

    @property
    def causes(self) -> dict[str, Profile]:
        """Hidden causes, keyed by name; assignments take effect at the next sample.

        Times count from the assignment. Sensor causes have no effect on the actuator.

        Raises
        ------
        ValueError
            If `ema_core.cause_profiles.cause_profiles` rejects the causes, the winding is too hot
            for the step of 1 us, or the drive cannot be simulated with a cause.
        """
        return dict(self._causes)

    @causes.setter
    def causes(self, causes: Causes) -> None:
        profiles = cause_profiles(causes)
        self._check(self._plant.motor, profiles)
        self._causes, self._causes_from = profiles, self._index - 1
        self._pauses = NO_PAUSES

    def advance(self, command: ArrayLike, load: ArrayLike | float = 0.0) -> Telemetry:
        """Simulate the response to a command and return its telemetry.

        Parameters
        ----------
        command
            User-shaft angle at the end of each sample, ``(n,)`` [rad].
        load
            External torque on the motor shaft at the end of each sample, positive against positive
            motion, ``(n,)`` or a scalar [N.m].

        Returns
        -------
        Telemetry
            The ``n`` samples; unmeasured columns are empty.

        Raises
        ------
        ValueError
            If a command or load is empty, not finite or of another shape.
        """
        commands = finite_samples("command", command)
        loads = finite_samples("load", np.broadcast_to(np.asarray(load, float), commands.shape))
        n = len(commands)
        disturbances, hold = np.zeros(1), n * self._steps
        if self._noise_sigma > 0.0 and self._rng is not None:
            hold = self._hold
            disturbances = self._rng.normal(0.0, self._noise_sigma, n * self._steps // hold)
        columns = current, position, speed = np.empty(n), np.empty(n), np.empty(n)
        effects = courses(self._causes, self.sample_period, self._index - 1, self._causes_from, n)
        stepping = Stepping(self._steps, hold, DT, lag_factor(DT), self._sampling)
        loaded = self._last_load, loads, disturbances, stepping, self._sample, columns
        signals = self._last_command, commands, *loaded
        if self.drive == "six_step":
            state, self._pauses, self._sample = advance(
                *self._plant, effects, self._pauses, self.state, *signals
            )
            self.state = State(*state)
        else:
            state, self._sample = advance_field_oriented(
                *self._plant, self._loop, effects, self.state, *signals
            )
            self.state = FieldOrientedState(*state)
        block = Telemetry(
            self._start_ns + elapsed_ns(self.sample_period, 0, self._index),
            self.sample_period,
            self._index,
            commands,
            current if self.acquisition.current != "none" else _NOT_MEASURED,
            position,
            speed if self.acquisition.speed else _NOT_MEASURED,
        )
        self._index += n
        self._last_command = float(commands[-1])
        self._last_load = float(loads[-1])
        return block

    def _check(self, motor: MotorConstants, causes: Mapping[str, Profile]) -> None:
        """Raise ``ValueError`` if the drive cannot be simulated with this motor and causes."""
        if self.drive == "six_step":
            _check_decay(motor, causes)
        elif reason := unlike_causes(causes):
            raise ValueError(reason)


def at_rest(theta_m: float = 0.0, theta_b: float = 0.0) -> State:
    """Return the state of an actuator at rest without current.

    Parameters
    ----------
    theta_m, theta_b
        Angles of the motor and of the fast shaft on the user side of the backlash [rad].
    """
    currents_and_lags = (0.0,) * 3 + (1.0,) * 3 + (0.0,) * 6
    return State(float(theta_m), 0.0, float(theta_b), *currents_and_lags)


def _check_decay(motor: MotorConstants, causes: Mapping[str, Profile]) -> None:
    """Raise ``ValueError`` if the time constant of a phase is shorter than the step of 1 us.

    The highest winding temperature of the causes is assumed.
    """
    warmth = causes["winding_temperature"].value if "winding_temperature" in causes else 0.0
    R_s = motor.R_s * (1.0 + COPPER * max(warmth, 0.0))
    decay = DT * R_s / (motor.L_s * min(motor.N_a, motor.N_b, motor.N_c))
    if decay > 1.0:
        raise ValueError(
            f"L_s = {motor.L_s:g} H with R_s = {R_s:g} ohm: the current of the most "
            f"shorted phase decays {decay:.3g} times within a step of {DT:g} s, at most 1 "
            "can be simulated"
        )


def _whole_steps(name: str, period: float) -> int:
    steps = round(period / DT) if 0.0 < period < 1.0 else 0
    if steps < 1 or abs(steps * DT - period) > 1e-6 * DT:
        raise ValueError(f"{name} = {period!r} s is not a whole multiple of {DT:g} s below 1 s")
    return steps
