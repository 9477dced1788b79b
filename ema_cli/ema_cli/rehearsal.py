"""Tests of a simulated actuator, recorded as windows without a bag."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from ema_core.causes import CAUSE_BY_NAME
from ema_core.commands import Command
from ema_core.description import ActuatorDescription
from ema_core.faults import healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_core.wording import counted
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.design.rehearsal import Recorder
from ema_monitor.model.monitor_model import compile_kernels, form_of
from ema_monitor.windows.band import band_limited, rms
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_monitor.windows.window import Window
from ema_sim.bench import ActuatorBench, BenchSettings

_PILOT_WINDOWS: Final = 6
# What a unit deviates by that is no parameter of the simulated plant, but a cause.
_STEADY: Final = (
    *("load_torque", "load_stiffness", "torque_constant", "stribeck"),
    *("current_offset", "current_gain", "speed_offset", "speed_gain"),
    *("current_delay", "speed_delay"),
)


class Rehearsal(Recorder):
    """Records windows of a simulated actuator.

    Parameters
    ----------
    description
        The actuator.
    parameters
        True parameters of the plant.
    current_noise, resolutions
        Of its sensors, as of ``ema_sim.simulate``.
    seed
        Seed of all noise.
    on_cycle
        Called after each test cycle; it may raise.
    """

    def __init__(
        self,
        description: ActuatorDescription,
        parameters: ActuatorParameters,
        current_noise: float,
        resolutions: Mapping[str, float],
        seed: int,
        on_cycle: Callable[[], None],
    ) -> None:
        self._description = description
        self._parameters = parameters
        self._current_noise = current_noise
        self._resolutions = resolutions
        self._seeds = np.random.SeedSequence(seed)
        self._on_cycle = on_cycle
        self._causes: dict[str, float] = {}
        self._added: tuple[float, ...] = (0.0, 0.0)

    @classmethod
    def of_unit(
        cls,
        description: ActuatorDescription,
        true_values: Mapping[str, float],
        current_noise: float,
        resolutions: Mapping[str, float],
        seed: int,
        on_cycle: Callable[[], None],
        calibration_file: Path | None,
        command: Command,
    ) -> Self:
        """Return that of an actuator whose true parameters differ from those described.

        Parameters
        ----------
        description, current_noise, resolutions, seed, on_cycle
            As of the class.
        true_values
            True parameters of the plant by name; those of the description where it names none.
        calibration_file
            Calibration of the unit to `stand_for`; None for none.
        command
            Command to compare the scatter under.

        Raises
        ------
        ValueError, OSError
            When a parameter is impossible, or the calibration does not fit or cannot be read.
        """
        parameters = description.parameters.replace(true_values)
        rehearsal = cls(description, parameters, current_noise, resolutions, seed, on_cycle)
        compile_kernels([form_of(description.drive)])
        if calibration_file is not None:
            rehearsal.stand_for(Calibration.load(calibration_file), command)
        return rehearsal

    def __call__(
        self,
        command: Command,
        faults: NDArray[np.float64],
        cycles: int,
        causes: Mapping[str, float],
    ) -> list[Window]:
        """Return a window from each of some test cycles; see `Recorder`."""
        [seeds] = self._seeds.spawn(1)
        rng = np.random.default_rng(seeds)
        settings = BenchSettings(current_noise=self._current_noise, seed=int(rng.integers(2**62)))
        both = {
            name: self._causes.get(name, 0.0) + causes.get(name, 0.0)
            for name in (*self._causes, *causes)
        }
        bench = ActuatorBench(
            self._description,
            settings,
            parameters=self._parameters,
            resolutions=self._resolutions,
            causes=both,
        )
        bench.set_command(command)
        bench.set_faults(faults)
        h = self._description.sample_period
        trigger = TriggerSettings(window_s=len(command.sample(h)) * h)
        finder = WindowFinder(trigger, self._description)
        windows: list[Window] = []
        for _ in range(cycles):
            for block, _ in bench.begin_cycle().blocks:
                for event in finder.feed(block):
                    found = event.window if isinstance(event, Segment) else event
                    if not isinstance(found, Window):
                        raise ValueError(f"the command makes no window: {found.reason}")
                    windows.append(self._noisier(found, rng))
            self._on_cycle()
        if len(windows) != cycles:
            raise ValueError(
                f"{counted(cycles, 'cycle')} of the command {command.shape} made "
                f"{counted(len(windows), 'window')}: a test moves to and fro without a rest of "
                f"{trigger.rest_s:g} s"
            )
        return windows

    def stand_for(self, calibration: Calibration, command: Command) -> None:
        """Make the actuator deviate and its healthy windows scatter as those of a unit.

        Turns and eccentricity of the healthy unit are left out.

        Parameters
        ----------
        calibration
            That of the unit.
        command
            Command to compare the scatter under.

        Raises
        ------
        ValueError
            When the calibration is not of this unit and sample period, or the command makes no
            window.
        """
        if reason := calibration.unit_mismatch(self._description):
            raise ValueError(f"the calibration does not fit: {reason}")
        if calibration.sample_period != self._description.sample_period:
            raise ValueError(
                f"the calibration is for samples of {calibration.sample_period:g} s, not of "
                f"{self._description.sample_period:g} s: scatter differs between the two"
            )
        self._parameters = calibration.unit_parameters
        deviations = calibration.unit._asdict()
        self._causes = {
            name: max(deviations[name], CAUSE_BY_NAME[name].lowest)
            for name in _STEADY
            if deviations[name] != 0.0
        }
        healthy = self(command, healthy_faults(), _PILOT_WINDOWS, {})
        mine = calibrate_model(healthy, self._description)
        rows = np.random.default_rng(0).standard_normal((100, len(healthy[0])))
        of_white = rms(band_limited(rows, self._description.sample_period))
        scatters = zip(
            (calibration.healthy_rms, calibration.healthy_speed_rms),
            (mine.healthy_rms, mine.healthy_speed_rms),
            strict=True,
        )
        self._added = tuple(
            math.sqrt(max(0.0, wanted**2 - own**2)) / of_white for wanted, own in scatters
        )

    def _noisier(self, window: Window, rng: np.random.Generator) -> Window:
        """Return a window with the noise added that the unit has beyond its simulation."""
        if not any(self._added):
            return window
        t = window.telemetry
        # Of a column that is not measured nothing is made.
        current, speed = (
            row + sigma * rng.standard_normal(len(row))
            for row, sigma in zip((t.current, t.speed), self._added, strict=True)
        )
        return replace(window, telemetry=replace(t, current=current, speed=speed))
