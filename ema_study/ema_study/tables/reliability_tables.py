"""The tables of the reliability coefficient: 60 for single faults, 61 for the multiple one."""

import pandas as pd

from ema_study.printed_runs import PRINTED
from ema_study.printed_tables import reliability_multiple, reliability_single
from ema_study.reliability import (
    PRECISION_STUDY,
    SPEED_STUDY,
    multiple_fault_reliability,
    single_fault_reliability,
)
from ema_study.tables.study_table import StudyTable
from ema_study.tables.summaries import computed, run_counts, side_by_side
from ema_study.tables.threshold_notes import threshold_summary

_UNITS = {
    "time x error": "time x error [s.%]",
    "RC": "RC [%]",
    "time_s": "time [s]",
    "error_percent": "error [%]",
}

MIXED = f"times of table {SPEED_STUDY}, errors of {PRECISION_STUDY}"


def single_fault_table(sources: dict[str, pd.DataFrame]) -> StudyTable:
    """Return table 60.

    Parameters
    ----------
    sources
        Runs by source.
    """
    blocks = {PRINTED: reliability_single()}
    for label, runs in computed(sources).items():
        blocks[label] = single_fault_reliability(runs)
    flat = {}
    for label, block in blocks.items():
        names = [f"{fault.replace('_', ' ')}, {_UNITS[what]}" for fault, what in block.columns]
        flat[label] = block.set_axis(names, axis=1)
    notes = [run_counts(sources), *threshold_summary(sources)]
    return StudyTable(60, "Reliability coefficient, single faults", side_by_side(flat), notes)


def multiple_fault_table(sources: dict[str, pd.DataFrame]) -> StudyTable:
    """Return table 61 as the thesis mixed it, and from each of its two studies alone.

    Parameters
    ----------
    sources
        Runs by source.
    """
    blocks = {PRINTED: reliability_multiple().rename(columns=_UNITS)}
    for label, runs in computed(sources).items():
        for what, times_of, errors_of in (
            (MIXED, SPEED_STUDY, PRECISION_STUDY),
            (f"table {SPEED_STUDY}", SPEED_STUDY, SPEED_STUDY),
            (f"table {PRECISION_STUDY}", PRECISION_STUDY, PRECISION_STUDY),
        ):
            block = multiple_fault_reliability(runs, times_of, errors_of)
            blocks[f"{label}, {what}"] = block.rename(columns=_UNITS)
    counts = "; ".join(
        f"{label} {int((runs['fault'] == 'multiple').sum())}" for label, runs in sources.items()
    )
    notes = [
        f"As printed, it multiplies the {MIXED}: no run had both.",
        f"Number of runs: {counts}.",
    ]
    return StudyTable(61, "Reliability coefficient, multiple fault", side_by_side(blocks), notes)
