# SPDX-License-Identifier: Apache-2.0
"""A bag gives the same estimates offline and when replayed at any rate into a new monitor."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_bags.writer import BagWriter
from ema_cli.bags.identifying import Identifying
from ema_cli.bags.reading import ReadingOptions, read_windows
from ema_core.commands import THESIS_CHIRP, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_core.telemetry import COLUMNS, Telemetry
from ema_interfaces.msg import FaultEstimate
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.node.publish.messages import estimate_to_message
from ema_monitor.windows.trigger import TriggerSettings
from ema_sim.actuator import SimulatedActuator

from .graph import Graph

REST = 110_000


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bag with four windows: a good one, one with a gap, a good one, and one cut off by the end.

    The telemetry at rest before them exceeds any queue: a receiver that falls behind loses some.
    """
    actuator = SimulatedActuator()
    actuator.faults = fault_vector({"friction": 0.2, "backlash": 0.1, "eccentricity": 0.1})
    cycle = build_cycle(THESIS_CHIRP, 1e-4)
    cycles = np.tile(cycle.samples, 4)[: 3 * len(cycle.samples) + cycle.start + 2000]
    moving = actuator.advance(cycles)
    # All columns are zero before the motion.
    columns = (np.concatenate([np.zeros(REST), getattr(moving, name)]) for name in COLUMNS)
    whole = Telemetry(moving.stamp_ns, 1e-4, moving.first_index, *columns)
    blocks = [whole.part(n, min(n + 100, len(whole))) for n in range(0, len(whole), 100)]
    lost = (REST + len(cycle.samples) + cycle.start + 1000) // 100
    path = tmp_path_factory.mktemp("bags") / "four.mcap"
    with SimulatedActuatorBag(BagWriter(path), ActuatorDescription()) as recording:
        for number, block in enumerate(blocks):
            if number != lost:
                recording.write_block(block, 0.0)
    return path


def plain(message: Any) -> dict[str, Any]:
    """Return all fields of a message but the computing time, with floats as bytes."""
    values = {}
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        if hasattr(value, "get_fields_and_field_types"):
            value = plain(value)
        elif isinstance(value, np.ndarray | float):
            value = np.asarray(value).tobytes()
        values[name] = value
    values.pop("computing_time", None)
    return values


@pytest.fixture(scope="module")
def expected(bag: Path) -> list[FaultEstimate]:
    """Estimates of `ema estimate`, as messages."""
    windows = read_windows(bag, ReadingOptions(trigger=TriggerSettings()))
    estimates = Identifying().estimate(windows.windows, Calibration.builtin())
    return [
        estimate_to_message(estimate, item.number, item.description)
        for estimate, item in zip(estimates, windows.windows, strict=True)
    ]


def test_offline_command_reports_the_defects_of_two_windows(expected):
    assert [item.valid for item in expected] == [True, False, True, False]
    assert [item.warm_start for item in expected] == [False, False, True, False]
    assert "gap of 100 samples" in expected[1].reason
    assert "the telemetry ends" in expected[3].reason


@pytest.mark.slow
def test_replay_gives_the_estimates_of_the_offline_command(bag: Path, expected, tmp_path: Path):
    with Graph(tmp_path) as graph:
        graph.start("monitor", use_sim_time=True)
        graph.wait_for(lambda: graph.status, "the monitor")
        graph.start("player", bag=bag, rate=5.0, actuator_only=True)
        assert graph.exit_code("player") == 0, graph.log("player").read_text()
        graph.wait_for(lambda: len(graph.estimates) == 3, "three estimates")
        telemetry = "/ema/monitor: flap telemetry"
        graph.wait_for(
            lambda: graph.status[telemetry].values["samples lost"] == "100", "the lost samples"
        )
        # The end of the telemetry shows only when the monitor ends.
        assert graph.stop("monitor") == 0
        graph.wait_for(lambda: len(graph.estimates) == 4, "the refusal of the last window")
    replayed = sorted(graph.estimates, key=lambda item: item.window)
    assert [plain(item) for item in replayed] == [plain(item) for item in expected]
