"""Columns of healthy telemetry that cannot be what they are called: sign, unit or order."""

import math
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_monitor.model.monitor_model import Response
from ema_monitor.windows.band import band_limited
from ema_monitor.windows.window import Window

_LOWEST_CORRELATION: Final = 0.5
_NEAR: Final = 0.4
_KNOWN_FACTORS: Final = {
    "position": {180.0 / math.pi: "degrees", 1e3: "mrad"},
    "speed": {30.0 / math.pi: "rpm", 180.0 / math.pi: "degrees per second", 1e3: "mrad/s"},
    "current": {1e3: "mA"},
}


def column_defect(window: Window, expected: Response) -> str:
    """Return which column of a healthy window is wrong, and how probably; empty when none is.

    Parameters
    ----------
    window
        The healthy window.
    expected
        Response of the nominal model to its command, ``(1, n)`` each.
    """
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
        factors = {1.0: ""} | _KNOWN_FACTORS[name]
        if reason := _difference(band_limited(row, h), band_limited(model, h), factors):
            return f"{name}: {reason}"
    return ""


def _difference(row: Array, model: Array, factors: dict[float, str]) -> str:
    """Return how a row differs from what it should be about; empty when it does not."""
    size = float(np.linalg.norm(row) * np.linalg.norm(model))
    correlation = float(row @ model) / size if size > 0.0 else 0.0
    if abs(correlation) < _LOWEST_CORRELATION:
        return (
            f"it has little to do with what the model expects (correlation {correlation:.2f}): "
            "is it another column?"
        )
    ratio = float(row @ model) / float(model @ model)
    sign = "the sign is reversed" if ratio < 0.0 else ""
    for factor, unit in factors.items():
        if abs(abs(ratio) / factor - 1.0) < _NEAR:
            return " and ".join(filter(None, [sign, unit and f"it seems to be in {unit}"]))
    return f"it is {ratio:.3g} times what the model expects: is its unit, or the gear ratio, right?"
