"""Tables with one row a move, of drives that log no samples: tests in order of time, by unit."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ema_bags.inputs.mapping import TIMES_NS
from ema_bags.inputs.tables import read_columns, stamps_of
from ema_core.wording import unknown_name
from ema_core.yaml_file import load_yaml
from ema_monitor.normal.moves import Move


@dataclass(frozen=True)
class MovesMapping:
    """Which columns of a table of moves are what.

    Attributes
    ----------
    time
        Time of the move: dates, or numbers in ``time_unit``.
    figures
        Figures of each move that rise as the unit wears, all positive.
    like
        What was commanded, and the load: figures are compared where these are equal.
    test
        Moves with the same value make a test, whose figures are their medians; empty: the day.
    unit
        Serial number; empty: one unit.

    Raises
    ------
    ValueError
        When time or figures are missing, or the unit of time is unknown.
    """

    time: str
    figures: tuple[str, ...]
    time_unit: str = "s"
    like: tuple[str, ...] = ()
    test: str = ""
    unit: str = ""

    def __post_init__(self) -> None:
        for name in ("figures", "like"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if not self.time or not self.figures:
            raise ValueError("expected time, a column, and figures, a list of columns")
        if self.time_unit not in TIMES_NS:
            raise ValueError(unknown_name("time_unit", self.time_unit, TIMES_NS))


def load_moves_mapping(path: Path) -> MovesMapping:
    """Read a mapping.

    Raises
    ------
    ValueError
        When it is none; the message names the file.
    OSError
        When it cannot be read.
    """
    content = load_yaml(path)
    known = [item.name for item in fields(MovesMapping)]
    if not isinstance(content, dict) or not {"time", "figures"} <= content.keys():
        raise ValueError(f"{path}: expected a mapping with {', '.join(known)}")
    for name in content:
        if name not in known:
            raise ValueError(f"{path}: {unknown_name('entry', name, known)}")
    for name in ("figures", "like"):
        if not isinstance(content.get(name, []), list):
            raise ValueError(f"{path}: {name} = {content[name]!r}: expected a list of columns")
    try:
        return MovesMapping(**content)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def read_moves(path: Path, mapping: MovesMapping) -> dict[str, list[Move]]:
    """Return the tests of each unit, in order of time; a figure is named with what it is of.

    Raises
    ------
    ValueError
        When the file is no table, a column is missing or holds no numbers, or a row has no time.
    OSError
        When it cannot be read.
    """
    import pandas as pd

    columns = read_columns(path)
    frame: Any = pd.DataFrame({"stamp": _stamps(columns, mapping)})
    for name in (*mapping.like, *mapping.figures):
        frame[name] = columns.column(name)
    for name in filter(None, (mapping.test, mapping.unit)):
        frame[name] = columns.texts.get(name, columns.values.get(name))
        if frame[name].isna().all():
            raise ValueError(f"{path}: {unknown_name('column', name, columns.values)}")
    unit = frame[mapping.unit].astype(str) if mapping.unit else pd.Series("", frame.index)
    frame["unit"] = unit
    test = frame[mapping.test] if mapping.test else frame["stamp"] // 86_400_000_000_000
    found: dict[str, list[Move]] = {}
    for (name, _), rows in frame.groupby(["unit", test], sort=True):
        figures: dict[str, float] = {}
        groups = rows.groupby(list(mapping.like)) if mapping.like else [((), rows)]
        for key, alike in groups:
            of = ", ".join(f"{one} {value:g}" for one, value in zip(mapping.like, key, strict=True))
            for figure in mapping.figures:
                label = f"{figure} ({of})" if of else figure
                figures[label] = float(np.nanmedian(alike[figure]))
        found.setdefault(str(name), []).append(Move(int(rows["stamp"].min()), figures))
    for series in found.values():
        series.sort(key=lambda move: move.stamp_ns)
    return found


def _stamps(columns: Any, mapping: MovesMapping) -> Any:
    times = columns.column(mapping.time)
    unit = 1 if mapping.time in columns.dates else TIMES_NS[mapping.time_unit]
    stamps = stamps_of(times, unit)
    if wrong := int(np.count_nonzero(stamps < 0)):
        raise ValueError(f"{columns.path}: {wrong} rows without a time in {mapping.time!r}")
    return stamps
