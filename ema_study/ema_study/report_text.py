"""Sentences of the report, computed from our runs, which may be empty."""

from collections.abc import Iterator

import pandas as pd

from ema_study.agreement import ALGORITHM, BETTER, WITHIN, WORSE
from ema_study.html_tables import significant
from ema_study.plan import KEY, RUNS, plan
from ema_study.printed import PRINTED
from ema_study.sources import ALGORITHM_NAMES, MODEL_LABELS, by_source, single_fault_runs
from ema_study.stop_rules import THRESHOLD


def verdict(agreement: pd.DataFrame, window_times: pd.DataFrame) -> list[str]:
    """Return the result of the study in three sentences: one for each model, one on time.

    ``agreement`` and ``window_times`` are those of ``ema_study.agreement``.
    """
    sentences = [_verdict_of(label, agreement) for label in MODEL_LABELS.values()]
    name = ALGORITHM_NAMES[ALGORITHM]
    times_ms = {label: time_s / 10.0 for label, time_s in window_times.T[name].dropna().items()}
    printed = times_ms.pop(PRINTED)
    of_models = "; ".join(
        f"{significant(time_ms)} ms with the {label}" for label, time_ms in times_ms.items()
    )
    sentences.append(
        f"One evaluation of the monitor within {name} takes {of_models or 'an unknown time'}, "
        f"{significant(printed)} ms in the thesis."
    )
    return sentences


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


def printed_rule_sentences(runs: pd.DataFrame) -> Iterator[str]:
    """Yield whether the stop rule's threshold as printed was ever reached, for each model."""
    for model, label in MODEL_LABELS.items() if not runs.empty else ():
        costs = runs.loc[(runs["model"] == model) & (runs["rule"] == "printed"), "cost"]
        if len(costs):
            yield (
                f"With the {label}, {(costs <= THRESHOLD).sum()} of {len(costs)} runs under the "
                f"stop rule as printed reached its threshold of {significant(THRESHOLD, 1)} A²·s; "
                f"the lowest cost was {significant(costs.min())} A²·s."
            )
