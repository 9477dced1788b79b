# SPDX-License-Identifier: Apache-2.0
"""Imports, setup.cfg and package.xml of each package agree with the files in requirements."""

import ast
import re
import shutil
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
WORKSPACE = ROOT / "requirements" / "workspace.txt"
PACKAGES = sorted(name for name, folder in FOLDERS.items() if (folder / "setup.py").exists())
DISTRIBUTIONS = {
    "yaml": "pyyaml",
    "sklearn": "scikit-learn",
    "prometheus_client": "prometheus-client",
}
WITHOUT_KEY = {
    *("distributed", "duckdb", "fsspec", "llvmlite", "markupsafe", "mcap", "numba", "pyarrow"),
    *("rosbags", "zstandard"),
}
"""Modules that rosdep cannot install on Ubuntu 24.04.

rosdep has no key for them, no package for the key (numba), or a key for pip, which Ubuntu 24.04
refuses outside of a virtual environment.
"""

OPTIONAL = {"rosbag2_interfaces"}
"""Modules that are used only if they are installed."""

KEYS = {"prometheus_client": "python3-prometheus-client"}
"""Keys of rosdep that differ from ``python3-`` and the name of the module."""


RUNTIME = ROOT / "requirements" / "runtime.in"
NOT_LISTED = {"llvmlite", "markupsafe", "distributed"}
"""Packages whose version numba or jinja2 chooses, and the extra ``dask``, listed in ``dev.in``."""


def is_ros(module: str) -> bool:
    return module in ("rclpy", "ament_index_python") or module.endswith(
        ("_msgs", "_srvs", "_interfaces")
    )


def is_node(path: Path) -> bool:
    """Return whether a module is for nodes only, by the rule of the import contracts."""
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


def imports(folder: Path, *, nodes: bool) -> set[str]:
    """Return the external modules that a package imports, with or without its nodes."""
    files = (folder / folder.name).rglob("*.py")
    modules = (imports_of(path) for path in files if nodes or not is_node(path))
    return set().union(*modules) - {folder.name}


def dependencies(folder: Path) -> set[str]:
    """Return the run-time dependencies in a package.xml."""
    root = ElementTree.parse(folder / "package.xml").getroot()
    return {item.text or "" for item in root.iter("exec_depend")}


def requirements(folder: Path) -> list[Requirement]:
    """Return the run-time requirements in a setup.cfg, including extras."""
    declared = read_configuration(folder / "setup.cfg")["options"]
    extras = [lines for name, lines in declared["extras_require"].items() if name != "test"]
    return [
        Requirement(line) for group in (declared["install_requires"], *extras) for line in group
    ]


def disagreements(folder: Path, workspace: str) -> set[str]:
    """Return "FILE: NAME" for each dependency in which a file and the imports differ."""
    imported = {name for name in imports(folder, nodes=False) if not is_ros(name)}
    required = {item.name for item in requirements(folder)}
    modules = imports(folder, nodes=True) - OPTIONAL
    keys = {
        name if is_ros(name) or name.startswith("ema_") else KEYS.get(name, f"python3-{name}")
        for name in modules - WITHOUT_KEY
    }
    installed = {line.partition(">")[0] for line in workspace.splitlines()}
    distributions = {
        DISTRIBUTIONS.get(name, name) for name in imported if not name.startswith("ema_")
    }
    return {
        *(f"setup.cfg: {name}" for name in required ^ {DISTRIBUTIONS.get(n, n) for n in imported}),
        *(f"package.xml: {name}" for name in dependencies(folder) ^ keys),
        *(f"workspace.txt: {name}" for name in distributions - installed),
    }


@pytest.mark.parametrize("package", PACKAGES)
def test_dependencies_are_the_imports(package):
    workspace = WORKSPACE.read_text(encoding="utf-8")
    assert disagreements(FOLDERS[package], workspace) == set()


@pytest.mark.parametrize(
    ("file", "text", "expected"),
    [
        ("package.xml", "<exec_depend>python3-numpy</exec_depend>", "package.xml: python3-numpy"),
        ("setup.cfg", "mcap>=1.2,<2\n", "setup.cfg: mcap"),
        ("workspace.txt", "zstandard>=0.22,<1\n", "workspace.txt: zstandard"),
    ],
)
def test_omitted_dependency_is_named(tmp_path, file, text, expected):
    folder = tmp_path / "ema_bags"
    shutil.copytree(FOLDERS["ema_bags"], folder)
    shutil.copy(WORKSPACE, folder)
    assert text in (folder / file).read_text(encoding="utf-8")
    content = (folder / file).read_text(encoding="utf-8").replace(text, "")
    (folder / file).write_text(content, encoding="utf-8")
    workspace = (folder / "workspace.txt").read_text(encoding="utf-8")
    assert disagreements(folder, workspace) == {expected}


def test_dependency_that_nothing_imports_is_named(tmp_path):
    folder = tmp_path / "ema_bags"
    shutil.copytree(FOLDERS["ema_bags"], folder)
    for path in (folder / "ema_bags").rglob("*.py"):
        if "rosbags" in imports_of(path) or "pandas" in imports_of(path):
            path.unlink()
    expected = {"setup.cfg: rosbags", "setup.cfg: pandas", "package.xml: python3-pandas"}
    workspace = WORKSPACE.read_text(encoding="utf-8")
    assert disagreements(folder, workspace) == expected


def test_bringup_depends_on_what_launch_files_import_and_start():
    files = list(FOLDERS["ema_bringup"].glob("*/*.py"))
    texts = [path.read_text(encoding="utf-8") for path in files]
    started = {name for text in texts for name in re.findall(r'"(ema_\w+)"', text)}
    imported = set().union(*map(imports_of, files))
    expected = (started | imported) - {"ema_bringup"}
    assert dependencies(FOLDERS["ema_bringup"]) == expected


@pytest.mark.parametrize("package", FOLDERS)
def test_each_dependency_is_declared_once(package):
    root = ElementTree.parse(FOLDERS[package] / "package.xml").getroot()
    declared = [(item.tag, item.text) for item in root if item.tag.endswith("depend")]
    assert sorted(declared) == sorted(set(declared))


def test_workspace_requires_nothing_that_no_package_requires():
    names = {line.partition(">")[0] for line in WORKSPACE.read_text().splitlines()[1:]}
    required = {item.name for package in PACKAGES for item in requirements(FOLDERS[package])}
    assert names - {"pytest", "pytest-xdist", "mcap-ros2-support"} == {
        name for name in required if not name.startswith("ema_")
    }


def not_in_both(runtime: str) -> set[str]:
    """Return the distributions that are in ``runtime.in`` or in a setup.cfg, but not in both."""
    lines = (line.partition("#")[0].strip() for line in runtime.splitlines())
    pinned = {Requirement(line).name for line in lines if line}
    required = {item.name for package in PACKAGES for item in requirements(FOLDERS[package])}
    # mcap imports lz4 for bags that are compressed with it.
    return {name for name in required if not name.startswith("ema_")} ^ (pinned - {"lz4"})


def test_runtime_requirements_equal_the_requirements_of_packages():
    assert not_in_both(RUNTIME.read_text(encoding="utf-8")) == NOT_LISTED


@pytest.mark.parametrize(("line", "other"), [("duckdb==1.5.6\n", ""), ("rich==", "poor==")])
def test_runtime_requirement_that_differs_is_named(line: str, other: str):
    text = RUNTIME.read_text(encoding="utf-8")
    assert line in text
    names = {item.partition("==")[0] for item in (line, other) if item}
    assert not_in_both(text.replace(line, other)) == NOT_LISTED | names


def test_bounds_of_a_workspace_are_within_the_bounds_of_packages():
    bounds = {
        item.name: item.specifier for name in PACKAGES for item in requirements(FOLDERS[name])
    }
    for line in WORKSPACE.read_text(encoding="utf-8").splitlines()[1:]:
        item = Requirement(line)
        lowest = {bound.version for bound in item.specifier if bound.operator == ">="}
        if item.name in bounds:
            assert lowest == {
                bound.version for bound in bounds[item.name] if bound.operator == ">="
            }


def test_document_installs_the_requirements_of_a_workspace():
    text = (ROOT / "docs" / "nodes.md").read_text(encoding="utf-8")
    lines = re.findall(r"^ *pip install (.+)$", text, re.MULTILINE)
    assert lines == [f"-r src/ema/{WORKSPACE.relative_to(ROOT)}"]


def test_clone_in_a_workspace_has_each_package_once():
    # rosdep finds packages in the same manner, and stops at a duplicate name.
    packages = find_packages(ROOT)
    assert {item.name: ROOT / path for path, item in packages.items()} == FOLDERS
    for item in packages.values():
        item.validate()


@pytest.mark.filterwarnings("ignore:nodes.Node.traverse:DeprecationWarning")
@pytest.mark.parametrize("package", FOLDERS)
def test_package_has_a_changelog_that_release_tools_accept(package, tmp_path):
    copy = tmp_path / "CHANGELOG.rst"
    changelog = get_changelog_from_path(str(FOLDERS[package]))
    assert changelog is not None
    # The steps of catkin_prepare_release, and then of bloom.
    label = get_forthcoming_label(changelog.rst)
    update_changelog_sections({package: (copy, changelog, label)}, "9.9.9")
    released = get_changelog_from_path(str(copy))
    assert released is not None
    lists = {version: len(content) for version, _, content in released.foreach_version()}
    assert lists in ({"9.9.9": 1}, {"9.9.9": 1, "0.1.0": 1})


def test_bounds_are_the_same_everywhere_and_hold_for_the_lock():
    lock = {}
    for line in (ROOT / "requirements" / "lock.txt").read_text(encoding="utf-8").splitlines():
        name, separator, version = line.partition("==")
        if separator:
            lock[name] = version.split()[0]
    bounds: dict[str, str] = {}
    for item in (item for package in PACKAGES for item in requirements(FOLDERS[package])):
        if not item.name.startswith("ema_"):
            assert bounds.setdefault(item.name, str(item.specifier)) == str(item.specifier)
            assert item.specifier.contains(lock[item.name])
