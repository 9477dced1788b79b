# SPDX-License-Identifier: Apache-2.0
"""Report of the study as a self-contained HTML page."""

from base64 import b64encode
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

from ema_study.agreement import ALGORITHM, BETTER, WITHIN, WORSE, agreement, time_per_10000_windows
from ema_study.cases import CASES
from ema_study.figures_of_responses import figures_of_chapter_4
from ema_study.figures_of_runs import figures_of_runs
from ema_study.models import problem
from ema_study.plan import KEY, RUNS, plan
from ema_study.printed import PRINTED, printed_runs
from ema_study.sources import ALGORITHM_NAMES, MODEL_LABELS, by_source, single_fault_runs
from ema_study.stop_rules import THRESHOLD
from ema_study.tables import study_tables


def write_report(
    folder: Path, runs: pd.DataFrame, timing: pd.DataFrame | None, settings: Mapping[str, str]
) -> Path:
    """Write ``report.html`` and the folder ``figures`` of PNG files; return the page's path.

    Parameters
    ----------
    folder
        Folder to write to.
    runs
        Runs as ``ema_study.run.as_frame`` returns them, of one or both models; may be incomplete
        or empty.
    timing
        Table that ``ema_study.execution.time_executors`` returns; None if times were not measured.
    settings
        Settings of the study as strings, keyed by name.
    """
    everything = printed_runs() if runs.empty else pd.concat([printed_runs(), runs])
    uris = {}
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    for name, figure in (figures_of_runs(everything) | figures_of_chapter_4()).items():
        path = folder / "figures" / f"{name}.png"
        figure.savefig(path, dpi=150)
        uris[name] = f"data:image/png;base64,{b64encode(path.read_bytes()).decode()}"
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
        settings=settings,
        uris=uris,
        models=MODEL_LABELS,
        timing=timing,
        verdict=verdict(compared, window_times),
        agreement=compared,
        by_model=by_model(runs),
        ranking=ranking(runs),
        window_times=window_times,
        study_tables=study_tables(runs),
    )
    path = folder / "report.html"
    path.write_text(text, encoding="utf-8")
    return path


def html_table(frame: pd.DataFrame, *, index: bool = True) -> str:
    """Return a table as HTML in a box that scrolls sideways; all cells are escaped."""
    with pd.option_context("display.max_colwidth", None):
        html = frame.map(_cell).to_html(
            index=index, border=0, classes="data", index_names=index and any(frame.index.names)
        )
    return f'<div class="scroll">{html}</div>'


def _cell(value: Any) -> str:
    """Return a value as a string; numbers have four significant digits."""
    if pd.isna(value):
        return ""
    if not isinstance(value, float):
        return str(value)
    return f"{value:.0f}" if value.is_integer() else significant(value, 4)


def significant(value: float, digits: int = 3) -> str:
    """Return a number as a string with ``digits`` significant digits.

    It has no exponent, except below 0.001.
    """
    if abs(value) < 1e-3:
        return f"{value:.{digits}g}"
    return np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")


def verdict(agreement: pd.DataFrame, window_times: pd.DataFrame) -> list[str]:
    """Return the result of the study in three sentences: one per model, one on time.

    Parameters
    ----------
    agreement
        Table that ``ema_study.agreement.agreement`` returns.
    window_times
        Table that ``ema_study.agreement.time_per_10000_windows`` returns.
    """
    name = ALGORITHM_NAMES[ALGORITHM]
    sentences = []
    for label in MODEL_LABELS.values():
        verdicts = agreement.get((label, "verdict"), pd.Series(dtype=str))
        better, within, worse = ((verdicts == name).sum() for name in (BETTER, WITHIN, WORSE))
        sentences.append(
            f"With the {label}, the mean error of {name} is better than all of the thesis's runs "
            f"in {better} of {better + within + worse} faults, within their range in {within} and "
            f"worse in {worse}."
            if better + within + worse
            else f"There are no {name} runs with the {label}."
        )
    times_ms = {label: time_s / 10.0 for label, time_s in window_times.T[name].dropna().items()}
    printed = times_ms.pop(PRINTED)
    of_models = "; ".join(
        f"{significant(time_ms)} ms with the {label}" for label, time_ms in times_ms.items()
    )
    return [
        *sentences,
        f"One evaluation of the monitor within {name} takes {of_models or 'an unknown time'}, "
        f"{significant(printed)} ms in the thesis.",
    ]


def by_model(runs: pd.DataFrame) -> pd.DataFrame:
    """Return a table with the number of runs and the effect of the printed threshold, by model.

    A model does not describe a fault if the true fault vector costs more than the healthy vector.
    """
    rows = []
    for model, label in MODEL_LABELS.items():
        made = runs[runs["model"] == model] if len(runs) else pd.DataFrame(columns=[*KEY, "cost"])
        keys = {job.key for job in plan(model, RUNS)}
        costs = made.loc[made["rule"] == "printed", "cost"].astype(float)
        rows.append(
            {
                "model": label,
                "runs": len(keys & set(made[list(KEY)].itertuples(index=False, name=None))),
                "of the full study": len(keys),
                "under the printed stop rule": len(costs),
                "of these at its threshold": (costs <= THRESHOLD).sum(),
                "their lowest cost [A²·s]": costs.min(),
                "faults that the model does not describe": ", ".join(
                    name for name in CASES if len(made) and not problem(model, name).is_described
                ),
            }
        )
    return pd.DataFrame(rows)


def ranking(runs: pd.DataFrame) -> pd.DataFrame:
    """Return each algorithm's mean error [%] and mean run time [s] over the single faults.

    All faults and levels have equal weight, regardless of the number of runs.
    """
    means = {}
    for label, frame in by_source(runs).items():
        cells = single_fault_runs(frame).groupby(["algorithm", "fault", "level"])
        means[label] = cells[["error_percent", "time_s"]].mean().groupby("algorithm").mean()
    headings = {"error_percent": "mean error [%]", "time_s": "mean time [s]"}
    table = pd.concat(means, axis=1).reindex(list(ALGORITHM_NAMES))
    return table.rename(index=ALGORITHM_NAMES, columns=headings)
