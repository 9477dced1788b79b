# SPDX-License-Identifier: Apache-2.0
"""Tests from tables with one row per move, for drives that do not log samples."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ema_bags.inputs.dates import ORDERS
from ema_bags.inputs.mapping import TIMES_NS, Clock
from ema_bags.inputs.tables import read_columns
from ema_core.moves import Move
from ema_core.quantity import Checked, text, texts
from ema_core.settings_file import load_settings
from ema_core.wording import unknown_name


@dataclass(frozen=True)
class MovesMapping(Checked):
    """Column mapping of a table with one row per move.

    Raises
    ------
    ValueError
        If ``time`` or ``figures`` is missing, or ``time_unit`` is unknown.
    """

    time: str = text("", "column with the time of the move: dates, or numbers in ``time_unit``")
    figures: tuple[str, ...] = texts("columns with positive figures that increase with wear")
    time_unit: str = text("s", "unit of numeric times", (*TIMES_NS, *ORDERS))
    like: tuple[str, ...] = texts(
        "columns with operating conditions, such as command and load; only moves under equal "
        "conditions are compared"
    )
    test: str = text(
        "", "column that groups moves into tests, each with the medians of its moves; empty: by day"
    )
    unit: str = text("", "column with the serial number; empty if there is one unit")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.time or not self.figures:
            raise ValueError("expected time (a column) and figures (a list of columns)")


def load_moves_mapping(path: Path) -> MovesMapping:
    """Read the column mapping of a table of moves.

    Raises
    ------
    ValueError
        If the file cannot be read or is not a mapping; the message names the file.
    """
    return load_settings(path, "mapping file", MovesMapping)


def read_moves(path: Path, mapping: MovesMapping) -> dict[str, list[Move]]:
    """Return the tests of each unit in chronological order.

    A test has the median of each figure under each operating condition; the figure's name includes
    the condition.

    Raises
    ------
    ValueError
        If the file is not a table, a column is missing or not numeric, or a row has no time stamp.
    OSError
        If the file cannot be read.
    """
    import pandas as pd

    columns = read_columns(path)
    stamps = columns.stamps(Clock(mapping.time, mapping.time_unit))
    if wrong := int(np.count_nonzero(stamps < 0)):
        raise ValueError(f"{path}: {wrong} rows without a time in {mapping.time!r}")
    frame: Any = pd.DataFrame({"stamp": stamps})
    for name in (*mapping.like, *mapping.figures):
        frame[name] = columns.column(name)
    for name in filter(None, (mapping.test, mapping.unit)):
        frame[name] = columns.texts.get(name, columns.values.get(name))
        if frame[name].isna().all():
            raise ValueError(f"{path}: {unknown_name('column', name, columns.values)}")
    frame["unit"] = frame[mapping.unit].astype(str) if mapping.unit else ""
    test = frame[mapping.test] if mapping.test else frame["stamp"] // 86_400_000_000_000
    by_name: dict[str, list[Move]] = {}
    for (name, _), rows in frame.groupby(["unit", test], sort=True):
        figures: dict[str, float] = {}
        groups = rows.groupby(list(mapping.like)) if mapping.like else [((), rows)]
        for key, alike in groups:
            condition = ", ".join(
                f"{name} {value:g}" for name, value in zip(mapping.like, key, strict=True)
            )
            for figure in mapping.figures:
                label = f"{figure} ({condition})" if condition else figure
                figures[label] = float(np.nanmedian(alike[figure]))
        by_name.setdefault(str(name), []).append(Move(int(rows["stamp"].min()), figures))
    for series in by_name.values():
        series.sort(key=lambda move: move.stamp_ns)
    return by_name
