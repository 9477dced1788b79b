# SPDX-License-Identifier: Apache-2.0
"""Streams of telemetry with a command, and other columns that identify the samples."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ema_core.telemetry import Telemetry
from ema_monitor.reason_texts import joined
from ema_monitor.reasons import Reason

Kind = TypeVar("Kind")
H = 1e-4
PERIOD_NS = 100_000
START_NS = 1_700_000_000_000_000_000


def stream(command: NDArray[np.float64], first_index: int = 1) -> Telemetry:
    """Return telemetry with a command, whose other columns count its samples."""
    count = np.arange(len(command), dtype=float)
    columns = (command, count, 1e6 + count, 2e6 + count)
    return Telemetry(START_NS + PERIOD_NS * first_index, H, first_index, *columns)


def sentence(reason: Reason | None) -> str:
    """Return the sentence of a reason; empty for None."""
    return joined(filter(None, [reason]))


def only(kind: type[Kind], events: Sequence[object]) -> list[Kind]:
    """Return the events, after checking that each is of a kind."""
    selected = [event for event in events if isinstance(event, kind)]
    assert len(selected) == len(events), events
    return selected


def blocks(telemetry: Telemetry, size: int) -> list[Telemetry]:
    """Cut telemetry into blocks of ``size`` samples."""
    n = len(telemetry)
    return [telemetry.part(start, min(start + size, n)) for start in range(0, n, size)]
