"""The report of the study: one page that needs nothing beside it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

from ema_study.agreement import agreement, time_per_10000_windows
from ema_study.figures.pictures import pictures_of_chapter_4, pictures_of_runs
from ema_study.html_tables import html_table, narrowed
from ema_study.printed import printed_runs
from ema_study.report_text import (
    completeness,
    printed_rule_sentences,
    ranking_sentences,
    verdict,
)
from ema_study.tables import study_tables

SECTIONS: Final = {
    "agreement": "Agreement with the thesis",
    "settings": "Settings and definitions",
    "errors": "Error and time by algorithm",
    "times": "Computing time",
    "reliability": "Reliability",
    "convergence": "Convergence",
    "estimates": "Estimates",
    "tables": "Tables 8 to 61",
    "responses": "Responses of the actuator",
    "noise": "Noise",
    "monitor": "Reference against monitor",
}
"""Titles of the sections by anchor, in order."""


def write_report(
    folder: Path, runs: pd.DataFrame, timing: pd.DataFrame | None, settings: Mapping[str, str]
) -> Path:
    """Write ``report.html`` and its figures, each as a PNG in ``figures``.

    Parameters
    ----------
    folder
        Folder of the report; it is made where it is missing.
    runs
        Our runs, as of ``ema_study.run.as_frame``: one model or both, complete or not, or none.
    timing
        Serial and parallel execution, as of ``ema_study.execution.time_executors``; None where it
        was not measured.
    settings
        Settings of the study, as text by name.

    Returns
    -------
    pathlib.Path
        The page, with its style and its pictures, without scripts.
    """
    everything = printed_runs() if runs.empty else pd.concat([printed_runs(), runs])
    pictures = pictures_of_runs(everything) | pictures_of_chapter_4()
    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    for picture in (one for group in pictures.values() for one in group):
        (figures / f"{picture.name}.png").write_bytes(picture.png)
    environment = Environment(
        loader=PackageLoader("ema_study"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"html_table": html_table, "narrowed": narrowed}
    compared, window_times = agreement(runs), time_per_10000_windows(runs)
    text = environment.get_template("report.html.j2").render(
        sections=SECTIONS,
        settings=settings,
        pictures=pictures,
        timing=timing,
        verdict=verdict(compared, window_times),
        agreement=compared,
        completeness=completeness(runs),
        ranking=list(ranking_sentences(runs)),
        printed_rule=list(printed_rule_sentences(runs)),
        window_times=window_times,
        study_tables=study_tables(runs),
    )
    path = folder / "report.html"
    path.write_text(text, encoding="utf-8")
    return path
