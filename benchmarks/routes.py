"""Ways of telemetry to the monitor that are not our own message: a table, topics of a robot."""

import tempfile
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
import pandas as pd

from ema_bags.inputs.bridging import Bridge, BridgeSettings
from ema_bags.inputs.files import InputFile
from ema_bags.inputs.importing import import_series
from ema_bags.inputs.mapping import Mapping
from ema_bags.inputs.mapping_file import mapping_from
from ema_core.acquisition import Acquisition
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry

_START_NS: Final = 1_700_000_000_000_000_000
_STATES: Final = "/joint_states"
_COMMANDS: Final = "/command"
_LATEST_S: Final = 2e-3


def by_nothing(telemetry: Telemetry, description: ActuatorDescription) -> list[Telemetry]:
    """Return the telemetry as it is."""
    return [telemetry]


def by_table(telemetry: Telemetry, description: ActuatorDescription) -> list[Telemetry]:
    """Return what is imported of a CSV file in the units of a test bench."""
    tau = description.parameters.tau
    columns = {
        "Time [s]": telemetry.stamps_ns * 1e-9,
        "Setpoint [deg]": np.degrees(telemetry.command),
        "Position [deg]": np.degrees(telemetry.position),
        "Speed [1/min]": telemetry.speed * tau * 60.0 / (2.0 * np.pi),
        "Current [mA]": telemetry.current * 1e3,
    }
    mapping = _mapping(
        description.acquisition,
        position={"source": "Position [deg]", "unit": "deg"},
        command={"source": "Setpoint [deg]", "unit": "deg"},
        speed={"source": "Speed [1/min]", "unit": "rpm", "shaft": "user"},
        current={"source": "Current [mA]", "unit": "mA"},
        clock={"source": "Time [s]"},
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "bench.csv")
        measured = {name: values for name, values in columns.items() if len(values)}
        pd.DataFrame(measured).to_csv(path, index=False)
        imported = import_series(InputFile(path, mapping).series(mapping), mapping, description)
    _same(imported.description, description)
    return list(imported.blocks())


def by_topics(telemetry: Telemetry, description: ActuatorDescription) -> list[Telemetry]:
    """Return what the bridge makes of JointState, and of a command sent before each, both late."""
    mapping = _mapping(
        description.acquisition,
        joint="flap",
        position={"topic": _STATES, "source": "position"},
        command={"topic": _COMMANDS, "source": "data", "between": "hold"},
        speed={"topic": _STATES, "source": "velocity", "shaft": "user"},
        current={"topic": _STATES, "source": "effort"},
    )
    bridge = Bridge(mapping, description, BridgeSettings())
    rows = {
        "position": telemetry.position,
        "velocity": telemetry.speed * description.parameters.tau,
        "effort": telemetry.current,
    }
    # A loop publishes late by most of its period, and what it publishes is received later still.
    rng, h_ns = np.random.default_rng(0), 1e9 * description.sample_period
    stamps = _START_NS + telemetry.stamps_ns
    sent = stamps + rng.uniform(0.0, 0.8 * h_ns, len(telemetry)).astype(np.int64)
    delays = rng.uniform(0.0, _LATEST_S * 1e9, len(telemetry)).astype(np.int64)
    received = np.maximum.accumulate(sent + delays)
    blocks: list[Telemetry] = []
    times = zip(stamps.tolist(), sent.tolist(), received.tolist(), strict=True)
    for i, (stamp_ns, sent_ns, received_ns) in enumerate(times):
        header = SimpleNamespace(
            stamp=SimpleNamespace(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        )
        values: dict[str, Any] = {key: [row[i]] if len(row) else [] for key, row in rows.items()}
        state = SimpleNamespace(header=header, name=["flap"], **values)
        command = SimpleNamespace(data=telemetry.command[i])
        bridge.add(_COMMANDS, command, sent_ns - 1000, received_ns)
        bridge.add(_STATES, state, sent_ns, received_ns)
        if i % 10 == 0:
            blocks += bridge.advance()
    last_ns = int(received[-1]) + 1000
    bridge.add(_COMMANDS, SimpleNamespace(data=0.0), last_ns, last_ns)
    blocks += bridge.advance()
    if bridge.description is None or bridge.refused:
        raise RuntimeError(f"the bridge gives nothing: {[str(item) for item in bridge.refused]}")
    _same(bridge.description, description)
    return blocks


ROUTES: Final[dict[str, Callable[[Telemetry, ActuatorDescription], list[Telemetry]]]] = {
    "none": by_nothing,
    "table": by_table,
    "topics": by_topics,
}
"""Ways by name."""


def _mapping(acquisition: Acquisition, **sections: Any) -> Mapping:
    sections["current"] |= {"sampling": acquisition.current}
    if acquisition.current_filter:
        sections["current"]["filter_time"] = acquisition.current_filter
    missing = acquisition.missing
    return mapping_from({name: item for name, item in sections.items() if name not in missing})


def _same(found: ActuatorDescription, expected: ActuatorDescription) -> None:
    """Refuse a description that another rate or acquisition was found for."""
    if found != expected:
        raise RuntimeError(f"found {found}, expected {expected}")


def is_whole(blocks: Sequence[Telemetry]) -> bool:
    """Return whether nothing is missing between blocks."""
    return all(b.first_index == a.first_index + len(a) for a, b in pairwise(blocks))
