# SPDX-License-Identifier: Apache-2.0
"""Progress without a terminal: lines on standard error, with the time left."""

import json
import re

import pytest

from ema_cli import progress

from ..commands import SAMPLE, ema, without_progress


@pytest.fixture(autouse=True)
def _impatient(monkeypatch):
    monkeypatch.setattr(progress, "FIRST_LINE_S", 0.001)
    monkeypatch.setattr(progress, "LINES_S", 0.001)


def test_long_command_reports_its_progress_and_the_time_left(tmp_path):
    printed = ema("simulate", "--cycles", "6", "-o", tmp_path / "six.mcap")
    line = r"simulating: \d+%, cycle \d of 6, about \d+ s left"
    assert re.search(f"^{line}$", printed.stderr, re.MULTILINE), printed.stderr
    assert "left" not in printed.stdout


def test_progress_is_distinct_from_other_output(tmp_path):
    printed = ema("simulate", "--cycles", "6", "-o", tmp_path / "six.mcap")
    assert "left" in printed.stderr
    assert without_progress(printed.stderr + "Error: it is left\n") == "Error: it is left\n"


def test_standard_output_has_only_the_json():
    printed = ema("estimate", SAMPLE, "--json")
    assert json.loads(printed.stdout)
    assert re.search(r"^identifying: .* so far$", printed.stderr, re.MULTILINE), printed.stderr


@pytest.mark.parametrize(
    ("passed_s", "words"), [(20.0, "60 s left"), (60.0, "3 min left"), (3600.0, "3 h left")]
)
def test_time_left_is_reported_in_a_suitable_unit(passed_s, words, monkeypatch):
    monkeypatch.setattr(progress.time, "monotonic", lambda: 0.0)
    lines = progress._Lines()
    lines.advance(lines.add_task("learning", total=4))
    monkeypatch.setattr(progress.time, "monotonic", lambda: passed_s)
    assert str(lines) == f"learning: 25%, about {words}"
