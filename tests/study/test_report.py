# SPDX-License-Identifier: Apache-2.0
"""The report of the study is a self-contained page, for any number of runs."""

import io
import math

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from ema_study.agreement import agreement, time_per_10000_windows
from ema_study.report import by_model, html_table, verdict, write_report

from ..pages import Page
from .synthetic_runs import synthetic_runs

pytestmark = pytest.mark.long

SETTINGS = {"seed": "<script>alert(1)</script>", "machine": "x & y"}
TIMING = pd.DataFrame(
    {
        "algorithm": "de",
        "how": ["serial", "processes"],
        "seconds": [3.14159, 1.6],
        "speedup": [1, 2],
    }
)


@pytest.fixture(scope="module")
def ours():
    thesis = synthetic_runs("thesis", 1).query("fault == 'friction'")
    return pd.concat([synthetic_runs("fast", 2), thesis], ignore_index=True)


@pytest.fixture(scope="module", autouse=True)
def _same_picture_for_all():
    """Draw every figure, but render a blank picture instead: other tests render the figures."""
    with io.BytesIO() as file:
        Figure(figsize=(1, 1)).savefig(file, format="png", dpi=20)
        blank = file.getvalue()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", lambda figure, path, **options: path.write_bytes(blank))
        yield


@pytest.fixture(scope="module")
def written(tmp_path_factory, ours):
    folder = tmp_path_factory.mktemp("study")
    (folder / "report.html").write_text("an older report")
    return write_report(folder, ours, TIMING, SETTINGS)


@pytest.fixture(scope="module")
def page(written):
    return Page(written)


def test_page_has_no_external_references(written, page):
    assert not {"script", "link", "iframe", "object"} & set(page.printed)
    assert {link.removeprefix("#") for link in page.values("href")} <= {*page.values("id")}
    assert page.values("src")
    assert all(source.startswith("data:image/png;base64,") for source in page.values("src"))
    text = written.read_text(encoding="utf-8")
    assert "url(" not in text
    assert "@import" not in text
    assert written.stat().st_size < 15e6


def test_every_section_is_present_and_in_the_contents(page):
    titles = page.printed["h2"]
    anchors = [value for tag, name, value in page.attributes if (tag, name) == ("h2", "id")]
    assert len(titles) == 10
    assert page.values("href") == [f"#{anchor}" for anchor in anchors]
    assert len(set(page.values("id"))) == len(page.values("id"))
    for title in titles:
        assert page.words.count(title) >= 2


@pytest.mark.parametrize(
    "runs",
    [
        pd.DataFrame(),
        synthetic_runs("fast", 1).iloc[:3],
        synthetic_runs("thesis", 1).query("rule == 'printed'"),
    ],
    ids=["none", "three", "demonstrations alone"],
)
def test_report_without_some_results_states_what_is_missing(tmp_path, runs):
    page = Page(write_report(tmp_path, runs, None, {}))
    assert len(page.printed["h2"]) == 10
    assert "Not measured" in page.words
    for row in by_model(runs).itertuples():
        assert f"{row.model} {row.runs}" in page.words
    assert not {"nan", "None", "NaN"} & set(page.words.split())


def test_numbers_have_four_digits_and_missing_ones_an_empty_cell():
    row = [0.0041, 394.4444, 200.0, np.True_, np.int64(10), None, math.nan]
    html = html_table(pd.DataFrame([row], columns=list("abcdefg")))
    for cell in ("0.0041", "394.4", "200", "True", "10", ""):
        assert f"<td>{cell}</td>" in html
    assert "None" not in html
    assert "nan" not in html.lower()


def test_report_opens_with_a_verdict_of_three_sentences(page, ours):
    lines = verdict(agreement(ours), time_per_10000_windows(ours))
    assert len(lines) == 3
    opening = page.words.partition(page.printed["h2"][0])[0]
    assert all(line in opening for line in lines)
    assert lines[0].startswith("With the thesis's model")
    assert lines[1].startswith("With the fast model")
    assert "One evaluation of the monitor within PSO takes" in lines[2]
    # The thesis's swarm: 50 particles per generation, 12.65 s each.
    assert lines[2].endswith("253 ms in the thesis.")


def test_faults_that_a_model_does_not_describe_are_named(ours):
    rows = by_model(ours).set_index("model")["faults that the model does not describe"]
    assert rows["thesis's model"] == "eccentricity low, eccentricity high"
    assert not rows["fast model"]
