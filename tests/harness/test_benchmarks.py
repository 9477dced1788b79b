# SPDX-License-Identifier: Apache-2.0
"""Common parts of the benchmark scripts: a table of targets, JSON, and a summary of all."""

import json
import re
from pathlib import Path
from types import ModuleType

import pytest
from click.testing import CliRunner

from ..benchmarks import benchmark

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return benchmark("script")


@pytest.fixture(scope="module")
def targets() -> ModuleType:
    return benchmark("targets")


def test_summary_has_every_script_run_by_make_bench():
    recipe = (ROOT / "Makefile").read_text().partition("\nbench:")[2].partition("\n\n")[0]
    written = dict(re.findall(r"python (?:-m )?([\w.]+?)(?:\.py)? --json (\w+)\.json", recipe))
    assert len(written) > 15
    assert set(benchmark("summary").SCRIPTS) == set(written)
    # The summary expects a results file named after each script.
    assert all(file == name.rpartition(".")[2] for name, file in written.items())


def test_script_prints_its_targets_and_writes_its_results(script, targets, tmp_path):
    def measure(pool, size):
        """Print the size."""
        return {"size": size}

    def rows(figures):
        yield targets.at_most("size [m]", figures["size"], 3.0)

    main = script.command(measure, "sizes", rows, quick={"size": 2}, size=5)
    for options, size, met in (((), 5, "no"), (("--quick",), 2, "yes"), (("--size", "4"), 4, "no")):
        file = tmp_path / f"{size}.json"
        done = CliRunner().invoke(main, [*options, "--json", str(file)], catch_exceptions=False)
        assert re.search(rf"size \[m\] +│ <= 3 +│ {size}\.00 +│ {met} ", done.stdout)
        assert json.loads(file.read_text()) == {"size": size}


def test_missing_conditions_are_not_met(targets):
    assert not targets.all_of("tests", []).met
    assert targets.all_of("tests", [True, True]).met
