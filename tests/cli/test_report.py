# SPDX-License-Identifier: Apache-2.0
"""`ema report`: a self-contained page with the results of estimates and prognosis."""

import hashlib
import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from ema_core import __version__
from ema_core.faults import FAULT_NAMES
from ema_monitor.prognosis.events import Note, UnitEvent
from ema_monitor.prognosis.history import History, history_path
from ema_monitor.prognosis.history_entry import Assessment
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit

from ..commands import SAMPLE
from ..pages import Page
from ..prognosis.made_tests import made_test
from .conftest import TESTS


@pytest.fixture(scope="module")
def window(ema, tmp_path_factory) -> Page:
    path = tmp_path_factory.mktemp("report") / "window.html"
    assert ema("report", SAMPLE, "-o", path).exit_code == 0
    return Page(path)


@pytest.fixture(scope="module")
def loaded(ema, tmp_path_factory) -> Path:
    """Return a bag of three windows with friction, under a load, which is not a fault."""
    bag = tmp_path_factory.mktemp("loaded") / "loaded.mcap"
    arguments = ("--fault", "friction=0.2", "--cause", "load_torque=0.3", "--cycles", "3")
    assert ema("simulate", *arguments, "-o", bag).exit_code == 0
    return bag


@pytest.fixture(scope="module")
def of_life(ema, life_folder, tmp_path_factory) -> Page:
    path = tmp_path_factory.mktemp("of_life") / "life.html"
    assert ema("report", life_folder, "-o", path).exit_code == 0
    return Page(path)


@pytest.fixture(scope="module")
def reported(ema, life_folder) -> dict[str, Any]:
    return json.loads(ema("predict", life_folder, "--json").stdout)


def estimated(ema, bag: Path) -> list[list[float]]:
    """Return estimates and standard deviations of each window from `ema estimate --json`."""
    rows = []
    for estimate in json.loads(ema("estimate", bag, "--json").stdout):
        row = [(estimate["faults"][name], estimate["sigma"][name]) for name in FAULT_NAMES]
        rows.append([value for pair in row for value in pair if value is not None])
    return rows


@pytest.mark.parametrize("folder", ["", "history"])
def test_report_has_the_notes_of_persons_from_the_history(ema, tmp_path, folder):
    unit = ("flap", "SIM-0001")
    history = History(*unit, history_path(tmp_path / folder, *unit))
    note = UnitEvent(10**9, 5.0, Note("Ada", "greased <b>", 0))
    history.assess(Assessment(10**9, 5.0, 0, 1.0, "", None, events=(note,)))
    history.close()
    bag = shutil.copy(SAMPLE, tmp_path) if folder else SAMPLE
    printed = ema("report", bag, *tmp_path.glob("*.sqlite"), "-o", tmp_path / "a.html")
    assert printed.exit_code == 0, printed.stderr
    [line] = [line for line in Page(tmp_path / "a.html").printed["li"] if "Ada" in line]
    assert line.startswith("Ada, greased <b>")


def test_report_has_the_changes_of_the_baseline_with_person_and_earlier_faults(ema, tmp_path):
    unit = ("flap", "SIM-0001")
    history = History(*unit, history_path(tmp_path, *unit))
    estimates = [made_test(number, friction=0.4) for number in range(2)]
    followed = Unit(history)
    for estimate in estimates:
        followed.update(estimate, None, PrognosisSettings())
    time_ns = 1_795_914_720_000_000_000
    assert followed.change_baseline("Ada", "other-calibration", time_ns, is_forced=True)
    followed.resume(None, PrognosisSettings())
    history.close()
    printed = ema("report", SAMPLE, *tmp_path.glob("*.sqlite"), "-o", tmp_path / "a.html")
    assert printed.exit_code == 0, printed.stderr
    [line] = [line for line in Page(tmp_path / "a.html").printed["li"] if "Ada" in line]
    assert line.startswith("baseline changed by Ada, forced, 2026-11-29 01:12 UTC")
    assert "other-calibration instead of some-calibration, which showed friction 0.400" in line


@pytest.mark.slow
def test_numbers_of_a_bag_equal_its_estimates_exactly(ema, loaded, tmp_path):
    assert ema("report", loaded, "-o", tmp_path / "bag.html").exit_code == 0
    page = Page(tmp_path / "bag.html")
    assert page.exactly("Estimates") == estimated(ema, loaded)
    assert len(page.table("Tests")) == 3
    # The load is shown as a cause that is no fault, with the next step.
    [[words, _, tests]] = page.table("Hidden causes")
    assert words.startswith("load torque +0.3 ± 0.0")
    assert tests == "3"
    assert any("load torque" in line and "is not a fault" in line for line in page.printed["li"])


@pytest.mark.slow
def test_numbers_of_a_life_equal_its_prognosis_exactly(reported, of_life):
    for what, key in (("Faults", "faults"), ("Required performance", "requirements")):
        for row, item in zip(of_life.exactly(what), reported[key], strict=True):
            assert row[:2] == [item["value"], item["sigma"]]
            # The page shows the growth per 1000 h.
            assert row[3:] == pytest.approx([1e3 * item["trend"]], rel=1e-12)
    assert [row[0] for row in of_life.exactly("Tests")] == [
        test["flight_hours"] for test in reported["tests"]
    ]


@pytest.mark.slow
def test_verdict_has_four_lines_and_states_what_to_do_and_when(reported, of_life):
    state, wearing, lasting, basis = of_life.printed["ol"][0].strip().splitlines()
    assert state == f"Wearing: {reported['cause']}."
    assert basis.startswith("10 valid tests of 10; health index 0.")
    assert "friction 0.279" in wearing.lower()
    assert "limit ≤ 0.5" in wearing
    before = reported["flight_hours"] + reported["rul"]["hours_05"]
    assert f"remove before {before:,.0f} service hours" in lasting
    assert f"{reported['removal']}." in of_life.printed["li"]


def test_page_has_no_external_references(of_life):
    for tag, name, value in of_life.attributes:
        if name in ("src", "href", "xlink:href", "srcset", "action", "data"):
            assert (tag, name, value[:1]) == (tag, name, "#")
    assert re.findall(r"url\((?!#)", of_life.text) == []
    assert re.findall(r"https?:|@import|<script|<link|<iframe", of_life.text) == []


def test_page_is_well_formed_and_its_ids_are_unique(window, of_life):
    for page in (window, of_life):
        names = page.values("id")
        assert len(names) == len(set(names))
        used = re.findall(r"url\(#([^)]+)\)", page.text)
        used += [value[1:] for value in page.values("href")]
        used += " ".join(page.values("aria-labelledby")).split()
        assert set(used) <= set(names)


def test_page_is_accessible_to_screen_readers(of_life):
    roles = [value for tag, name, value in of_life.attributes if (tag, name) == ("svg", "role")]
    assert roles == ["img"] * 2
    assert len(of_life.printed["title"]) == 1 + len(roles)
    assert all(len(words) > 50 for words in of_life.printed["desc"])
    scopes = [value for tag, name, value in of_life.attributes if (tag, name) == ("th", "scope")]
    assert len(scopes) == len(of_life.printed["th"])
    assert ("html", "lang", "en") in of_life.attributes
    assert len(of_life.printed["h1"]) == 1
    # A level is a word and a shape, not only a colour.
    assert "▲ WARN" in of_life.printed["h2"][0]


def test_page_states_its_provenance(window, of_life):
    [[path, role, size, digest]] = window.table("Files")
    content = SAMPLE.read_bytes()
    assert (path, role) == (str(SAMPLE), "bag, 1 window used")
    assert (size, digest) == (f"{len(content):,}", hashlib.sha256(content).hexdigest())
    assert len(of_life.table("Files")) == TESTS
    assert digest in window.printed["details"][0]  # collapsed
    # Tests without a date have days and hours.
    assert of_life.table("Tests")[-1][2].startswith("4 days, 4:00:")
    [command] = window.printed["pre"]
    assert f" report {SAMPLE} -o " in command
    assert f"ema{__version__}" in "".join(window.printed["dl"])
    assert "G_prop" in [row[0] for row in window.table("Nominal parameters")]


def test_page_of_sixty_tests_is_below_a_megabyte(window, of_life):
    row = (of_life.size - window.size) / (TESTS - 1)
    assert window.size + 60 * row < 1e6


@pytest.mark.slow
def test_advice_is_given_with_costs_and_equals_that_of_the_prognosis(
    ema, life_folder, of_life, tmp_path
):
    costs = ("--cost", "removal=2000,failure=50000,lead_time=5", "-p", "costs.unit=EUR")
    page = tmp_path / "r.html"
    assert ema("report", life_folder, *costs, "-o", page).exit_code == 0
    advice = json.loads(ema("predict", life_folder, *costs, "--json").stdout)["advice"]
    [first, *_] = Page(page).printed["li"][4:]
    assert advice["action"] in ("continue", "remove")
    assert f"{advice['flight_hours']:,.0f} service hours (in {advice['from_now']:,.0f} h)" in first
    assert f"{advice['expected_cost']:.3g} EUR/h" in first
    assert advice["reason"] in first
    assert "EUR" not in of_life.text


def test_report_without_a_valid_estimate_states_so(ema, record, faulty_blocks, tmp_path):
    # The telemetry ends within its window.
    bag = record(faulty_blocks[: len(faulty_blocks) * 6 // 10])
    page = tmp_path / "r.html"
    assert ema("report", bag, "-o", page).exit_code == 3
    printed = Page(page).printed
    assert printed["ol"][0].strip().startswith("Unknown: none of 1 test has a valid estimate.")
    assert any("Repeat the test" in line and "ends" in line for line in printed["li"])


@pytest.mark.slow
def test_report_of_any_motion_draws_the_last_stretch(ema, tmp_path):
    bag, page = tmp_path / "motion.mcap", tmp_path / "r.html"
    motion = ("--command", "moves", "-p", "command.amplitude=0.008", "-p", "command.rate=0.3")
    assert ema("simulate", *motion, "--fault", "friction=0.2", "-o", bag).exit_code == 0
    options = ("--any-motion", "-p", "wanted_sigma=0.05", "--limit", "friction=0.12")
    result = ema("report", *options, bag, "-o", page)
    assert result.exit_code == 0, result.stderr
    reported = Page(page)
    assert any(
        words.startswith("Last stretch of the estimate") for words in reported.printed["desc"]
    )
    assert len(reported.table("Tests")) >= 1
    # Nothing is predicted for a fault beyond its limit.
    assert "% of the way" not in reported.printed["ol"][0]
