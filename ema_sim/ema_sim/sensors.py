# SPDX-License-Identifier: Apache-2.0
"""Sensor models: errors from hidden causes, noise on the current, and finite resolution."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema_core.cause_profiles import Profile
from ema_core.telemetry import COLUMNS, Telemetry
from ema_core.wording import unknown_name


class Sensors:
    """Sensors between actuator and telemetry; unmeasured columns stay empty.

    Parameters
    ----------
    current_noise
        Standard deviation of Gaussian noise on each sample of the current [A].
    resolutions
        Resolution, keyed by column: rad for command and position, A for current, rad/s for speed.
    rng
        Random generator for the noise.

    Raises
    ------
    ValueError
        If a value is negative or not finite, or a column is unknown.
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
        self._misreading: Misreading | None = None

    def set_causes(self, causes: Mapping[str, Profile]) -> None:
        """Set the sensor causes, keyed by name; their times count from the next block."""
        self._misreading = Misreading(causes) if causes else None

    def measure(self, block: Telemetry) -> Telemetry:
        """Return a block as measured by the sensors."""
        if self._misreading is not None:
            block = self._misreading.read(block)
        if self._current_noise > 0.0 and "current" not in block.missing:
            noise = self._rng.normal(0.0, self._current_noise, len(block))
            block = replace(block, current=block.current + noise)
        rounded = {
            name: resolution * np.round(getattr(block, name) / resolution)
            for name, resolution in self._resolutions.items()
        }
        return replace(block, **rounded)


class Misreading:
    """Sensor errors: gain, offset and delay of the columns (M26).

    Times of the causes count from the first block.

    Samples do not depend on the length of the blocks: past samples are kept for the delays.
    """

    def __init__(self, causes: Mapping[str, Profile]) -> None:
        self._causes = causes
        self._first: int | None = None
        self._past: dict[str, NDArray[np.float64]] = {}

    def read(self, block: Telemetry) -> Telemetry:
        """Return a block with sensor errors; successive blocks must be contiguous."""
        h = block.sample_period
        if self._first is None:
            self._first = block.first_index
        middles = (block.first_index - self._first + np.arange(len(block)) + 0.5) * h
        values = {name: profile.at(middles) for name, profile in self._causes.items()}
        columns = {}
        for name in COLUMNS:
            column = getattr(block, name)
            if name in block.missing:
                continue
            if f"{name}_delay" in values:
                longest = math.ceil(self._causes[f"{name}_delay"].value / h) + 1
                column = self._delayed(name, column, values[f"{name}_delay"] / h, longest)
            column = (1.0 + values.get(f"{name}_gain", 0.0)) * column
            columns[name] = column + values.get(f"{name}_offset", 0.0)
        return replace(block, **columns)

    def _delayed(
        self, name: str, column: NDArray[np.float64], delays: NDArray[np.float64], longest: int
    ) -> NDArray[np.float64]:
        """Return a column delayed by ``delays`` samples, interpolated linearly.

        The column is constant before its first sample.
        """
        past = self._past.get(name, column[:1])
        extended = np.concatenate([past, column])
        whole = np.floor(delays).astype(int)
        later = np.maximum(np.arange(len(past), len(extended)) - whole, 0)
        earlier = np.maximum(later - 1, 0)
        self._past[name] = extended[-longest:]
        return extended[later] + (delays - whole) * (extended[earlier] - extended[later])
