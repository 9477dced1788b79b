# SPDX-License-Identifier: Apache-2.0
"""Each import contract of the repository fails for an import that breaks it."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from ..packages import FOLDERS

ROOT = Path(__file__).parents[2]
PACKAGES = {name for name, folder in FOLDERS.items() if (folder / "setup.py").exists()}
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
CONTRACTS = {item["name"]: item for item in SETTINGS["tool"]["importlinter"]["contracts"]}
LAYERS = "packages know those below them"
CIRCLES = "no circle between the files or folders of a package"

FORBIDDEN = {
    "ema_core is numerics and data": ("ema_core.added", "scipy"),
    "simulator and monitor need neither ROS nor matplotlib, but for nodes and pictures": (
        "ema_monitor.added",
        "matplotlib",
    ),
    "recordings for the monitor need no ROS": ("ema_monitor.recordings.added", "rclpy"),
    "optimizers do not know what an actuator is": (
        "ema_monitor.optimizers.added",
        "ema_core.faults",
    ),
    "inputs from files need no ROS": ("ema_bags.inputs.added", "rclpy"),
    "the archive needs no ROS": ("ema_archive.added", "rclpy"),
    "what nodes share knows no package of them": ("ema_ros.added", "ema_sim"),
    "the study works without ROS": ("ema_study.added", "rclpy"),
    "nothing imports the study but its command": ("ema_cli.added_reader", "ema_study.run"),
    "the study's files know those before them, in the order of the data": (
        "ema_study.cases",
        "ema_study.run",
    ),
    "the dashboard shows messages and estimates nothing": ("ema_dashboard.added", "numpy"),
    LAYERS: ("ema_bags.added", "ema_monitor.monitor"),
    "no file imports a package that contains it": ("ema_cli.added", "ema_cli"),
    "in the monitor node, what receives knows what works, which knows what publishes": (
        "ema_monitor.node.publish.added",
        "ema_monitor.node.work",
    ),
    "the monitor's folders know those before them, in the order of the data": (
        "ema_monitor.windows.added",
        "ema_monitor.unit",
    ),
}
"""A module and an import that breaks a contract, by the name of the contract."""


@pytest.fixture(scope="module")
def broken(tmp_path_factory) -> dict[str, str]:
    """Reports of the contracts, by name, with the imports of ``FORBIDDEN`` added.

    A cycle of two modules of ``ema_sim`` is added as well. Imports under TYPE_CHECKING count.
    """
    folder = tmp_path_factory.mktemp("contracts")
    skipped = shutil.ignore_patterns("web", "page", "__pycache__")
    for name in PACKAGES:
        shutil.copytree(FOLDERS[name] / name, folder / name, ignore=skipped)
    shutil.copytree(ROOT / "tools", folder / "tools", ignore=skipped)
    shutil.copy(ROOT / "pyproject.toml", folder)
    circle = [("ema_sim.first", "ema_sim.second"), ("ema_sim.second", "ema_sim.first")]
    for module, imported in (*FORBIDDEN.values(), *circle):
        text = f"from typing import TYPE_CHECKING\n\nif TYPE_CHECKING:\n    import {imported}\n"
        path = folder / f"{module.replace('.', '/')}.py"
        with path.open("a", encoding="utf-8") as file:
            file.write(text)
    done = subprocess.run(
        [Path(sys.executable).parent / "lint-imports", "--no-cache", "--no-logo"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), "COLUMNS": "200"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1, done.stdout + done.stderr
    _, *parts = re.split(r"^(.+)\n-+\n", done.stdout, flags=re.MULTILINE)
    return dict(zip(parts[::2], parts[1::2], strict=True))


@pytest.mark.parametrize("name", FORBIDDEN)
def test_contract_fails_on_a_forbidden_import(broken, name):
    module, imported = FORBIDDEN[name]
    assert re.search(rf"{module} -> {imported}\b", broken[name])


def test_contract_fails_on_a_circle(broken):
    assert "No cycles are allowed in ema_sim." in broken[CIRCLES]


def test_contracts_cover_all_packages_and_are_tested():
    assert set(SETTINGS["tool"]["importlinter"]["root_packages"]) == PACKAGES
    layered = {name for layer in CONTRACTS[LAYERS]["layers"] for name in layer.split(" | ")}
    assert layered == PACKAGES
    assert set(CONTRACTS[CIRCLES]["ancestors"]) == PACKAGES
    assert CONTRACTS.keys() == {*FORBIDDEN, CIRCLES}
