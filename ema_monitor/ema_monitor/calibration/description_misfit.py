# SPDX-License-Identifier: Apache-2.0
"""Detection of contradictions between a healthy window and the description of its actuator.

A window reveals wrong parameters that `ema_core.consistency` cannot detect, because they agree with
each other. A window does not reveal parameters that its motion does not depend on.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.columns.errors import ColumnError, UnrelatedColumn
from ema_core.columns.of_model import wrong_column_of_model
from ema_core.columns.wording import error_text
from ema_core.parameters import ActuatorParameters
from ema_monitor.calibration.healthy_model import healthy_response
from ema_monitor.model.monitor_model import MonitorModel, Response
from ema_monitor.windows.band import band_limited
from ema_monitor.windows.window import Window

_CHANGED: Final = 1.5
_MATTERS: Final = 0.1


@dataclass(frozen=True)
class DescriptionMisfit:
    """Contradiction between a healthy window and the description of its actuator."""

    column: ColumnError | UnrelatedColumn
    """Column that differs from the response of the healthy model."""
    examples: dict[str, float]
    """Parameters, keyed by name, that affect the window and still have the values of the built-in
    example."""

    def __str__(self) -> str:
        if not self.examples:
            return error_text(self.column)
        listed = ", ".join(f"{name} = {value:g}" for name, value in self.examples.items())
        return (
            f"{error_text(self.column)}; these parameters affect the window and still have the "
            f"values of the built-in example: {listed}"
        )


def description_misfit(window: Window, model: MonitorModel) -> DescriptionMisfit | None:
    """Return the contradiction between a healthy window and the described actuator, or None."""
    column = _wrong_column(window, healthy_response(window, model), model.parameters)
    if column is None:
        return None
    actual = model.parameters.as_mapping()
    examples = {name: actual[name] for name in _relevant_examples(window, model)}
    return DescriptionMisfit(column, examples)


def _relevant_examples(window: Window, model: MonitorModel) -> list[str]:
    """Return names of parameters that affect a window and have the built-in example's values.

    A parameter affects the window if a 50 % larger value changes the response by 10 %. The list is
    empty for the example actuator itself.
    """
    example, actual = ActuatorParameters().as_mapping(), model.parameters.as_mapping()
    unchanged = [name for name, value in example.items() if actual[name] == value and value]
    if len(unchanged) >= sum(bool(value) for value in example.values()):
        return []
    expected = healthy_response(window, model)
    names = []
    for name in unchanged:
        try:
            changed = model.parameters.replace({name: _CHANGED * actual[name]})
        except ValueError:  # the new value contradicts another parameter
            continue
        varied = MonitorModel(changed, model.form, model.dt, acquisition=model.acquisition)
        response = healthy_response(window, varied)
        for changed_row, before in (
            (response.current, expected.current),
            (response.speed, expected.speed),
        ):
            if np.linalg.norm(changed_row - before) > _MATTERS * np.linalg.norm(before):
                names.append(name)
                break
    return names


def _wrong_column(
    window: Window, expected: Response, parameters: ActuatorParameters
) -> ColumnError | UnrelatedColumn | None:
    """Return the first column of a window that contradicts the nominal response, or None."""
    measured = window.telemetry
    travel = window.command - window.command[0]
    moves = window.moves
    pairs = {"position": (measured.position - measured.position[0], travel)}
    if len(measured.speed):
        pairs["speed"] = (measured.speed[1:], expected.speed[0])
    if len(measured.current):
        pairs["current"] = (measured.current[1:] * moves, expected.current[0] * moves)
    for name, (row, model) in pairs.items():
        h = window.sample_period
        if wrong := _difference(name, band_limited(row, h), band_limited(model, h), parameters.tau):
            return wrong
    return None


def _difference(
    name: str, row: Array, model: Array, tau: float
) -> ColumnError | UnrelatedColumn | None:
    """Return the error of a column relative to its expected values, or None if they agree."""
    size = float(np.linalg.norm(row) * np.linalg.norm(model))
    correlation = float(row @ model) / size if size > 0.0 else 0.0
    ratio = float(row @ model) / float(model @ model) if size > 0.0 else math.nan
    return wrong_column_of_model(name, ratio, correlation, tau)
