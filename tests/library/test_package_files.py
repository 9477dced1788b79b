# SPDX-License-Identifier: Apache-2.0
"""Shared files of the packages are up to date, and ``colcon test`` finds tests in each package."""

import importlib.util
import re
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_share_directory
from setuptools.config.setupcfg import read_configuration

from ..packages import FOLDERS, ROOT

TOOL = ROOT / "tools" / "package_files.py"
OF_ALL_PACKAGES = {"attacks", "docs", "harness", "library"}
"""Folders of tests that belong to no package."""


@pytest.fixture(scope="module")
def package_files():
    spec = importlib.util.spec_from_file_location("package_files", TOOL)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def parts(folder: Path) -> list[str]:
    """Return the files and folders of tests that ``colcon test`` runs for a package."""
    if (folder / "setup.py").exists():
        namespace: dict[str, object] = {}
        exec((folder / "test" / "conftest.py").read_text(encoding="utf-8"), namespace)
        return list(namespace["PARTS"])  # pyright: ignore[reportCallIssue, reportArgumentType]
    text = (folder / "CMakeLists.txt").read_text(encoding="utf-8")
    return re.findall(r"ament_add_pytest_test\(\w+ \$\{TESTS\}/(\S+)\)", text)


def test_shared_files_are_up_to_date(package_files):
    outdated = [
        path
        for path, content in package_files.files().items()
        if path.read_text(encoding="utf-8") != content
    ]
    assert outdated == []


def test_owner_is_the_same_in_all_packages_after_a_change(package_files):
    owner = {
        "license": "MIT",
        "authors": [{"name": "An Author"}],
        "contact": [{"name": "B & C", "email": "b@example.org"}],
        "url": "https://example.org/elsewhere",
    }
    for folder in FOLDERS.values():
        text = package_files.package_xml((folder / "package.xml").read_text(), owner)
        assert text.count('<maintainer email="b@example.org">B &amp; C</maintainer>') == 1
        assert text.count('<license file="LICENSE">MIT</license>') == 1
        assert text.count("<author>An Author</author>") == 1
        assert text.count("elsewhere</url>") == 1
        assert "Apache" not in text
        assert "</description>" in text
        assert text.count("depend>") == (folder / "package.xml").read_text().count("depend>")


def test_changelog_entries_of_markdown_become_restructured_text(package_files):
    text = """# Changelog

## 2.0.0

A line.

### Page, metrics and access
- The `page` shows `f(x)`s of
  [the fleet](docs/fleet.md) * 2.
- The dashboard is not named here. <!-- ema_cli -->

## 1.0.0 (2026-01-01)

- Elsewhere. <!-- repository -->
- A page, with `ema_sim`
  next to it. <!-- ema_cli ema_dashboard -->
- An actuator whose page is elsewhere. <!-- ema_sim -->
"""
    releases = list(package_files._releases(text))
    assert package_files.changelog("ema_dashboard", releases).splitlines()[4:] == [
        *("Forthcoming", "-----------"),
        "* The ``page`` shows ``f(x)``\\ s of the fleet \\* 2.",
        *("", "1.0.0 (2026-01-01)", "------------------"),
        "* A page, with ``ema_sim`` next to it.",
    ]


@pytest.mark.parametrize(
    ("entry", "owners"),
    [
        ("- An entry.", r"\[\]"),
        ("- An entry. <!-- ema_simulation -->", r"\['ema_simulation'\]"),
        ("- An entry. <!-- ema_sim and ema_cli -->", r"\['and', 'ema_cli', 'ema_sim'\]"),
    ],
)
def test_changelog_entry_without_a_package_is_refused(package_files, entry, owners):
    text = f"# Changelog\n\n## 1.0.0 (2026-01-01)\n\n{entry}\n"
    with pytest.raises(ValueError, match=rf"'An entry\.' has the owners {owners}: end the entry"):
        list(package_files._releases(text))


@pytest.mark.parametrize("package", FOLDERS)
def test_colcon_finds_tests(package):
    folder = FOLDERS[package]
    assert parts(folder)
    for part in parts(folder):
        path = ROOT / "tests" / part
        assert path.is_file() or list(path.glob("test_*.py"))
    if (folder / "setup.py").exists():
        extras = read_configuration(folder / "setup.cfg")["options"]["extras_require"]
        # colcon runs pytest only with this extra.
        assert extras["test"][:2] == ["pytest>=9,<10", "pytest-xdist>=3.8,<4"]


def test_each_folder_of_tests_belongs_to_a_package():
    folders = {path.parent.name for path in (ROOT / "tests").glob("*/test_*.py")}
    run = {part.partition("/")[0] for folder in FOLDERS.values() for part in parts(folder)}
    assert folders - OF_ALL_PACKAGES == run


@pytest.mark.parametrize("package", FOLDERS)
def test_licence_is_installed(package):
    installed = Path(get_package_share_directory(package)) / "LICENSE"
    assert installed.read_text(encoding="utf-8") == (ROOT / "LICENSE").read_text(encoding="utf-8")
