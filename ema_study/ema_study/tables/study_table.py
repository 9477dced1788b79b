"""A table of the study, and tables as files."""

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd


@dataclass(frozen=True)
class StudyTable:
    """A table of the thesis beside ours.

    Attributes
    ----------
    number
        Of the thesis's table.
    title
        What it shows.
    frame
        Columns (source, quantity), rows as in the thesis; NaN where there is nothing.
    notes
        What to know to read it, a sentence each.
    """

    number: int
    title: str
    frame: pd.DataFrame
    notes: list[str] = field(default_factory=list)


def write_tables(tables: Iterable[StudyTable], folder: Path) -> list[Path]:
    """Write each table as ``table_<number>.csv``, and all of them as ``tables.json``.

    Parameters
    ----------
    tables
        The tables.
    folder
        Where to; it is made where it is missing.

    Returns
    -------
    list of pathlib.Path
        What was written, ``tables.json`` last.

    Notes
    -----
    In the CSV files a column is named "source: quantity". The JSON file is a list of objects:
    number, title, notes, file (the CSV file), index (names and rows), columns and data, null where
    there is nothing.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written, objects = [], []
    for table in tables:
        path = folder / f"table_{table.number:02d}.csv"
        flat = table.frame.copy()
        flat.columns = [": ".join(map(str, column)) for column in table.frame.columns]
        flat.to_csv(path, float_format="%.7g")
        written.append(path)
        objects.append(_as_object(table, path.name))
    path = folder / "tables.json"
    text = json.dumps(objects, indent=1, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")
    return [*written, path]


def _as_object(table: StudyTable, file: str) -> dict[str, Any]:
    frame = table.frame
    rows = [row if isinstance(row, tuple) else (row,) for row in frame.index]
    cells = frame.astype(object).where(frame.notna(), None).to_numpy().tolist()
    return {
        "number": table.number,
        "title": table.title,
        "notes": table.notes,
        "file": file,
        "index": {"names": list(frame.index.names), "rows": [list(row) for row in rows]},
        "columns": [list(column) for column in frame.columns],
        "data": cells,
    }
