# SPDX-License-Identifier: Apache-2.0
"""``make colcon-test`` fails if a package has no test; colcon alone would report success."""

import subprocess
import sys
from pathlib import Path

import pytest

from ..packages import FOLDERS, ROOT

TOOL = ROOT / "tools" / "colcon_results.py"


def checked(results: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, TOOL], input=results, capture_output=True, text=True)


def colcon_results(folder: Path, tests: dict[str, int]) -> str:
    """Return the output of colcon for JUnit files with these numbers of tests by package."""
    (folder / "build").mkdir()
    for package, number in tests.items():
        path = folder / "build" / package / "pytest.xml"
        path.parent.mkdir(parents=True)
        path.write_text(
            f'<testsuites><testsuite name="pytest" tests="{number}" errors="0" failures="0" '
            f'skipped="0">{"<testcase/>" * number}</testsuite></testsuites>'
        )
    command = [sys.executable, "-m", "colcon", "--log-base", folder / "log", "test-result", "--all"]
    listed = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    return listed.stdout


def test_tests_of_all_packages_pass(tmp_path: Path):
    result = checked(colcon_results(tmp_path, dict.fromkeys(FOLDERS, 3)))
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.parametrize("tests", [{}, {"ema_core": 0}])
def test_package_without_tests_is_named(tmp_path: Path, tests: dict[str, int]):
    counts = dict.fromkeys(FOLDERS.keys() - {"ema_core"}, 1)
    result = checked(colcon_results(tmp_path, counts | tests))
    assert result.returncode == 1
    assert result.stderr.startswith("colcon test has run no test of ema_core: each of the 11 ")


def test_call_of_pytest_by_ctest_does_not_count_as_a_test(tmp_path: Path):
    results = colcon_results(tmp_path, dict.fromkeys(FOLDERS, 1))
    called = results.replace("ema_interfaces/pytest.xml", "ema_interfaces/Testing/1/Test.xml")
    assert called != results
    assert "no test of ema_interfaces:" in checked(called).stderr


def test_without_results_every_package_is_named(tmp_path: Path):
    result = checked(colcon_results(tmp_path, {}))
    assert result.returncode == 1
    assert all(package in result.stderr for package in FOLDERS)
