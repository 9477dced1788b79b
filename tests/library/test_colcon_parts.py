# SPDX-License-Identifier: Apache-2.0
"""``colcon test`` of a package needs only the declared packages of this project."""

import ast
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

import pytest

from ..packages import FOLDERS, ROOT
from .test_package_files import parts

Function = ast.FunctionDef | ast.AsyncFunctionDef


def files_of(folder: Path, root: Path) -> list[Path]:
    """Return the test files that ``colcon test`` runs for a package."""
    paths = [root / "tests" / part for part in parts(folder)]
    return [
        file for path in paths for file in ([path] if path.is_file() else path.rglob("test_*.py"))
    ]


def imported(path: Path, statements: list[ast.AST], root: Path) -> Iterator[str]:
    """Yield the full names of imported modules, and of the objects imported from modules."""
    for item in statements:
        if isinstance(item, ast.Import):
            yield from (alias.name for alias in item.names)
        elif isinstance(item, ast.ImportFrom):
            levels = path.relative_to(root).parts[: -item.level] if item.level else ()
            module = ".".join([*levels, *([item.module] if item.module else [])])
            yield from (f"{module}.{alias.name}" for alias in item.names)


def needed(folder: Path, root: Path = ROOT) -> dict[str, set[str]]:
    """Return the packages of this project that a package's tests import, with the importing files.

    These are the package's tests, their conftest files, and the modules of ``tests`` that they
    import. Imports within a fixture count if a test requests the fixture.
    """
    importers: dict[str, set[str]] = {}
    tests = files_of(folder, root)
    conftests = {parent / "conftest.py" for path in tests for parent in path.parents}
    files = [*tests, *(path for path in conftests if path.exists())]
    requested, seen = set[str](), set[Path]()
    fixtures: list[tuple[Path, Function]] = []

    def visit(path: Path, nodes: list[ast.AST]) -> None:
        for name in imported(path, nodes, root):
            package = name.partition(".")[0]
            if package in FOLDERS:
                importers.setdefault(package, set()).add(str(path.relative_to(root)))
            for module in (name, name.rpartition(".")[0]):
                file = root.joinpath(*module.split(".")).with_suffix(".py")
                if package == "tests" and file.exists():
                    files.append(file)

    while files:
        path = files.pop()
        if path in seen:
            continue
        seen.add(path)
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        functions = [
            node for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        ]
        lazy: set[ast.AST] = set()
        for node in functions:
            if any(".fixture" in ast.unparse(item) for item in node.decorator_list):
                fixtures.append((path, node))
                lazy |= set(ast.walk(node))
            elif path in tests and node.name.startswith("test"):
                requested |= {item.arg for item in node.args.args}
        visit(path, [node for node in nodes if node not in lazy])
        # All tests request an autouse fixture.
        wanted = [
            (path, node)
            for path, node in fixtures
            if node.name in requested
            or "autouse=True" in "".join(map(ast.unparse, node.decorator_list))
        ]
        while wanted:
            place, node = wanted.pop()
            fixtures.remove((place, node))
            requested |= {item.arg for item in node.args.args}
            visit(place, list(ast.walk(node)))
            wanted += [
                item for item in fixtures if item[1].name in requested and item not in wanted
            ]
    return importers


def declared(package: str, tags: set[str]) -> set[str]:
    """Return the packages of this project in a package.xml, and the package itself."""
    root = ElementTree.parse(FOLDERS[package] / "package.xml").getroot()
    return {item.text or "" for item in root if item.tag in tags} & {*FOLDERS} | {package}


TAGS = {"depend", "exec_depend", "build_depend", "test_depend"}


@pytest.mark.parametrize("package", FOLDERS)
def test_tests_of_a_package_import_only_declared_packages(package: str):
    imports = needed(FOLDERS[package])
    assert {name: imports[name] for name in imports.keys() - declared(package, TAGS)} == {}


@pytest.mark.parametrize("package", FOLDERS)
def test_each_declared_package_of_tests_is_imported(package: str):
    assert declared(package, {"test_depend"}) <= {*needed(FOLDERS[package]), package}


def test_dependencies_have_no_circle():
    left = {name: declared(name, TAGS) - {name} for name in FOLDERS}
    while ready := [name for name, needs in left.items() if not needs & left.keys()]:
        for name in ready:
            del left[name]
    assert left == {}


def test_imports_are_found_in_files_modules_and_requested_fixtures(tmp_path: Path):
    """They are found in tests, modules, conftest files and requested fixtures only."""
    folder = tmp_path / "ema_core"
    for path, text in {
        "ema_core/setup.py": "",
        "ema_core/test/conftest.py": 'PARTS = ("core",)',
        "tests/conftest.py": "import ema_bags\nfrom . import shared\n",
        "tests/shared.py": "from ema_sim import simulate\n",
        "tests/core/conftest.py": """
import pytest
@pytest.fixture
def estimates(windows): import ema_study
@pytest.fixture
def windows(): from .windows import found
@pytest.fixture
def other(): import ema_cli
""",
        "tests/core/windows.py": "import ema_monitor.windows\n",
        "tests/core/test_one.py": """
from ema_core.faults import N_FAULTS
def test_faults(estimates): assert estimates(other=N_FAULTS)
""",
        "tests/sim/test_two.py": "import ema_dashboard\n",
    }.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text, encoding="utf-8")
    assert needed(folder, tmp_path) == {
        "ema_bags": {"tests/conftest.py"},
        "ema_core": {"tests/core/test_one.py"},
        "ema_monitor": {"tests/core/windows.py"},
        "ema_sim": {"tests/shared.py"},
        "ema_study": {"tests/core/conftest.py"},
    }
