"""Tests of a simulated actuator, recorded as windows without a bag."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import click
import numpy as np
from numpy.typing import NDArray

from ema_cli.bench import Bench
from ema_core.causes import CAUSE_BY_NAME
from ema_core.commands import Command
from ema_core.faults import healthy_faults
from ema_core.wording import counted
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.design.rehearsal import Recorder
from ema_monitor.model.monitor_model import compile_kernels, form_of
from ema_monitor.windows.band import band_limited, rms
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_monitor.windows.window import Window
from ema_sim.bench import ActuatorBench

CALIBRATION_OPTION: Final = click.option(
    "--calibration",
    "calibration_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Calibration of the unit: the simulated actuator deviates and scatters as it does.",
)

_PILOT_WINDOWS: Final = 6
# What a unit deviates by that is no parameter of the simulated plant, but a cause.
_STEADY: Final = (
    *("load_torque", "load_stiffness", "torque_constant", "stribeck"),
    *("current_offset", "current_gain", "speed_offset", "speed_gain"),
    *("current_delay", "speed_delay"),
)


class Rehearsal(Recorder):
    """Records windows of a simulated actuator."""

    def __init__(
        self, given: Bench, on_cycle: Callable[[], None], calibration_file: Path | None = None
    ) -> None:
        self._given = given
        self._description, self._parameters = given.description, given.parameters
        self._seeds = np.random.SeedSequence(given.settings.seed)
        self._on_cycle = on_cycle
        self._causes: dict[str, float] = {}
        self._added: tuple[float, ...] = (0.0, 0.0)
        compile_kernels([form_of(given.description.drive)])
        if calibration_file is not None:
            self._stand_for(Calibration.load(calibration_file))

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
        settings = replace(self._given.settings, seed=int(rng.integers(2**62)))
        both = {
            name: self._causes.get(name, 0.0) + causes.get(name, 0.0)
            for name in (*self._causes, *causes)
        }
        bench = ActuatorBench(
            self._description,
            settings,
            parameters=self._parameters,
            resolutions=self._given.resolutions,
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

    def _stand_for(self, calibration: Calibration) -> None:
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
        healthy = self(self._given.command, healthy_faults(), _PILOT_WINDOWS, {})
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
