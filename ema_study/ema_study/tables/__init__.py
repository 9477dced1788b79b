"""The thesis's tables 8 to 61 beside ours."""

import pandas as pd

from ema_study.printed_tables import OVERVIEWS, SUMMARIES, run_means
from ema_study.sources import by_source
from ema_study.tables.per_run import per_run_table
from ema_study.tables.reliability_tables import multiple_fault_table, single_fault_table
from ema_study.tables.study_table import StudyTable, write_tables
from ema_study.tables.summaries import fault_summary, overview_table
from ema_study.tables.trials import trials_table

__all__ = ["StudyTable", "study_tables", "write_tables"]


def study_tables(runs: pd.DataFrame) -> list[StudyTable]:
    """Return the thesis's tables 8 to 61, in their order, each beside ours.

    Parameters
    ----------
    runs
        Our runs, as of ``ema_study.record.as_frame``: one model or both, complete or not, or none.
    """
    sources = by_source(runs)
    of_runs = run_means().index.unique("table")
    tables = [
        trials_table(runs),
        *(per_run_table(number, sources) for number in of_runs),
        *(fault_summary(number, sources) for number in SUMMARIES),
        *(overview_table(number, sources) for number in OVERVIEWS),
        single_fault_table(sources),
        multiple_fault_table(sources),
    ]
    return sorted(tables, key=lambda table: table.number)
