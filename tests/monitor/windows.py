"""Windows made by hand, without an actuator."""

import numpy as np
from numpy.typing import ArrayLike

from ema_core.telemetry import Telemetry
from ema_monitor.window import Window


def window_from(
    command: ArrayLike,
    *,
    position: float = 0.0,
    speed: float = 0.0,
    current: ArrayLike | float = 0.0,
    sample_period: float = 1e-4,
    play: float | None = 0.0,
) -> Window:
    """Window with a command, `(n + 1,)` including that at the start, and an initial state."""
    command = np.array(command, dtype=float)
    columns = (np.full(len(command), value, dtype=float) for value in (position, speed))
    measured = np.array(np.broadcast_to(np.asarray(current, dtype=float), command.shape))
    return Window(Telemetry(0, sample_period, 0, command, measured, *columns), play)
