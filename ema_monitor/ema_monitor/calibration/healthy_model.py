# SPDX-License-Identifier: Apache-2.0
"""Residuals of the healthy model in healthy windows."""

from collections.abc import Iterator, Sequence
from functools import reduce
from typing import Any

import numpy as np

from ema_core.arrays import Array
from ema_core.faults import healthy_faults
from ema_monitor.calibration.alignment import moved, shift_between
from ema_monitor.model.measured import measured_columns
from ema_monitor.model.monitor_model import MonitorModel, Response
from ema_monitor.model.readings import read
from ema_monitor.windows.window import Window


class WindowGroup(Sequence[Window]):
    """Windows with the same command, loaded on access."""

    def __init__(self, windows: Sequence[Window], numbers: list[int]) -> None:
        self._windows, self._numbers = windows, numbers

    def __len__(self) -> int:
        return len(self._numbers)

    def __getitem__(self, index: Any) -> Any:
        return self._windows[self._numbers[index]]


def healthy_residuals(
    windows: Sequence[Window], model: MonitorModel, weights: Array | float = 1.0
) -> Iterator[Array]:
    """Yield the current and speed residuals of the healthy model, ``(2, n)`` [A, rad/s].

    Each window yields one array, aligned with the first window and multiplied by ``weights``,
    ``(n,)``.
    """
    command = windows[0].command
    for window in windows:
        response = healthy_response(window, model)
        shift = shift_between(window.command, command, windows[0].telemetry.sample_period)
        residuals = window.missed(response.current[0], response.speed[0], model.parameters.tau)
        yield np.array([weights * moved(row, -shift) for row in residuals])


def mean_residuals(
    windows: Sequence[Window], model: MonitorModel, weights: Array | float = 1.0
) -> Array:
    """Return the mean current and speed residuals over windows, ``(2, n)`` [A, rad/s]."""
    return reduce(np.add, healthy_residuals(windows, model, weights)) / len(windows)


def sample_weights(groups: Sequence[Sequence[Window]]) -> list[Array | float]:
    """Return the sample weights for the fit of a unit, ``(n,)`` or 1 for each command.

    Ordinary motion is often slow or at rest, where the model of the mean current is least accurate.
    If any window contains a rest, the samples are weighted as in an estimate (M15). Otherwise all
    samples have equal weights.
    """
    if all(np.all(group[0].moves) for group in groups):
        return [1.0] * len(groups)
    return [group[0].weights for group in groups]


def healthy_response(window: Window, model: MonitorModel) -> Response:
    """Return the response of the healthy actuator in a window, including measured causes."""
    deviations, position = read(measured_columns(window.measured)[None], window)
    return model.respond(
        window, healthy_faults(), place_in_play(window), deviations=deviations, position=position
    )


def place_in_play(window: Window) -> float:
    """Return the initial position of the motor within its play [half-widths]; 0 if unknown."""
    return 0.0 if window.play is None else window.play
