"""Measured hidden causes: their values in a window, with standard deviations."""

import math
from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.causes import CAUSE_BY_NAME, CauseEstimate
from ema_core.parameters import ActuatorParameters
from ema_core.quantity import is_finite_number
from ema_core.wording import as_identifier, counted, unknown_name
from ema_monitor.model.deviations import COLUMNS, HIDDEN_CAUSES, SENSOR_ERRORS, Prior, hidden_causes
from ema_monitor.windows.window import Window

GRAMMAR: Final = "NAME=VALUE:SIGMA"
"""Text of a measured cause: value and standard deviation in its unit."""


def measured_causes(given: Mapping[str, tuple[float, float]]) -> tuple[CauseEstimate, ...]:
    """Return measured causes, checked, in the order of `HIDDEN_CAUSES`.

    Parameters
    ----------
    given
        Value and standard deviation by name, such as ``{"load_torque": (0.1, 0.005)}``, in the unit
        of the registry (`ema_core.causes`). They count from the calibrated state of the unit.

    Raises
    ------
    ValueError
        As of `checked_causes`.
    """
    return checked_causes([CauseEstimate(name, *_pair(name, item)) for name, item in given.items()])


def checked_causes(given: Iterable[CauseEstimate]) -> tuple[CauseEstimate, ...]:
    """Return causes that may have been measured, in the order of `HIDDEN_CAUSES`.

    Raises
    ------
    ValueError
        When the model does not know a cause, it is given twice, its value is not a number in its
        range, or its sigma is not positive; the message names the cause, its value and unit.
    """
    causes: dict[str, CauseEstimate] = {}
    for one in given:
        name = as_identifier(one.name)
        if name not in HIDDEN_CAUSES:
            raise ValueError(unknown_name("measured cause", one.name, HIDDEN_CAUSES))
        if name in causes:
            raise ValueError(f"measured cause {name} is given more than once")
        causes[name] = _checked(one._replace(name=name))
    return tuple(causes[name] for name in HIDDEN_CAUSES if name in causes)


def measured_causes_of(texts: Iterable[str]) -> tuple[CauseEstimate, ...]:
    """Return the measured causes described by texts of the form `GRAMMAR`.

    Raises
    ------
    ValueError
        When a text does not have that form, and as in `checked_causes`.
    """
    return checked_causes([_parsed(text) for text in texts])


def expected_causes(parameters: ActuatorParameters, window: Window) -> tuple[Prior, ...]:
    """Return all hidden causes that may show in a window, with their priors.

    A measurement replaces the prior of a healthy unit by the measured value and its sigma.
    The sensor of a column that is not measured can have no error.
    """
    by_name = {one.name: one for one in window.measured}
    absent = [f"{column}_{error}" for column in window.telemetry.missing for error in SENSOR_ERRORS]
    return tuple(
        _around(by_name[one.name], one) if one.name in by_name else one
        for one in hidden_causes(parameters, window.excitation)
        if one.name not in absent
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
            f"measured cause {name} = {item!r}: expected its value and its standard deviation"
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
        raise ValueError(f"measured cause {text!r}: expected {GRAMMAR}, two numbers") from None


def _checked(one: CauseEstimate) -> CauseEstimate:
    cause = CAUSE_BY_NAME[one.name]
    if not (is_finite_number(one.value) and cause.lowest <= one.value <= cause.highest):
        raise ValueError(
            f"measured cause {one.name} = {one.value!r}: expected a number in [{cause.lowest:g}, "
            f"{cause.highest:g}] {cause.unit}"
        )
    if not (is_finite_number(one.sigma) and one.sigma > 0.0):
        raise ValueError(
            f"measured cause {one.name}: sigma = {one.sigma!r}: expected a positive, finite number "
            f"in {cause.unit}"
        )
    return CauseEstimate(one.name, float(one.value), float(one.sigma))


def measured_columns(measured: Iterable[CauseEstimate]) -> Array:
    """Return the measured causes in the order of `COLUMNS`, ``(28,)``; 0 for all others."""
    values = np.zeros(len(COLUMNS))
    for one in measured:
        values[COLUMNS.index(one.name)] = one.value
    return values


def taken_for_known(measured: Iterable[Iterable[CauseEstimate]]) -> str:
    """Return the causes measured in windows and their ranges, in words; "" if there are none."""
    by_name: dict[str, list[CauseEstimate]] = {}
    for of_window in measured:
        for one in of_window:
            by_name.setdefault(one.name, []).append(one)
    words = []
    for values in by_name.values():
        lowest, highest = min(values, key=_value), max(values, key=_value)
        span = f"{lowest}" if lowest.value == highest.value else f"{lowest} to {highest}"
        words.append(f"{span} in {counted(len(values), 'window')}")
    return ", ".join(words)


def _value(one: CauseEstimate) -> float:
    return one.value
