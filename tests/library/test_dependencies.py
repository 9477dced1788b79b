# SPDX-License-Identifier: Apache-2.0
"""What each package imports is what its setup.cfg and package.xml declare."""

import ast
import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.package_version import get_forthcoming_label, update_changelog_sections
from catkin_pkg.packages import find_packages
from packaging.requirements import Requirement
from setuptools.config.setupcfg import read_configuration

from ..packages import FOLDERS

ROOT = Path(__file__).parents[2]
PACKAGES = sorted(name for name, folder in FOLDERS.items() if (folder / "setup.py").exists())
DISTRIBUTIONS = {
    "yaml": "pyyaml",
    "sklearn": "scikit-learn",
    "prometheus_client": "prometheus-client",
}
WITHOUT_KEY = {
    *("distributed", "duckdb", "fsspec", "llvmlite", "markupsafe", "mcap", "pyarrow", "zstandard")
}
"""Modules without a key in rosdistro: pip installs them, mcap with lz4."""

KEYS = {
    "yaml": "python3-yaml",
    "prometheus_client": "python3-prometheus-client",
    "rosbags": "python3-rosbags-pip",
}
"""Keys of rosdep that are not ``python3-`` and the name of the module."""


def is_ros(module: str) -> bool:
    return module in ("rclpy", "ament_index_python") or module.endswith(
        ("_msgs", "_srvs", "_interfaces")
    )


def is_node(path: Path) -> bool:
    """Whether a module is for nodes only, as the import contracts have it."""
    return path.stem.endswith("_node") or path.parent.name == "node"


def imports_of(path: Path) -> set[str]:
    """Return the top-level modules that a file imports, without the standard library."""
    modules = set()
    for item in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(item, ast.Import):
            modules |= {alias.name.partition(".")[0] for alias in item.names}
        elif isinstance(item, ast.ImportFrom) and item.module:
            modules.add(item.module.partition(".")[0])
    return modules - sys.stdlib_module_names


def imports(package: str, *, nodes: bool) -> set[str]:
    """Return the modules from elsewhere that a package imports, with its nodes or without."""
    files = (FOLDERS[package] / package).rglob("*.py")
    modules = (imports_of(path) for path in files if nodes or not is_node(path))
    return set().union(*modules) - {package}


def dependencies(package: str) -> set[str]:
    """Return what a package.xml declares for running."""
    root = ElementTree.parse(FOLDERS[package] / "package.xml").getroot()
    return {item.text or "" for item in root.iter("exec_depend")}


def requirements(package: str) -> list[Requirement]:
    """Return what a setup.cfg requires, extras included."""
    declared = read_configuration(FOLDERS[package] / "setup.cfg")["options"]
    extras = declared.get("extras_require", {}).values()
    return [Requirement(one) for every in (declared["install_requires"], *extras) for one in every]


@pytest.mark.parametrize("package", PACKAGES)
def test_setup_requires_what_is_imported_without_ros(package):
    imported = {name for name in imports(package, nodes=False) if not is_ros(name)}
    expected = {DISTRIBUTIONS.get(name, name) for name in imported}
    assert {item.name for item in requirements(package)} == expected


@pytest.mark.parametrize("package", PACKAGES)
def test_package_depends_on_what_is_imported(package):
    expected = {
        name if is_ros(name) or name.startswith("ema_") else KEYS.get(name, f"python3-{name}")
        for name in imports(package, nodes=True) - WITHOUT_KEY
    }
    # Its parameter files are found by name rather than imported.
    assert dependencies(package) == expected


def test_bringup_depends_on_what_launch_files_import_and_start():
    files = list((FOLDERS["ema_bringup"] / "launch").glob("*.py"))
    texts = [path.read_text(encoding="utf-8") for path in files]
    started = {name for text in texts for name in re.findall(r'"(ema_\w+)"', text)}
    imported = set().union(*map(imports_of, files))
    expected = (started | imported) - {"ema_bringup", *(path.stem for path in files)}
    assert dependencies("ema_bringup") == expected


def test_document_has_the_pip_line_of_what_rosdep_does_not_know():
    text = (ROOT / "docs" / "nodes.md").read_text(encoding="utf-8")
    [line] = re.findall(r"^ *pip install --break-system-packages (.+)$", text, re.MULTILINE)
    assert set(line.split()) == WITHOUT_KEY


def test_clone_in_a_workspace_has_each_package_once():
    # As rosdep looks for them: it stops at a name that is there twice.
    packages = find_packages(ROOT)
    assert {item.name: ROOT / path for path, item in packages.items()} == FOLDERS
    for item in packages.values():
        item.validate()


@pytest.mark.filterwarnings("ignore:nodes.Node.traverse:DeprecationWarning")
@pytest.mark.parametrize("package", FOLDERS)
def test_package_has_a_changelog_that_a_release_takes(package, tmp_path):
    copy = tmp_path / "CHANGELOG.rst"
    changelog = get_changelog_from_path(str(FOLDERS[package]))
    assert changelog is not None
    # What catkin_prepare_release does, and then bloom.
    label = get_forthcoming_label(changelog.rst)
    update_changelog_sections({package: (copy, changelog, label)}, "9.9.9")
    released = get_changelog_from_path(str(copy))
    assert released is not None
    [(version, _, content)] = released.foreach_version()
    assert (version, len(content)) == ("9.9.9", 1)


def test_bounds_are_the_same_everywhere_and_hold_for_the_lock():
    lock = {}
    for line in (ROOT / "requirements" / "lock.txt").read_text(encoding="utf-8").splitlines():
        name, separator, version = line.partition("==")
        if separator:
            lock[name] = version.split()[0]
    bounds: dict[str, str] = {}
    for item in (item for package in PACKAGES for item in requirements(package)):
        if not item.name.startswith("ema_"):
            assert bounds.setdefault(item.name, str(item.specifier)) == str(item.specifier)
            assert item.specifier.contains(lock[item.name])
