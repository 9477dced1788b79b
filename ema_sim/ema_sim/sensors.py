"""Sensors: noise on the current, and finite resolution."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ema_core.telemetry import COLUMNS, Telemetry
from ema_core.wording import unknown_name


class Sensors:
    """Sensors between the actuator and its telemetry.

    Parameters
    ----------
    current_noise
        Standard deviation of Gaussian noise on each sample of the current [A].
    resolutions
        Resolution by column: rad for command and position, A for current, rad/s for speed.
    rng
        Random numbers of the noise.

    Raises
    ------
    ValueError
        When a value is negative or not finite, or a column is unknown.
    """

    def __init__(
        self, current_noise: float, resolutions: Mapping[str, float], rng: np.random.Generator
    ) -> None:
        if not 0.0 <= current_noise < float("inf"):
            raise ValueError(f"current_noise = {current_noise:g} A: expected at least 0 A")
        for name, resolution in resolutions.items():
            if name not in COLUMNS:
                raise ValueError(unknown_name("telemetry column", name, COLUMNS))
            if not 0.0 < resolution < float("inf"):
                raise ValueError(f"resolution of {name} = {resolution:g}: expected more than 0")
        self._current_noise = current_noise
        self._resolutions = dict(resolutions)
        self._rng = rng

    def measure(self, block: Telemetry) -> Telemetry:
        """Return the measured block.

        Parameters
        ----------
        block
            True telemetry.
        """
        if self._current_noise > 0.0:
            noise = self._rng.normal(0.0, self._current_noise, len(block))
            block = replace(block, current=block.current + noise)
        rounded = {
            name: resolution * np.round(getattr(block, name) / resolution)
            for name, resolution in self._resolutions.items()
        }
        return replace(block, **rounded)
