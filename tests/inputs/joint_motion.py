# SPDX-License-Identifier: Apache-2.0
"""Motion of a joint with an unknown controller: back and forth with rests, in SI columns."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters

TAU = 0.01
START_NS = 1_700_000_000_000_000_000


def joint(rate_hz: float = 200.0) -> ActuatorDescription:
    return ActuatorDescription(
        "joint",
        "J-1",
        sample_period=1.0 / rate_hz,
        parameters=ActuatorParameters(tau=TAU, k_t=0.05),
        drive="unknown",
    )


def moves(
    seconds: float = 12.0, rate_hz: float = 200.0, travel: float = 0.5, seed: int = 0
) -> tuple[dict[str, NDArray[np.float64]], NDArray[np.int64]]:
    """Return columns and stamps.

    The position lags the command by 30 ms; the effort has friction, inertia and gravity.
    """
    h = 1.0 / rate_hz
    n = round(seconds * rate_hz)
    times: NDArray[np.float64] = h * np.arange(1.0, n + 1.0)
    rng = np.random.default_rng(seed)

    def angle(at: NDArray[Any]) -> NDArray[np.float64]:
        # A cycle lasts 1.2 s: half a cycle of motion in each direction, with rests at both ends.
        phase = (np.maximum(at, 0.0) / 1.2) % 1.0
        ramp = np.clip(np.minimum(phase, 1.0 - phase) * 3.0 - 0.25, 0.0, 1.0)
        return travel * (ramp**3 * (10.0 + ramp * (6.0 * ramp - 15.0)) - 0.4)

    position, step = angle(times - 0.03), 1e-4
    speed = (angle(times - 0.03 + step) - angle(times - 0.03 - step)) / (2.0 * step)
    acceleration = np.gradient(speed, h)
    current = 0.8 * np.tanh(speed / 0.02) + 0.02 * acceleration + 0.5 * np.sin(position)
    columns = {
        "command": angle(times),
        "current": current + rng.normal(0.0, 0.02, n),
        "position": position + rng.normal(0.0, 1e-5, n),
        "speed": speed / TAU + rng.normal(0.0, 1e-3, n),
    }
    return columns, START_NS + np.rint(times * 1e9).astype(np.int64)
