"""Interpolation of positions that are updated more slowly than they are published."""

from dataclasses import replace

from ema_core.repetition import between_renewals, held_samples
from ema_core.telemetry import Telemetry


def renewed(telemetry: Telemetry) -> Telemetry:
    """Interpolate a repeated position linearly between its updates.

    A position that repeats each value k times is late by (k - 1) / 2 samples, as if the tracking
    had changed. If speed and effort repeat their values as well, they are put on lines, too: all
    columns keep the same time. Without repetition, the telemetry is unchanged.
    """
    if held_samples(telemetry.position) < 2:
        return telemetry
    columns = {
        name: between_renewals(values, held)
        for name in ("position", "speed", "current")
        if (held := held_samples(values := getattr(telemetry, name))) > 1
    }
    return replace(telemetry, **columns)
