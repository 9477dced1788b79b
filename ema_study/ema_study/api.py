# SPDX-License-Identifier: Apache-2.0
"""Public Python API of the study: repeat a table of the thesis."""

from ema_core.wording import unknown_name
from ema_study.contents import NUMBERS, jobs_of, table_titles, title_of
from ema_study.models import MODELS
from ema_study.plan import RUNS
from ema_study.run import as_frame, run_job
from ema_study.tables import StudyTable, study_tables

__all__ = ["NUMBERS", "StudyTable", "table", "table_titles", "title_of"]


def table(number: int, runs: int = RUNS, model: str = "fast") -> StudyTable:
    """Repeat a table of the thesis and return reproduced and printed values side by side.

    The runs have the seeds of ``ema thesis``, so estimates and errors equal the results of the
    command. Times are measured on this machine. A table of single runs takes about half a minute
    with the fast model, tables 58 to 60 take some minutes.

    Parameters
    ----------
    number
        Number of the table in the thesis, 8 to 61 (``NUMBERS``).
    runs
        Number of runs of each algorithm and fault; the thesis made ten.
    model
        Model of the monitor: ``"fast"``, or ``"thesis"``, which is 20 times slower.

    Returns
    -------
    StudyTable
        ``frame`` has columns (source, quantity): errors in percent of the range, times in s.

    Raises
    ------
    ValueError
        If the thesis has no such table, or the model is unknown.

    Examples
    --------
    >>> from ema_study.api import table
    >>> table(24, runs=1).title
    'Backlash high, GA'
    """
    if model not in MODELS:
        raise ValueError(unknown_name("model", model, MODELS))
    jobs = jobs_of(number, model, runs)
    return study_tables(as_frame(map(run_job, jobs)), [number])[0]
