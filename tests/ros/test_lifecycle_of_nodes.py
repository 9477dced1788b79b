# SPDX-License-Identifier: Apache-2.0
"""Each real node makes every transition twice, and ends cleanly during its imports."""

import shutil
import signal
import subprocess
from pathlib import Path
from typing import Any, cast

import pytest
import yaml
from rclpy.lifecycle import TransitionCallbackReturn

from ema_cli.processes.bringup import NODES, node_class, program

from ..waiting import DEADLINE_S, started, wait_for
from .spinning import Spinning
from .test_bridge_node import JOINT_STATE

SAMPLE = Path(__file__).parents[2] / "bags" / "faulty_flap.mcap"


@pytest.mark.parametrize("name", [*NODES, "ema"])
def test_program_that_is_interrupted_while_it_imports_ends_without_a_traceback(name: str):
    command = [program(name)] if name in NODES else [shutil.which("ema"), "estimate", SAMPLE]
    with started([str(word) for word in command], stderr=subprocess.PIPE) as running:
        loaded = Path(f"/proc/{running.pid}/maps")
        wait_for(lambda: "/numpy/" in loaded.read_text(encoding="utf-8"), "the imports")
        running.send_signal(signal.SIGINT)
        _, printed = running.communicate(timeout=DEADLINE_S)
    assert (running.returncode, printed) == (-signal.SIGINT, b"")


@pytest.mark.parametrize("name", NODES)
def test_each_node_passes_all_transitions_twice(
    graph: Spinning, tmp_path: Path, capfd: Any, name: str
):
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(yaml.safe_dump(JOINT_STATE))
    parameters: dict[str, Any] = {
        "bridge": {"mapping_file": str(mapping)},
        "monitor": {"history_folder": str(tmp_path / "history")},
        "player": {"bag": str(SAMPLE), "stay": True},
        "recorder": {"output": str(tmp_path / "bag"), "overwrite": True},
        "dashboard": {"port": 0},
    }
    node = graph.managed(cast(Any, node_class(name)), **parameters.get(name, {}))
    for trigger, state in [
        *((node.trigger_configure, "inactive"), (node.trigger_activate, "active")),
        *((node.trigger_deactivate, "inactive"), (node.trigger_activate, "active")),
        *((node.trigger_deactivate, "inactive"), (node.trigger_cleanup, "unconfigured")),
    ] * 2:
        assert trigger() == TransitionCallbackReturn.SUCCESS
        assert node.state == state
    printed = capfd.readouterr().err
    assert not any(word in printed for word in ("Traceback", "[ERROR]", "[FATAL]")), printed
