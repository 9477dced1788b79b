"""Hidden causes that act on parameters of a plant or on a published column alone."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry

COPPER: Final = 3.93e-3
"""Rise of the resistance of copper [1/K]."""


def changed(parameters: ActuatorParameters, causes: Mapping[str, float]) -> ActuatorParameters:
    """Return the parameters of a plant with hidden causes."""
    factors = {
        # The drive goes on reckoning with k_t.
        "k_e": 1.0 + causes.get("torque_constant", 0.0),
        "R_s": 1.0 + COPPER * causes.get("winding_temperature", 0.0),
        "V_max": 1.0 + causes.get("supply_voltage", 0.0),
        **dict.fromkeys(("C_m", "C_u"), 1.0 + causes.get("viscous_friction", 0.0)),
        **dict.fromkeys(("J_m", "J_u"), 1.0 + causes.get("inertia", 0.0)),
    }
    return parameters.replace(
        {name: factor * getattr(parameters, name) for name, factor in factors.items()}
    )


def published(telemetry: Telemetry, causes: Mapping[str, float]) -> Telemetry:
    """Return what sensors with gains, offsets and delays publish of ideal telemetry."""
    columns = {}
    for name in ("command", "current", "position", "speed"):
        values = getattr(telemetry, name)
        if delay := causes.get(f"{name}_delay", 0.0):
            values = _late(values, delay / telemetry.sample_period)
        gain, offset = (causes.get(f"{name}_{what}", 0.0) for what in ("gain", "offset"))
        columns[name] = (1.0 + gain) * values + offset
    return replace(telemetry, **columns)


def _late(values: NDArray[np.float64], samples: float) -> NDArray[np.float64]:
    """Return a column that is late by so many samples; before its start it has its first value."""
    at = np.arange(len(values), dtype=float)
    return np.interp(at - samples, at, values)
