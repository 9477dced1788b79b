"""The report of the study: one page that needs nothing beside it."""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

from ema_study.agreement import (
    ALGORITHM,
    BETTER,
    WITHIN,
    WORSE,
    agreement,
    time_per_10000_windows,
)
from ema_study.cases import CASES
from ema_study.models import describes
from ema_study.pictures import pictures_of_chapter_4, pictures_of_runs
from ema_study.plan import KEY, RUNS, plan
from ema_study.printed import PRINTED, printed_runs
from ema_study.sources import ALGORITHM_NAMES, MODEL_LABELS, by_source, single_fault_runs
from ema_study.stop_rules import THRESHOLD
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

_WIDEST: Final = 16
"""Largest number of columns of a table side by side."""


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
    environment.filters["html_table"] = html_table
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
        threshold=list(threshold_sentences(runs)),
        window_times=window_times,
        study_tables=study_tables(runs),
    )
    path = folder / "report.html"
    path.write_text(text, encoding="utf-8")
    return path


def html_table(frame: pd.DataFrame, *, index: bool = True) -> str:
    """Return a table as HTML in a box that scrolls sideways; all texts are escaped.

    Sources are below each other where they are too wide side by side.
    """
    if frame.shape[1] > _WIDEST:
        sources = frame.columns.unique(0)
        blocks = {source: frame.xs(source, axis=1, level=0).dropna(how="all") for source in sources}
        frame = pd.concat(blocks, names=[frame.columns.names[0]])
    with pd.option_context("display.max_colwidth", None):
        html = frame.map(_cell).to_html(
            index=index, border=0, classes="data", index_names=index and any(frame.index.names)
        )
    return f'<div class="scroll">{html}</div>'


def _cell(value: Any) -> str:
    """Return a value as text; figures have four significant digits."""
    if pd.isna(value):
        return ""
    if not isinstance(value, float):
        return str(value)
    return f"{value:,.0f}" if value.is_integer() else significant(value, 4)


def significant(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, without an exponent above 0.001."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    if abs(value) < 1e-3:
        return f"{value:.{digits - 1}e}"
    decimals = digits - 1 - math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    return f"{round(value, decimals):,.{max(0, decimals)}f}"


def verdict(agreement: pd.DataFrame, window_times: pd.DataFrame) -> list[str]:
    """Return the result of the study in three sentences: one for each model, one on time.

    ``agreement`` and ``window_times`` are those of ``ema_study.agreement``.
    """
    name = ALGORITHM_NAMES[ALGORITHM]
    times_ms = {label: time_s / 10.0 for label, time_s in window_times.T[name].dropna().items()}
    printed = times_ms.pop(PRINTED)
    of_models = "; ".join(
        f"{significant(time_ms)} ms with the {label}" for label, time_ms in times_ms.items()
    )
    return [
        *(_verdict_of(label, agreement) for label in MODEL_LABELS.values()),
        f"One evaluation of the monitor within {name} takes {of_models or 'an unknown time'}, "
        f"{significant(printed)} ms in the thesis.",
    ]


def _verdict_of(label: str, agreement: pd.DataFrame) -> str:
    columns = agreement.get(label, pd.DataFrame(columns=["verdict", "runs", "mean error [%]"]))
    columns = columns[columns["verdict"].isin([BETTER, WITHIN, WORSE])]
    if columns.empty:
        return f"There are no {ALGORITHM_NAMES[ALGORITHM]} runs with the {label}."
    counts = columns["verdict"].value_counts()
    worse = ", ".join(columns.index[columns["verdict"] == WORSE])
    single = int((columns["runs"] == 1).sum())
    printed = agreement.loc[columns.index, (PRINTED, "mean error [%]")].astype(float).mean()
    return (
        f"With the {label}, the mean error of {ALGORITHM_NAMES[ALGORITHM]} is better than all of "
        f"the thesis's runs in {counts.get(BETTER, 0)} of {len(columns)} faults, within their "
        f"range in {counts.get(WITHIN, 0)} and worse in {counts.get(WORSE, 0)}"
        f"{f' ({worse})' if worse else ''}; its mean over these faults is "
        f"{columns['mean error [%]'].astype(float).mean():.2f} %, the thesis's {printed:.2f} %."
        + (f" {single} of the {len(columns)} means are of a single run." if single else "")
    )


def completeness(runs: pd.DataFrame) -> pd.DataFrame:
    """Return how many runs of the full study there are with each model."""
    made = set() if runs.empty else set(runs[list(KEY)].itertuples(index=False, name=None))
    rows = []
    for model, label in MODEL_LABELS.items():
        keys = {job.key for job in plan(model, RUNS)}
        rows.append((label, len(keys & made), len(keys)))
    return pd.DataFrame(rows, columns=["model", "runs", "of the full study"])


def ranking_sentences(runs: pd.DataFrame) -> Iterator[str]:
    """Yield how the algorithms rank over the single faults, a sentence for each source."""
    for label, frame in by_source(runs).items():
        single = single_fault_runs(frame)
        if single.empty:
            continue
        # Each fault and level counts alike, however many runs it has.
        columns = single.groupby(["algorithm", "fault", "level"])[["error_percent", "time_s"]]
        means = columns.mean().groupby("algorithm").mean().rename(index=ALGORITHM_NAMES)
        errors = means["error_percent"].sort_values()
        ranked = ", ".join(f"{name} {error:.2f} %" for name, error in errors.items())
        subject = "The thesis prints" if label == PRINTED else f"{label.capitalize()}:"
        yield (
            f"{subject} mean errors of {ranked}; fastest is {means['time_s'].idxmin()} with "
            f"{significant(means['time_s'].min())} s a run."
        )


def threshold_sentences(runs: pd.DataFrame) -> Iterator[str]:
    """Yield what became of the stop rule's threshold, for each model with runs."""
    for model, label in MODEL_LABELS.items() if not runs.empty else ():
        of_model = runs[runs["model"] == model]
        costs = of_model.loc[of_model["rule"] == "printed", "cost"]
        if len(costs):
            yield (
                f"With the {label}, {(costs <= THRESHOLD).sum()} of {len(costs)} runs under the "
                f"stop rule as printed reached its threshold of {significant(THRESHOLD, 1)} A²·s; "
                f"the lowest cost was {significant(costs.min())} A²·s."
            )
        missed = [name for name in CASES if len(of_model) and not describes(model, name)]
        if missed:
            yield (
                f"With the {label} the true faults cost more than the healthy ones in "
                f"{' and '.join(missed)}: DE and GWO meet the floor-corrected threshold at once "
                "and stop as soon as they may."
            )
