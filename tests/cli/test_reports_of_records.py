# SPDX-License-Identifier: Apache-2.0
"""``ema report`` and ``ema predict`` on records that are compared with a baseline."""

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.monitor.comparisons import (
    CASES,
    EFFORT_UP,
    END_NS,
    FRICTION_UP,
    HEALTHY,
    HIDDEN,
    NOTHING,
    STILL,
    changed,
    compared,
    comparison,
    not_judged,
    unchanged,
)

from ema_cli.bags.identifying import Identifying
from ema_monitor.joint.comparison import Comparison, Improvement
from ema_monitor.quantities import FRICTION

from ..pages import Page

NO_FRICTION = comparison(not_judged(FRICTION))
COARSE = comparison(unchanged(FRICTION, 0.35))
IMPROVABLE = replace(COARSE, improvements=(Improvement(FRICTION, 2, 6, 0.06, 0.05),))
HOURS = ("--hours-per-cycle", "10")

Run = Callable[..., Any]


@pytest.fixture(scope="module")
def bag(ema, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bag") / "case.mcap"
    assert ema("simulate", "-o", path).exit_code == 0
    return path


@pytest.fixture
def run(ema, monkeypatch: pytest.MonkeyPatch, bag: Path) -> Run:
    """Return a function that runs a command on a bag whose records have given comparisons."""

    def command(name: str, of: Sequence[Comparison], *options: object) -> Any:
        estimates = [compared(item, END_NS + 10**11 * n) for n, item in enumerate(of)]
        monkeypatch.setattr(Identifying, "estimate", lambda *_: estimates)
        return ema(name, bag, *HOURS, *options)

    return command


@pytest.fixture
def report(run: Run, tmp_path: Path) -> Callable[..., tuple[Any, Page]]:
    def made(*of: Comparison) -> tuple[Any, Page]:
        result = run("report", of, "-o", tmp_path / "a.html", "--replace")
        return result, Page(tmp_path / "a.html")

    return made


@pytest.mark.parametrize(
    ("of", "state", "code"),
    [
        (HEALTHY, "Well: No quantity has changed: changes of Coulomb friction above 6 %", 0),
        (FRICTION_UP, "Changed: Coulomb friction rose 15.2 % (90 % interval 11.2 to 19.2 %).", 3),
        (EFFORT_UP, "Changed: Effort at the same motion rose 22.0 % (", 3),
        (NOTHING, "Unknown: ", 3),
        (NO_FRICTION, f"Unknown: Coulomb friction is not judged: {HIDDEN}", 3),
        (COARSE, "Unknown: only changes of Coulomb friction above 35 % would show; its warning", 3),
    ],
)
def test_first_line_follows_from_the_judgements(
    report: Callable[..., tuple[Any, Page]], of: Comparison, state: str, code: int
):
    result, _ = report(HEALTHY, of)
    assert result.stdout.startswith(state)
    assert result.exit_code == code


def test_unit_whose_records_judge_nothing_is_never_healthy(report):
    result, page = report(NOTHING, NOTHING)
    assert result.exit_code == 3
    first = result.stdout.splitlines()[0]
    assert first.startswith(f"Unknown: No quantity could be judged: {STILL}")
    assert "Repeat the record of" in " ".join(page.printed["li"])
    assert "1.00" not in result.stdout


def test_second_line_names_the_wear_or_why_it_is_unknown(report):
    lines = [report(HEALTHY, of)[0].stdout.splitlines()[1] for of in (HEALTHY, NO_FRICTION)]
    assert lines == [
        "No fault differs from healthy by more than its uncertainty.",
        f"Whether friction has grown is unknown: {HIDDEN}.",
    ]
    worn = report(*[FRICTION_UP] * 3)[0].stdout.splitlines()[1]
    assert worn.startswith("Friction 0.0")
    assert "dry friction 1.1" in worn


def test_index_of_an_earlier_record_is_not_shown_next_to_an_unknown_level(report):
    result, _ = report(HEALTHY, NOTHING)
    assert "health index unknown" in result.stdout


def test_page_has_the_table_the_smallest_change_and_how_to_lower_it(report):
    _, page = report(HEALTHY, IMPROVABLE)
    cells = page.printed["td"]
    assert "unchanged (changes above 35 % would show)" in cells
    assert "35 %" in cells
    assert "not judged (there is no position command)" in cells
    assert "smallest detectable change" in page.printed["th"]
    lowers = "6 further healthy records on 2 further days would lower"
    assert any(line.startswith(lowers) for line in page.printed["p"])
    assert any(line.startswith(lowers) for line in page.printed["li"])


@pytest.mark.parametrize("name", CASES)
def test_every_case_has_a_page(report, name: str):
    result, page = report(HEALTHY, CASES[name])
    assert "Traceback" not in result.stderr
    assert not re.search(r"\bnan\b", " ".join(page.printed["td"]))
    assert not {"short circuit A", "eccentricity", "gain"} & set(page.printed["th"])


def test_prognosis_tracks_friction_like_a_fault(run: Run):
    of = [comparison(changed(FRICTION, 0.03 * n)) if n > 1 else HEALTHY for n in range(14)]
    result = run("predict", of)
    assert "record that ended at 2023-11-14" in result.stdout
    assert "unchanged (changes above 10 % would show)" in result.stdout
    [row] = [line for line in result.stdout.splitlines() if line.split()[:1] == ["friction"]]
    assert " / " in row
    assert "short circuit A" not in result.stdout
    reported = json.loads(run("predict", of, "--json").stdout)
    assert reported["rul"]["known"]
    quantity = reported["tests"][-1]["comparison"]["quantities"][0]
    assert quantity["change"] == pytest.approx(0.39)


def test_prognosis_has_no_index_if_the_level_is_unknown(run: Run):
    result = run("predict", [HEALTHY, NO_FRICTION])
    assert result.exit_code == 3
    assert "health index unknown, level STALE (last OK)" in result.stdout
    assert (
        json.loads(run("predict", [HEALTHY, NO_FRICTION], "--json").stdout)["health_index"] is None
    )
