"""Streams of telemetry that carry a command and columns that tell the samples apart."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ema_core.telemetry import COLUMNS, Telemetry
from ema_monitor.windows.trigger import Defect, Refusal
from ema_monitor.windows.window import Window

H = 1e-4
PERIOD_NS = 100_000
START_NS = 1_700_000_000_000_000_000


def stream(command: NDArray[np.float64], first_index: int = 1) -> Telemetry:
    """Telemetry with a command, whose other columns count its samples."""
    count = np.arange(len(command), dtype=float)
    columns = (command, count, 1e6 + count, 2e6 + count)
    return Telemetry(START_NS + PERIOD_NS * first_index, H, first_index, *columns)


def blocks(telemetry: Telemetry, size: int) -> Iterator[Telemetry]:
    """Cut telemetry into blocks of a size."""
    for start in range(0, len(telemetry), size):
        yield Telemetry(
            telemetry.stamp_ns + PERIOD_NS * start,
            H,
            telemetry.first_index + start,
            *(getattr(telemetry, name)[start : start + size] for name in COLUMNS),
        )


def windows_in(events: list[Window | Refusal | Defect]) -> list[Window]:
    """Return events of which each must be a window."""
    windows = [event for event in events if isinstance(event, Window)]
    assert len(windows) == len(events), events
    return windows


def refusals_in(events: list[Window | Refusal | Defect]) -> list[Refusal]:
    """Return events of which each must be a refusal."""
    refusals = [event for event in events if isinstance(event, Refusal)]
    assert len(refusals) == len(events), events
    return refusals


def defects_in(events: list[Window | Refusal | Defect]) -> list[Defect]:
    """Return events of which each must be a defect."""
    defects = [event for event in events if isinstance(event, Defect)]
    assert len(defects) == len(events), events
    return defects
