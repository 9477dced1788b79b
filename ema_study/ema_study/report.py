"""The report of the study: one page that needs nothing beside it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

from ema_study.agreement import agreement, time_per_10000_windows
from ema_study.causes import STEPS, causes_table, modulation_table
from ema_study.claims import claims_table
from ema_study.errata import errata
from ema_study.error_forms import reproduction
from ema_study.printed_runs import printed_runs
from ema_study.report_figures import (
    Picture,
    bar_pictures,
    comparison_pictures,
    convergence_pictures,
    estimate_pictures,
    noise_pictures,
    response_pictures,
)
from ema_study.report_sentences import (
    agreement_sentences,
    claims_sentence,
    completeness,
    printed_rule_sentences,
    ranking_sentences,
    reasons,
)
from ema_study.report_tables import html_table, narrowed
from ema_study.tables import study_tables

_RELIABILITY_TABLES: Final = (60, 61)

SECTIONS: Final = {
    "agreement": "What agrees and what does not",
    "settings": "Settings and definitions",
    "errors": "Error and time by algorithm",
    "times": "Computing time",
    "reliability": "Reliability",
    "convergence": "Convergence",
    "estimates": "What was found",
    "tables": "Tables 8 to 61",
    "responses": "Responses of the actuator",
    "noise": "Noise",
    "monitor": "Reference against monitor",
    "error-formula": "The formula of the error",
    "errata": "Errata of the thesis",
}
"""Titles of the sections by anchor, in order."""


def write_report(
    folder: Path, runs: pd.DataFrame, timing: pd.DataFrame | None, settings: Mapping[str, str]
) -> Path:
    """Write ``report.html`` and its figures, each as a PNG in ``figures``.

    Parameters
    ----------
    folder
        Where to; it is made where it is missing.
    runs
        Our runs, as of ``ema_study.record.as_frame``: one model or both, complete or not, or none.
    timing
        Serial and parallel execution, as of ``ema_study.timing.time_executors``; None where it was
        not measured.
    settings
        What the study was made with, as text by name.

    Returns
    -------
    pathlib.Path
        The page. It has its style and its pictures in it and no scripts.
    """
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    pictures = _pictures(runs)
    for picture in (one for group in pictures.values() for one in group):
        picture.save(folder / "figures")
    environment = Environment(
        loader=PackageLoader("ema_study"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"html_table": html_table, "narrowed": narrowed}
    text = environment.get_template("report.html.j2").render(
        sections=SECTIONS, settings=settings, pictures=pictures, **_tables(runs, timing)
    )
    path = folder / "report.html"
    path.write_text(text, encoding="utf-8")
    return path


def _pictures(runs: pd.DataFrame) -> dict[str, list[Picture]]:
    """Return the pictures by anchor of their section."""
    everything = printed_runs() if runs.empty else pd.concat([printed_runs(), runs])
    return {
        "errors": list(bar_pictures(everything)),
        "convergence": list(convergence_pictures(runs)),
        "estimates": list(estimate_pictures(everything)),
        "responses": list(response_pictures()),
        "noise": list(noise_pictures()),
        "monitor": list(comparison_pictures()),
    }


def _tables(runs: pd.DataFrame, timing: pd.DataFrame | None) -> dict[str, Any]:
    """Return the tables and sentences that the template shows."""
    of_agreement = agreement(runs)
    of_study = study_tables(runs)
    return {
        "sentences": [
            *agreement_sentences(of_agreement),
            claims_sentence(),
            *ranking_sentences(runs),
            *printed_rule_sentences(runs),
        ],
        "completeness": completeness(runs),
        "agreement": of_agreement.drop(columns="reason", level=1, errors="ignore"),
        "reasons": reasons(of_agreement),
        "causes": causes_table(),
        "steps": STEPS,
        "modulation": modulation_table(),
        "window_times": time_per_10000_windows(runs),
        "timing": timing,
        "reliability": [table for table in of_study if table.number in _RELIABILITY_TABLES],
        "study_tables": of_study,
        "claims": claims_table(),
        "reproduction": reproduction(printed_runs()),
        "errata": pd.DataFrame(errata()),
    }
