"""The report of the study: one page that stands alone, whatever runs there are."""

import io
import math
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from ema_study.agreement import agreement, time_per_10000_windows
from ema_study.report import (
    SECTIONS,
    completeness,
    html_table,
    threshold_sentences,
    verdict,
    write_report,
)

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


class Page(HTMLParser):
    """A page read strictly: every element that is opened is closed, in order."""

    def __init__(self, path):
        super().__init__()
        self.tags, self.ids, self.links, self.sources, self.texts = [], [], [], [], []
        self._open = []
        self.feed(path.read_text(encoding="utf-8"))
        self.close()
        assert not self._open

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag not in ("meta", "img", "br"):
            self._open.append(tag)
        values = dict(attrs)
        self.ids += [values["id"]] if "id" in values else []
        self.links += [values["href"]] if "href" in values else []
        self.sources += [values["src"]] if "src" in values else []

    def handle_endtag(self, tag):
        assert self._open.pop() == tag, self.getpos()

    def handle_data(self, data):
        self.texts.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.texts).split())


@pytest.fixture(scope="module")
def ours():
    thesis = synthetic_runs("thesis", 1).query("fault == 'friction'")
    return pd.concat([synthetic_runs("fast", 2), thesis], ignore_index=True)


@pytest.fixture(scope="module", autouse=True)
def _same_picture_for_all():
    """Draw every figure, but render one blank one in place of all: the figures' tests render."""
    with io.BytesIO() as file:
        Figure(figsize=(1, 1)).savefig(file, format="png", dpi=20)
        blank = file.getvalue()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", lambda figure, file, **options: file.write(blank))
        yield


@pytest.fixture(scope="module")
def written(tmp_path_factory, ours):
    folder = tmp_path_factory.mktemp("study")
    (folder / "report.html").write_text("an older report")
    return write_report(folder, ours, TIMING, SETTINGS)


@pytest.fixture(scope="module")
def page(written):
    return Page(written)


def test_page_needs_nothing_beside_it(written, page):
    assert not {"script", "link", "iframe", "object"} & set(page.tags)
    assert all(link.startswith("#") and link[1:] in page.ids for link in page.links)
    assert page.sources
    assert all(source.startswith("data:image/png;base64,") for source in page.sources)
    text = written.read_text(encoding="utf-8")
    assert "url(" not in text
    assert "@import" not in text
    assert written.stat().st_size < 15e6


def test_every_section_is_there_and_in_the_contents(page):
    assert page.links == [f"#{anchor}" for anchor in SECTIONS]
    assert len(set(page.ids)) == len(page.ids)
    for title in SECTIONS.values():
        assert page.text.count(title) >= 2


@pytest.mark.parametrize(
    "runs",
    [
        pd.DataFrame(),
        synthetic_runs("fast", 1).iloc[:3],
        synthetic_runs("thesis", 1).query("rule == 'printed'"),
    ],
    ids=["none", "three", "demonstrations alone"],
)
def test_report_copes_with_what_is_missing_and_says_so(tmp_path, runs):
    page = Page(write_report(tmp_path, runs, None, {}))
    assert page.links == [f"#{anchor}" for anchor in SECTIONS]
    assert "Not measured" in page.text
    for row in completeness(runs).itertuples():
        assert f"{row.model} {row.runs}" in page.text
    assert not {"nan", "None", "NaN"} & set(page.text.split())


def test_figures_have_four_digits_and_what_is_missing_an_empty_cell():
    row = [0.0041, 394.4444, 200.0, np.True_, np.int64(10), None, math.nan]
    html = html_table(pd.DataFrame([row], columns=list("abcdefg")))
    for cell in ("0.004100", "394.4", "200", "True", "10", ""):
        assert f"<td>{cell}</td>" in html
    assert "None" not in html
    assert "nan" not in html.lower()


def test_report_opens_with_a_verdict_of_three_sentences(page, ours):
    lines = verdict(agreement(ours), time_per_10000_windows(ours))
    assert len(lines) == 3
    opening = page.text.partition(SECTIONS["agreement"])[0]
    assert all(line in opening for line in lines)
    assert lines[0].startswith("With the thesis's model")
    assert lines[1].startswith("With the fast model")
    assert "One evaluation of the monitor within PSO takes" in lines[2]
    # Its swarm: 50 particles a generation, 12.65 s each.
    assert lines[2].endswith("253 ms in the thesis.")


def test_faults_that_a_model_does_not_describe_are_named(ours):
    said = " ".join(threshold_sentences(ours))
    assert "thesis's model the true faults cost more" in said
    assert "eccentricity low and eccentricity high: DE and GWO" in said
    assert "With the fast model the true faults" not in said
