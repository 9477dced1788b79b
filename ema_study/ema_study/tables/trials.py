"""Table 8: the trials by which the thesis calibrated GA."""

import pandas as pd

from ema_study.printed_runs import PRINTED
from ema_study.printed_tables import ga_trials
from ema_study.sources import MODEL_LABELS
from ema_study.tables.study_table import StudyTable

TRIALS = 8
"""Number of the table."""

_NAMES = {
    "population": "population",
    "max_generations": "most generations",
    "generations": "generations",
    "time_s": "time [s]",
    "speed": "evaluations per second",
}


def trials_table(runs: pd.DataFrame) -> StudyTable:
    """Return the trials, printed ones beside ours.

    Parameters
    ----------
    runs
        Our runs; the number of a run of table 8 is that of the trial.

    Notes
    -----
    The evaluations per second are population times generations over time.
    """
    trials = ga_trials()
    shown = {
        **_NAMES,
        "failure": "fault",
        "tolerance": "tolerance",
        "time_limit_s": "time limit [s]",
        "parallel": "parallel",
    }
    printed = _with_speed(trials).rename(columns=shown)[list(shown.values())]
    is_bound = trials["at_least"].astype(bool)
    printed.loc[is_bound, "evaluations per second"] = float("nan")
    blocks = {PRINTED: printed}
    ours = runs[runs["table"] == TRIALS] if not runs.empty else runs
    shown = {**_NAMES, "fault": "fault", "error_percent": "error [%]"}
    for model, label in MODEL_LABELS.items():
        if ours.empty or not (ours["model"] == model).any():
            continue
        of_model = ours[ours["model"] == model].drop_duplicates("run", keep="last").set_index("run")
        blocks[label] = _with_speed(of_model).rename(columns=shown)[list(shown.values())]
    frame = pd.concat(blocks, axis=1, names=["source", "quantity"]).reindex(trials.index)
    bounds = ", ".join(str(trial) for trial in trials.index[is_bound])
    notes = [
        f"The times of trials {bounds} are lower bounds.",
        "The thesis does not print how high its faults were, nor which fault trials without one "
        "had; ours are at the low level.",
    ]
    return StudyTable(TRIALS, "Calibration of GA", frame, notes)


def _with_speed(trials: pd.DataFrame) -> pd.DataFrame:
    speed = trials["population"] * trials["generations"] / trials["time_s"]
    return trials.assign(speed=speed)
