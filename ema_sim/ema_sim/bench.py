# SPDX-License-Identifier: Apache-2.0
"""Test bench: runs an actuator with sensors, faults and hidden causes through test cycles."""

import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from types import NoneType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.cause_profiles import Causes, Profile, cause_profiles
from ema_core.commands import THESIS_CHIRP, Command, approach_depth, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.expecting import require_type, value_or_default
from ema_core.faults import FAULTS, fault_vector, healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_core.quantity import Checked, check_length, is_finite_number, quantity
from ema_core.telemetry import Telemetry, elapsed_ns
from ema_sim.actuator import SimulatedActuator
from ema_sim.growth import Growth, check_growths, grow
from ema_sim.sensors import Sensors


@dataclass(frozen=True)
class BenchSettings(Checked):
    """Settings of a test bench; ValueError if a value is out of range."""

    block_s: float = quantity(0.01, "s", 1e-6, 1.0, "duration of a block of telemetry")
    pause_s: float = quantity(0.0, "s", 0.0, 3600.0, "pause between two test cycles")
    hours_per_cycle: float = quantity(
        10.0, "h", 0.0, 1e6, "service hours represented by one test cycle"
    )
    load: float = quantity(0.0, "N.m", -1e5, 1e5, "external torque on the motor shaft")
    noise_gain: float = quantity(
        0.0, "-", 0.0, 1e9, "K_noise, noise power on the reference current"
    )
    current_noise: float = quantity(
        0.0, "A", 0.0, 1e3, "standard deviation of the noise on each current sample"
    )
    seed: int = quantity(0, "-", 0, 2**62, "seed of all noise")


class MeasuredBlock(NamedTuple):
    """Block of telemetry as measured on a test bench."""

    telemetry: Telemetry
    """Measured samples."""
    torque: float
    """Motor torque at the end of the block [N.m]."""

    @property
    def duration_s(self) -> float:
        """Length of the block [s]."""
        return len(self.telemetry) * self.telemetry.sample_period


@dataclass(frozen=True, eq=False)
class RunningCycle:
    """A test cycle in progress."""

    number: int
    """Running number, from 0."""
    start_ns: int
    """Start time [ns]."""
    hours: float
    """Service hours at the start [h]."""
    faults: NDArray[np.float64]
    """True fault vector, ``(8,)``."""
    samples: int
    """Number of samples, including the pause."""
    blocks: Iterator[MeasuredBlock]
    """Measured blocks, computed on demand."""


class ActuatorBench:
    """Runs a simulated actuator through test cycles.

    Command, faults and hidden causes can be set from any thread and take effect with the next
    cycle. The samples do not depend on the block length.

    Parameters
    ----------
    description
        The actuator.
    settings
        Settings of the bench; None for the default settings.
    parameters
        True parameters of the plant; None for the parameters of the description.
    resolutions
        Resolution of the sensors, keyed by telemetry column [rad, A, rad/s]; columns without an
        entry are exact.
    causes
        Hidden causes, in any form that ``ema_core.cause_profiles.cause_profiles`` accepts.

    Attributes
    ----------
    end_ns
        End of the last sample so far [ns].

    Raises
    ------
    ValueError
        If a value is out of range or has a wrong type, or the sample period is longer than 10 ms or
        not a whole multiple of the step of the simulation.
    """

    def __init__(
        self,
        description: ActuatorDescription,
        settings: BenchSettings | None = None,
        *,
        parameters: ActuatorParameters | None = None,
        resolutions: Mapping[str, float] | None = None,
        causes: Causes = (),
    ) -> None:
        require_type("description", description, ActuatorDescription)
        require_type("parameters", parameters, (ActuatorParameters, NoneType))
        self.settings = value_or_default("settings", settings, BenchSettings, BenchSettings)
        self.description = description
        sensor_rng, current_rng, self._growth_rng = np.random.default_rng(self.settings.seed).spawn(
            3
        )
        resolutions = value_or_default("resolutions", resolutions, Mapping, dict)
        self._sensors = Sensors(self.settings.current_noise, resolutions, sensor_rng)
        self._actuator = SimulatedActuator(
            parameters or description.parameters,
            sample_period=description.sample_period,
            acquisition=description.acquisition,
            noise_gain=self.settings.noise_gain,
            rng=current_rng,
            drive=self._drive,
        )
        self._block_samples = max(1, round(self.settings.block_s / description.sample_period))
        self._next_cycle = 0
        self.end_ns = 0
        self._service_hours = 0.0
        self._lock = threading.Lock()
        self._causes: dict[str, Profile] = {}
        self.set_command(THESIS_CHIRP)
        self.set_faults(healthy_faults())
        self.set_causes(causes)

    def set_command(self, command: Command) -> None:
        """Set the test command for all cycles that start after the call.

        Raises
        ------
        ValueError
            If the command cannot be sampled at the period of the telemetry, or has a wrong type.
        """
        require_type("command", command, Command)
        h = self.description.sample_period
        check_length(
            self.settings.pause_s / h,
            f"pause_s = {self.settings.pause_s:g} s at sample_period = {h:g} s",
        )
        cycle = build_cycle(command, h, approach_depth(self.description.parameters)).samples
        pause = np.zeros(round(self.settings.pause_s / h))
        samples = np.concatenate([cycle, pause])
        with self._lock:
            self._samples = samples

    def set_faults(
        self,
        faults: Mapping[str, float] | ArrayLike,
        growths: Mapping[str, Growth] | None = None,
        hours_per_cycle: float | None = None,
    ) -> None:
        """Set the faults of the next cycle and their growth.

        Parameters
        ----------
        faults
            Fault vector, in any form that ``ema_core.faults.fault_vector`` accepts.
        growths
            Growth, keyed by component; components without an entry stay constant.
        hours_per_cycle
            Service hours per test cycle [h]; None for the value of the settings.

        Raises
        ------
        ValueError
            If a value is out of range or the motor cannot be simulated; the previous faults and
            growth remain in effect.
        """
        k = fault_vector(faults)
        growths = check_growths(growths or {})
        hours = self.settings.hours_per_cycle if hours_per_cycle is None else hours_per_cycle
        if not is_finite_number(hours) or hours < 0.0:
            raise ValueError(f"hours_per_cycle = {hours:g} h: expected a number of at least 0")
        self._check_simulable(k, growths, self._causes)
        with self._lock:
            self._faults, self._growths, self._hours_per_cycle = k, growths, float(hours)
            self._hours = 0.0

    def set_causes(self, causes: Causes) -> None:
        """Set the hidden causes; they take effect, and their times count, from the next cycle.

        Raises
        ------
        ValueError
            If a cause is invalid or the motor cannot be simulated with it; the previous causes
            remain in effect.
        """
        profiles = self.check_causes(causes)
        with self._lock:
            self._causes = profiles
            self._causes_are_new = True

    def check_causes(self, causes: Causes) -> dict[str, Profile]:
        """Validate hidden causes and return them as profiles, keyed by name, without setting them.

        Raises
        ------
        ValueError
            If a cause is invalid, or the motor cannot be simulated with it.
        """
        profiles = cause_profiles(causes)
        with self._lock:
            faults, growths = self._faults, self._growths
        self._check_simulable(faults, growths, profiles)
        return profiles

    @property
    def causes(self) -> dict[str, Profile]:
        """Hidden causes of the next cycle, keyed by name."""
        return dict(self._causes)

    @property
    def _drive(self) -> str:
        """The simulated drive; an unknown drive is simulated with six-step commutation."""
        drive = self.description.drive
        return "six_step" if drive == "unknown" else drive

    def compile_kernels(self) -> None:
        """Compile the kernels of the simulation, or load them from the cache."""
        trial = self._trial(self._causes)
        trial.advance([0.0])

    def _trial(self, causes: Causes) -> SimulatedActuator:
        """Return a healthy actuator with the parameters of the bench and with hidden causes."""
        h = self.description.sample_period
        trial = SimulatedActuator(self._actuator.parameters, sample_period=h, drive=self._drive)
        trial.causes = causes
        return trial

    def begin_cycle(self, start_ns: int | None = None) -> RunningCycle:
        """Start and return the next test cycle.

        It starts at ``start_ns`` [ns], by default at the end of the last sample.

        Blocks of the previous cycle that were not yet consumed are not computed.
        """
        with self._lock:
            faults, samples = self._faults, self._samples
            self._faults = grow(
                faults, self._growths, self._hours, self._hours_per_cycle, self._growth_rng
            )
            self._hours += self._hours_per_cycle
            hours = self._service_hours
            self._service_hours += self._hours_per_cycle
            causes = self._causes if self._causes_are_new else None
            self._causes_are_new = False
        if start_ns is not None:
            self.end_ns = start_ns
        self._actuator.faults = faults
        if causes is not None:
            self._actuator.causes = causes
            self._sensors.set_causes(causes)
        number = self._next_cycle
        self._next_cycle += 1
        blocks = self._blocks(samples, self.end_ns)
        return RunningCycle(number, self.end_ns, hours, faults.copy(), len(samples), blocks)

    def _blocks(self, samples: NDArray[np.float64], start_ns: int) -> Iterator[MeasuredBlock]:
        h, size = self.description.sample_period, self._block_samples
        for start in range(0, len(samples), size):
            block = self._actuator.advance(samples[start : start + size], self.settings.load)
            elapsed = elapsed_ns(h, block.first_index - start - 1, start + 1)
            block = replace(block, stamp_ns=start_ns + elapsed)
            self.end_ns = block.stamp_at(len(block) - 1)
            yield MeasuredBlock(self._sensors.measure(block), self._actuator.state.torque)

    def _check_simulable(
        self,
        faults: NDArray[np.float64],
        growths: Mapping[str, Growth],
        causes: Mapping[str, Profile],
    ) -> None:
        """Raise ``ValueError`` if the current or fully grown faults cannot be simulated."""
        trial = self._trial(causes)
        trial.faults = faults
        worst = faults.copy()
        for i, fault in enumerate(FAULTS):
            if fault.name in growths and not growths[fault.name].is_constant:
                worst[i] = fault.highest
        trial.faults = worst
