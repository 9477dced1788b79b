# SPDX-License-Identifier: Apache-2.0
"""Validation and conversion of measured hidden causes."""

import math
from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.causes import CAUSE_BY_NAME, CauseEstimate
from ema_core.expecting import require_type
from ema_core.parameters import ActuatorParameters
from ema_core.quantity import is_finite_number
from ema_core.wording import as_identifier, counted, unknown_name
from ema_monitor.model.deviations import COLUMNS, HIDDEN_CAUSES, Prior, hidden_causes
from ema_monitor.windows.window import Window

GRAMMAR: Final = "NAME=VALUE:SIGMA"
"""String format of a measured cause, with value and standard deviation in the unit of the cause."""


def measured_causes(values: Mapping[str, tuple[float, float]]) -> tuple[CauseEstimate, ...]:
    """Return validated measured causes, in the order of `HIDDEN_CAUSES`.

    Parameters
    ----------
    values
        Value and standard deviation by name, such as ``{"load_torque": (0.1, 0.005)}``, in the unit
        of the registry (`ema_core.causes`), relative to the calibrated state of the unit.

    Raises
    ------
    ValueError
        If ``values`` is not a mapping, a cause is unknown to the model or repeated, its value is
        not a number in its range, or its standard deviation is not positive; the message names the
        cause, its value and unit.
    """
    require_type("measured", values, Mapping, "value and standard deviation by name")
    return checked_causes(
        [CauseEstimate(name, *_pair(name, item)) for name, item in values.items()]
    )


def checked_causes(measured: Iterable[CauseEstimate]) -> tuple[CauseEstimate, ...]:
    """Return validated measured causes, in the order of `HIDDEN_CAUSES`.

    Raises
    ------
    ValueError
        If a cause is unknown to the model or repeated, its value is not a number in its range, or
        its standard deviation is not positive; the message names the cause, its value and unit.
    """
    causes: dict[str, CauseEstimate] = {}
    for cause in measured:
        name = as_identifier(cause.name)
        if name not in HIDDEN_CAUSES:
            raise ValueError(unknown_name("measured cause", cause.name, HIDDEN_CAUSES))
        if name in causes:
            raise ValueError(f"measured cause {name} is given more than once")
        causes[name] = _checked(cause._replace(name=name))
    return tuple(causes[name] for name in HIDDEN_CAUSES if name in causes)


def measured_causes_of(texts: Iterable[str]) -> tuple[CauseEstimate, ...]:
    """Return validated measured causes from strings in the format `GRAMMAR`.

    Raises
    ------
    ValueError
        If a string does not have this format, or a cause is invalid (`checked_causes`).
    """
    return checked_causes([_parsed(text) for text in texts])


def expected_causes(parameters: ActuatorParameters, window: Window) -> tuple[Prior, ...]:
    """Return the priors of all hidden causes that may affect a window.

    The prior of a measured cause has the measured value and its standard deviation. Columns that
    are not measured have no sensor errors.
    """
    by_name = {cause.name: cause for cause in window.measured}
    return tuple(
        _around(by_name[prior.name], prior) if prior.name in by_name else prior
        for prior in hidden_causes(parameters, window.excitation)
        if prior.column not in window.telemetry.missing
    )


def _around(measured: CauseEstimate, usual: Prior) -> Prior:
    lowest = max(measured.value - usual.reach, usual.cause.lowest)
    return usual._replace(
        expected=measured.value, sigma=measured.sigma, lowest=lowest, tail=math.inf
    )


def _pair(name: str, item: tuple[float, float]) -> tuple[float, float]:
    try:
        value, sigma = item
    except (TypeError, ValueError):
        raise ValueError(
            f"measured cause {name} = {item!r}: expected a value and its standard deviation"
        ) from None
    return value, sigma


def _parsed(text: str) -> CauseEstimate:
    name, equals, figures = text.partition("=")
    value, colon, sigma = figures.partition(":")
    try:
        if not (equals and colon):
            raise ValueError
        return CauseEstimate(name.strip(), float(value), float(sigma))
    except ValueError:
        raise ValueError(f"measured cause {text!r}: expected {GRAMMAR} with two numbers") from None


def _checked(measured: CauseEstimate) -> CauseEstimate:
    name, value, sigma = measured
    cause = CAUSE_BY_NAME[name]
    if not (is_finite_number(value) and cause.lowest <= value <= cause.highest):
        raise ValueError(
            f"measured cause {name} = {value!r}: expected a number in [{cause.lowest:g}, "
            f"{cause.highest:g}] {cause.unit}"
        )
    if not (is_finite_number(sigma) and sigma > 0.0):
        raise ValueError(
            f"measured cause {name}: sigma = {sigma!r}: expected a positive, finite number in "
            f"{cause.unit}"
        )
    return CauseEstimate(name, float(value), float(sigma))


def measured_columns(measured: Iterable[CauseEstimate]) -> Array:
    """Return the values of measured causes in the order of `COLUMNS`, ``(28,)``; others are 0."""
    values = np.zeros(len(COLUMNS))
    for cause in measured:
        values[COLUMNS.index(cause.name)] = cause.value
    return values


def measured_ranges(measured: Iterable[Iterable[CauseEstimate]]) -> str:
    """Return a list of the causes measured in windows, with their ranges, as one string.

    The string is empty if no causes were measured.
    """
    by_name: dict[str, list[CauseEstimate]] = {}
    for causes in measured:
        for cause in causes:
            by_name.setdefault(cause.name, []).append(cause)
    words = []
    for values in by_name.values():
        lowest, highest = min(values, key=_value), max(values, key=_value)
        span = f"{lowest}" if lowest.value == highest.value else f"{lowest} to {highest}"
        words.append(f"{span} in {counted(len(values), 'window')}")
    return ", ".join(words)


def _value(cause: CauseEstimate) -> float:
    return cause.value
