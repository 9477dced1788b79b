"""Tables of the report as HTML."""

import math
from collections.abc import Callable
from numbers import Real
from typing import Any, Final

import numpy as np
import pandas as pd

from ema_study.run import K

_WIDEST: Final = 16
"""Largest number of columns side by side."""


def narrowed(frame: pd.DataFrame) -> pd.DataFrame:
    """Return a table of several sources with the sources below each other where it is too wide."""
    if frame.shape[1] <= _WIDEST:
        return frame
    sources = frame.columns.unique(0)
    blocks = {source: frame.xs(source, axis=1, level=0).dropna(how="all") for source in sources}
    return pd.concat(blocks, names=[frame.columns.names[0]])


def html_table(frame: pd.DataFrame, *, index: bool = True) -> str:
    """Return a table as HTML in a box that scrolls sideways; all texts are escaped.

    Parameters
    ----------
    frame
        The table. The format of a column's numbers follows from its name: estimates have four
        decimals as in the thesis, errors and other percentages two, times three significant digits,
        others four.
    index
        Whether to show the names of the rows.
    """
    names = [" ".join(map(str, name)) if isinstance(name, tuple) else str(name)
             for name in frame.columns]  # fmt: skip
    # None would be shown as such.
    shown = frame.astype(object).where(frame.notna(), math.nan)
    with pd.option_context("display.max_colwidth", None):
        html = shown.to_html(
            index=index,
            border=0,
            classes="data",
            na_rep="",
            index_names=index and any(frame.index.names),
            formatters=[_formatter(name) for name in names],
        )
    return f'<div class="scroll">{html}</div>'


def significant(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, without an exponent above 0.001."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    if abs(value) < 1e-3:
        return f"{value:.{digits - 1}e}"
    decimals = digits - 1 - math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    return f"{round(value, decimals):,.{max(0, decimals)}f}"


def _formatter(name: str) -> Callable[[Any], str]:
    """Return the format of a column's values."""
    lower = name.lower()

    def formatted(value: Any) -> str:
        if isinstance(value, bool | np.bool_):
            return "yes" if value else "no"
        if not isinstance(value, Real):
            return str(value)
        number = float(value)
        if math.isnan(number):
            return ""
        if lower.split()[-1] in K:
            return f"{number:.4f}"
        if "%" in lower and "s.%" not in lower:
            return f"{number:.2f}"
        if "time" in lower or "second" in lower or "[s" in lower:
            return significant(number)
        return f"{number:,.0f}" if number.is_integer() else significant(number, 4)

    return formatted
