# SPDX-License-Identifier: Apache-2.0
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ema_bags.inputs.mapping import ColumnMapping
from ema_core.description import ActuatorDescription
from ema_core.settings_file import settings_from
from ema_core.telemetry import Telemetry
from ema_sim import simulate

mapping_from = partial(settings_from, ColumnMapping)
COLUMNS = {"position": "p", "command": "c", "speed": "s", "current": "i", "clock": "t"}


@cache
def cycle(rate_hz: int) -> Telemetry:
    return simulate({"friction": 0.25}, description=described(rate_hz))


def described(rate_hz: int) -> ActuatorDescription:
    return ActuatorDescription(sample_period=1.0 / rate_hz)


@pytest.fixture
def telemetry() -> Telemetry:
    """Return a test cycle at 1 kHz."""
    return cycle(1000)


@pytest.fixture
def mapped() -> Callable[..., ColumnMapping]:
    """Return a function that makes a mapping in SI units; a section set to None is left out."""

    def make(**sections: Any) -> ColumnMapping:
        content = {**COLUMNS, **sections}
        return mapping_from({name: item for name, item in content.items() if item is not None})

    return make


@pytest.fixture
def columns(telemetry: Telemetry) -> dict[str, NDArray[np.float64]]:
    """Return the columns of ``telemetry`` by name."""
    return {
        "command": telemetry.command,
        "current": telemetry.current,
        "position": telemetry.position,
        "speed": telemetry.speed,
    }
