# SPDX-License-Identifier: Apache-2.0
"""Interpolation of positions that are updated less often than they are published."""

from dataclasses import replace

from ema_core.arrays import Array
from ema_core.columns.repetition import between_renewals, held_column
from ema_core.telemetry import Telemetry


def renewed(telemetry: Telemetry) -> Telemetry:
    """Return telemetry with a repeated position interpolated linearly between its updates.

    A position that repeats each value k times lags by (k - 1) / 2 samples, which looks like a
    change of the tracking lag. An irregularly updated position also looks rough. Speed and effort
    are interpolated as well if they repeat their values, so that all columns have the same delay.
    If the position does not repeat its values, the telemetry is returned unchanged.
    """
    if _longest_update("position", telemetry.position) < 2:
        return telemetry
    columns = {
        name: between_renewals(values, longest)
        for name in ("position", "speed", "current")
        if (longest := _longest_update(name, values := getattr(telemetry, name))) > 1
    }
    return replace(telemetry, **columns)


def samples_per_update(telemetry: Telemetry) -> float:
    """Return the mean number of samples per update of the position during motion.

    Without repeated values, it is 1.
    """
    held = held_column("position", telemetry.position)
    return held.mean if held else 1.0


def _longest_update(column: str, values: Array) -> int:
    held = held_column(column, values)
    return held.longest if held else 1
