"""Interpolation of positions that are updated less often than they are published."""

from dataclasses import replace

from ema_core.repetition import between_renewals, held_samples
from ema_core.telemetry import Telemetry


def renewed(telemetry: Telemetry) -> Telemetry:
    """Return telemetry with a repeated position interpolated linearly between its updates.

    A position that repeats each value k times lags by (k - 1) / 2 samples, which looks like a
    change of the tracking lag. Speed and effort are interpolated as well if they repeat their
    values, so that all columns have the same delay. Without repetition, the telemetry is returned
    unchanged.
    """
    if held_samples(telemetry.position) < 2:
        return telemetry
    columns = {
        name: between_renewals(values, held)
        for name in ("position", "speed", "current")
        if (held := held_samples(values := getattr(telemetry, name))) > 1
    }
    return replace(telemetry, **columns)
