# SPDX-License-Identifier: Apache-2.0
"""Launch files, checked by their source, and by the parser of launch where it is installed."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from ament_index_python.packages import get_package_share_directory

from ..packages import FOLDERS

PACKAGE = FOLDERS["ema_bringup"]
LAUNCH_FILES = sorted((PACKAGE / "launch").glob("*.py"))
MODULES = sorted((PACKAGE / "ema_bringup").glob("*.py"))
IMPORTED = {"ament_index_python", "ema_bringup", "ema_core", "ema_ros", "launch", "launch_ros"}
STANDARD = {"atexit", "collections", "pathlib", "shutil", "sys", "tempfile", "typing"}


def imported(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (item.name.partition(".")[0] for item in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            yield str(node.module).partition(".")[0]


@pytest.mark.parametrize("path", LAUNCH_FILES + MODULES, ids=lambda path: path.name)
def test_launch_files_import_installed_packages_only_and_no_command(path: Path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert set(imported(tree)) <= IMPORTED | STANDARD
    changes_path = [
        node for node in ast.walk(tree) if isinstance(node, ast.Attribute) and node.attr == "path"
    ]
    assert changes_path == []


def test_each_file_of_the_folder_is_a_launch_file():
    assert LAUNCH_FILES
    assert [path.name for path in LAUNCH_FILES if not path.name.endswith(".launch.py")] == []
    assert MODULES


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_parser_of_launch_reads_plain_defaults_and_starts_nodes(path: Path, tmp_path: Path):
    launch: Any = pytest.importorskip("launch")
    sources: Any = pytest.importorskip("launch.launch_description_sources")
    actions: Any = pytest.importorskip("launch_ros.actions")
    installed = Path(get_package_share_directory("ema_bringup"), "launch", path.name)
    context = launch.LaunchContext()
    description = sources.PythonLaunchDescriptionSource(str(installed)).get_launch_description(
        context
    )
    for argument in description.get_launch_arguments():
        assert argument.description
        for part in argument.default_value or ():
            assert isinstance(part, launch.substitutions.TextSubstitution), argument.name
    context.launch_configurations["bag"] = str(tmp_path / "worn")
    nodes = []
    for entity in description.entities:
        made = entity.visit(context) or ()
        nodes += [item for item in made if isinstance(item, actions.Node)]
    assert nodes
