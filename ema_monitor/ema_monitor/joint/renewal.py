# SPDX-License-Identifier: Apache-2.0
"""Interpolation of positions that are updated less often than they are published."""

from dataclasses import replace

from ema_core.arrays import Array
from ema_core.repetition import between_renewals, held_samples, irregular_updates
from ema_core.telemetry import Telemetry


def renewed(telemetry: Telemetry) -> Telemetry:
    """Return telemetry with a repeated position interpolated linearly between its updates.

    A position that repeats each value k times lags by (k - 1) / 2 samples, which looks like a
    change of the tracking lag. An irregularly updated position also looks rough. Speed and effort
    are interpolated as well if they repeat their values, so that all columns have the same delay.
    Without repetition, the telemetry is returned unchanged.
    """
    if _longest_update(telemetry.position) < 2:
        return telemetry
    columns = {
        name: between_renewals(values, longest)
        for name in ("position", "speed", "current")
        if (longest := _longest_update(values := getattr(telemetry, name))) > 1
    }
    return replace(telemetry, **columns)


def _longest_update(values: Array) -> int:
    """Return the number of samples per update of a column, ``(n,)``; 1 without repeated values.

    If the updates are irregular, the longest usual number is returned.
    """
    if (held := held_samples(values)) > 1:
        return held
    irregular = irregular_updates(values)
    return irregular.longest if irregular else 1
