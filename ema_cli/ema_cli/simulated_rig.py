# SPDX-License-Identifier: Apache-2.0
"""Test rig with a simulated actuator, which returns tests as windows without writing a bag."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema_cli.rig_settings import RigSettings
from ema_core.commands import Command
from ema_core.wording import counted
from ema_monitor.design.rehearsal import ActuatorRig
from ema_monitor.model.monitor_model import compile_kernels, form_of
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_monitor.windows.window import Window
from ema_sim.bench import ActuatorBench


class SimulatedRig(ActuatorRig):
    """Test rig with a simulated actuator; ``on_cycle`` is called after each test cycle."""

    def __init__(self, options: RigSettings, on_cycle: Callable[[], None]) -> None:
        self._options = options
        self._seeds = np.random.SeedSequence(options.settings.seed)
        self._on_cycle = on_cycle
        compile_kernels([form_of(options.description.drive)])

    def __call__(
        self,
        command: Command,
        faults: NDArray[np.float64],
        cycles: int,
        causes: Mapping[str, float],
    ) -> list[Window]:
        """Run test cycles of a command and return one window per cycle.

        Parameters
        ----------
        command
            Command of a cycle.
        faults
            Normalised faults, ``(8,)``.
        cycles
            Number of test cycles.
        causes
            Hidden causes, keyed by name.

        Raises
        ------
        ValueError
            If the command produces no usable window.
        """
        [seeds] = self._seeds.spawn(1)
        rng = np.random.default_rng(seeds)
        settings = replace(self._options.settings, seed=int(rng.integers(2**62)))
        bench = ActuatorBench(
            self._options.description,
            settings,
            parameters=self._options.parameters,
            resolutions=self._options.resolutions,
            causes=causes,
        )
        bench.set_command(command)
        bench.set_faults(faults)
        h = self._options.description.sample_period
        trigger = TriggerSettings(window_s=len(command.sample(h)) * h)
        finder = WindowFinder(trigger, self._options.description)
        windows: list[Window] = []
        for _ in range(cycles):
            for block, _ in bench.begin_cycle().blocks:
                for event in finder.feed(block):
                    window = event.window if isinstance(event, Segment) else event
                    if not isinstance(window, Window):
                        raise ValueError(f"the command produces no usable window: {window.reason}")
                    windows.append(window)
            self._on_cycle()
        if len(windows) != cycles:
            raise ValueError(
                f"{counted(cycles, 'cycle')} of the command {command.shape} produced "
                f"{counted(len(windows), 'window')}: expected motion back and forth without a "
                f"rest of {trigger.rest_s:g} s"
            )
        return windows
