"""Windows made by hand, without an actuator."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ema_core.commands import THESIS_CHIRP, Command
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate, refusal
from ema_monitor.identification.fitness import FITNESS, LeastSquares
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.windows.trigger import Refusal, WindowTrigger
from ema_monitor.windows.window import Window
from ema_sim.api import simulate


def window_from(
    command: ArrayLike,
    *,
    position: float = 0.0,
    speed: ArrayLike | float = 0.0,
    current: ArrayLike | float = 0.0,
    sample_period: float = 1e-4,
    play: float | None = 0.0,
) -> Window:
    """Window with a command, `(n + 1,)` including that at the start, and an initial state."""
    command = np.array(command, dtype=float)
    columns = (
        np.array(np.broadcast_to(np.asarray(column, dtype=float), command.shape))
        for column in (current, position, speed)
    )
    return Window(Telemetry(0, sample_period, 0, command, *columns), play)


_recorded: dict[str, Window] = {}


def recorded(
    faults: Mapping[str, float], causes: Mapping[str, float], command: Command | None = None
) -> Window:
    """Window of the simulated actuator with faults and hidden causes; each is made once."""
    key = f"{faults} {causes} {command}"
    if key not in _recorded:
        telemetry = simulate(faults, causes=causes, command=command or THESIS_CHIRP, seed=3)
        [window] = WindowTrigger(ActuatorParameters()).feed(telemetry)
        assert isinstance(window, Window)
        _recorded[key] = window
    return _recorded[key]


def changed(window: Window, **columns) -> Window:
    """Window with other columns of telemetry."""
    return replace(window, telemetry=replace(window.telemetry, **columns))


def answered(window: Window, current: ArrayLike, speed: ArrayLike) -> Window:
    """Window with another current and speed behind the start, `(n,)` each [A, rad/s]."""
    start = window.telemetry
    return changed(
        window,
        current=np.append(start.current[0], current),
        speed=np.append(start.speed[0], speed),
    )


def refused(reason: str) -> Estimate:
    """Estimate of a window in which no faults can be identified."""
    return refusal(Refusal(0, 1, reason), "", SearchSettings(), reason)


def fitness_for(name: str, window: Window, calibration: Calibration) -> LeastSquares:
    """Return a distance from a window with the scatter of a calibration."""
    scatter = calibration.reference(window).scatter
    return FITNESS[name](window, calibration.parameters, scatter, calibration.acquisition)
