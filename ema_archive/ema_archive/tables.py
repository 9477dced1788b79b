# SPDX-License-Identifier: Apache-2.0
"""Table schemas of an archive, and conversion of results to rows and back."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, fields, is_dataclass
from itertools import chain
from typing import Any, Final, get_args

import numpy as np
import pyarrow as pa

from ema_core.faults import FAULT_NAMES, N_FAULTS
from ema_monitor.identification.estimate import (
    Estimate,
    Verdict,
    estimate_of,
    estimate_values,
    plain,
)
from ema_monitor.prognosis.duty.damage import FlownDuty
from ema_monitor.prognosis.history_entry import Count
from ema_monitor.reasons import Reason
from ema_monitor.reports import HealthReport, ItemReport, Stamp

_TEXT: Final = pa.string()
_INT: Final = pa.int64()
_FLOAT: Final = pa.float64()
_STAMP: Final = pa.timestamp("us")  # UTC
_CAUSE: Final = pa.struct({"name": _TEXT, "value": _FLOAT, "sigma": _FLOAT})
REASON: Final = pa.struct({"code": _TEXT, "figures": _TEXT})
"""Type of a reason: code, and figures as JSON."""
_ALTERNATIVE: Final = pa.struct({"part": pa.list_(_TEXT), "stand_in": pa.list_(_TEXT)})
_QUANTITY: Final = pa.struct(
    {
        "name": _TEXT,
        "judgement": _TEXT,
        **dict.fromkeys(("change", "low", "high", "smallest_change"), _FLOAT),
        "unit": _TEXT,
        "reason": _TEXT,
        "reasons": pa.list_(REASON),
        "rivals": pa.list_(_TEXT),
    }
)
_COMPARISON: Final = pa.struct(
    {
        "quantities": pa.list_(_QUANTITY),
        "figures": pa.list_(pa.struct({"name": _TEXT, "ratio": _FLOAT, "probability": _FLOAT})),
        "probability": _FLOAT,
        "states": pa.map_(_TEXT, _FLOAT),
        "improvements": pa.list_(
            pa.struct(
                {
                    **{"name": _TEXT, "days": _INT, "records": _INT},
                    **dict.fromkeys(("present_change", "smallest_change"), _FLOAT),
                }
            )
        ),
    }
)
_UNIT: Final = {"actuator_id": _TEXT, "serial_number": _TEXT}
_MADE_BY: Final = {"software": _TEXT, "settings": _TEXT}
_TYPES: Final = {int: _INT, float: _FLOAT, bool: pa.bool_(), str: _TEXT, Verdict: _TEXT}
_OF_HEALTH_ELSEWHERE: Final = (
    "header",
    *_UNIT,
    *("received", "good_until", "author"),
    *("faults", "requirements"),
    *("growth_factor", "assumption", "cause", "removal"),
)
"""Fields of a health report that are not columns of ``health``: the unit, the fields that concern a
node, faults and requirements (table ``growth``), and texts that follow from the settings."""

_OF_ITEM_ELSEWHERE: Final = ("unit",)
"""Fields of a fault or requirement that are not columns: in the tables, ``unit`` is the name of the
actuator's unit."""


def _columns_of(report: type, without: Iterable[str] = ()) -> dict[str, pa.DataType]:
    """Return column types keyed by the names of a report's fields; ``_ns`` is added to stamps."""
    columns: dict[str, pa.DataType] = {}
    for item in fields(report):
        kind: Any = item.type
        if item.name in without:
            continue
        if kind is Stamp:
            columns[f"{item.name}_ns"] = _INT
        elif isinstance(kind, type) and is_dataclass(kind):
            columns[item.name] = pa.struct(_columns_of(kind))
        elif members := get_args(kind):
            columns[item.name] = pa.list_(pa.struct(_columns_of(members[0])))
        else:
            columns[item.name] = _TYPES[kind]
    return columns


_ESTIMATES: Final = pa.schema(
    {
        **_UNIT,
        "tested": _STAMP,
        **{
            item.name: _TYPES[item.type]  # pyright: ignore[reportArgumentType]
            for item in fields(Estimate)
            if item.type in _TYPES
        },
        **dict.fromkeys(FAULT_NAMES, _FLOAT),
        **{f"{name}_sigma": _FLOAT for name in FAULT_NAMES},
        **dict.fromkeys(("covariance", "quantiles", "probability"), pa.list_(_FLOAT)),
        **dict.fromkeys(("unobservable", "insignificant"), pa.list_(_TEXT)),
        **dict.fromkeys(("causes", "measured"), pa.list_(_CAUSE)),
        "reason": _TEXT,
        "reasons": pa.list_(REASON),
        "alternatives": pa.list_(_ALTERNATIVE),
        "parts": pa.list_(pa.list_(_FLOAT)),
        "comparison": _COMPARISON,
        "number": pa.int32(),
        "bag": _TEXT,
        "bag_sha256": _TEXT,
        **_MADE_BY,
    }
)
_USAGE: Final = pa.schema(
    {
        **_UNIT,
        "counted": _STAMP,
        "stamp_ns": _INT,
        "hours": _FLOAT,
        "cycles": _INT,
        "number": pa.int32(),
        "bag": _TEXT,
    }
)
_DUTY_LISTS: Final = {
    "travel": ("travel", "travel_load"),
    "winding": ("winding_hours", "winding_rise_hours"),
}
DUTY_LISTS: Final = tuple(chain.from_iterable(_DUTY_LISTS.values()))
"""Names of the duty columns that are lists, with one number per class."""

_DUTY: Final = pa.schema(
    {
        **_UNIT,
        "until": _STAMP,
        "stamp_ns": _INT,
        "hours": _FLOAT,
        **dict.fromkeys(DUTY_LISTS, pa.list_(_FLOAT)),
        "number": pa.int32(),
        "bag": _TEXT,
    }
)
HEALTH: Final = pa.schema(
    {
        **_UNIT,
        "tested": _STAMP,
        **_columns_of(HealthReport, _OF_HEALTH_ELSEWHERE),
        "calibration_id": _TEXT,
        **_MADE_BY,
    }
)
"""Columns of health and remaining life, one row per valid or refused test."""

BAG_TABLES: Final = {"estimates": _ESTIMATES, "usage": _USAGE, "duty": _DUTY}
"""Columns of the tables with results of bags: one row per window (``tested`` is its end), per count
of service hours, and per duty up to the end of a window or bag."""

STAMPS: Final = {"estimates": "end_ns", "usage": "stamp_ns", "duty": "stamp_ns"}
"""Name of the column with the timestamp of a row [ns], keyed by bag table."""

UNIT_TABLES: Final = {
    "health": HEALTH,
    "units": pa.schema([*HEALTH, pa.field("calibrated", _STAMP)]),
    "growth": pa.schema(
        {**_UNIT, "is_requirement": pa.bool_(), **_columns_of(ItemReport, _OF_ITEM_ELSEWHERE)}
    ),
    "lives": pa.schema(
        {
            "life": pa.int32(),
            "begin_hours": _FLOAT,
            "from_age": _FLOAT,
            "to_age": _FLOAT,
            "has_failed": pa.bool_(),
        }
    ),
    "months": pa.schema({"month": _TEXT, "windows": pa.int32(), "valid": pa.int32()}),
    "unordered": pa.schema({"bag": _TEXT, "number": pa.int32(), "tested": _STAMP, "reason": _TEXT}),
}
"""Columns of the tables with results of units.

- ``health``: one row per test.
- ``units``: one row per unit, with the health after its newest test and the modification time of
  its calibration.
- ``growth``: one row per fault and requirement of a unit, after its latest valid test.
- ``lives``: one row per life of a unit, from a repair to the first test with ERROR: service hours
  at its start, age at the first test, and age at the failure or the last test.
- ``months``: one row per month in which a unit was tested.
- ``unordered``: one row per valid window that is refused because the order of tests is unknown.
"""

PLACE: Final = ("model", "unit")
"""Leading columns of every table: model and unit."""


def placed(rows: pa.Table, model: str, unit: str) -> pa.Table:
    """Return a unit's rows with the columns ``PLACE`` added."""
    for name, value in zip(reversed(PLACE), (unit, model), strict=True):
        rows = rows.add_column(0, name, pa.array([value] * rows.num_rows, _TEXT))
    return rows


def estimate_row(estimate: Estimate, number: int) -> dict[str, Any]:
    """Convert an estimate to a row, without loss. The caller adds provenance and unit."""
    row = estimate_values(estimate)
    row |= row.pop("faults")
    row["reasons"] = reason_rows(estimate.reasons)
    row |= {f"{name}_sigma": value for name, value in estimate.sigma._asdict().items()}
    compared = estimate.comparison
    if compared is not None:
        if compared.states is not None:
            # Arrow represents a map as a list of pairs.
            row["comparison"]["states"] = list(compared.states.items())
        for change, item in zip(row["comparison"]["quantities"], compared.quantities, strict=True):
            change["reasons"] = reason_rows(item.reasons)
    for name in ("covariance", "quantiles"):
        row[name] = list(chain.from_iterable(row[name]))
    return row | {"tested": estimate.end_ns // 1000, "number": number}


def estimate_from(row: Mapping[str, Any]) -> Estimate:
    """Convert a row of `estimate_row` back to the estimate, identical to the last bit."""
    matrices = {name: np.reshape(row[name], (-1, N_FAULTS)) for name in ("covariance", "quantiles")}
    compared = row["comparison"]
    if compared is not None:
        states, quantities = compared["states"], compared["quantities"]
        compared = {
            **compared,
            "states": None if states is None else dict(states),
            "quantities": [item | {"reasons": _records(item["reasons"])} for item in quantities],
        }
    reasons = _records(row["reasons"])
    values = {**row, "faults": row, **matrices, "comparison": compared, "reasons": reasons}
    return estimate_of(values)


def reason_rows(reasons: Iterable[Reason]) -> list[dict[str, str]]:
    """Convert reasons to rows of type `REASON`."""
    rows = []
    for reason in reasons:
        figures = reason.as_record()
        code = figures.pop("code")
        rows.append({"code": code, "figures": json.dumps(plain(figures), ensure_ascii=False)})
    return rows


def reasons_from(rows: Iterable[Mapping[str, str]]) -> tuple[Reason, ...]:
    """Convert rows of `reason_rows` back to reasons."""
    return tuple(map(Reason.of_record, _records(rows)))


def _records(rows: Iterable[Mapping[str, str]]) -> list[dict[str, Any]]:
    return [{"code": row["code"], **json.loads(row["figures"])} for row in rows]


def count_row(count: Count, number: int) -> dict[str, Any]:
    """Convert a count of service hours and cycles to a row. The caller adds bag and unit."""
    hours = float(count.hours)
    return asdict(count) | {"counted": count.stamp_ns // 1000, "hours": hours, "number": number}


def duty_row(stamp_ns: int, flown: FlownDuty, number: int) -> dict[str, Any]:
    """Convert the duty up to ``stamp_ns`` to a row, without loss. The caller adds bag and unit.

    Lists have one item per class of load or winding temperature, as in `FlownDuty`.
    """
    row = {"until": stamp_ns // 1000, "stamp_ns": stamp_ns, "hours": float(flown.hours)}
    return row | duty_lists(flown) | {"number": number}


def duty_lists(flown: FlownDuty) -> dict[str, list[float]]:
    """Return the values of the columns `DUTY_LISTS`."""
    return {
        column: values
        for name, columns in _DUTY_LISTS.items()
        for column, values in zip(columns, getattr(flown, name).tolist(), strict=True)
    }


def duty_from(row: Mapping[str, Any]) -> FlownDuty:
    """Convert a row of `duty_row` back to the duty, identical to the last bit."""
    classes = {
        name: np.array([row[column] for column in columns]) for name, columns in _DUTY_LISTS.items()
    }
    return FlownDuty(row["hours"], **classes)


def health_row(report: HealthReport, calibration_id: str) -> dict[str, Any]:
    """Convert health and life after a test to a row. The caller adds provenance and unit."""
    row = _row_of(report, _OF_HEALTH_ELSEWHERE)
    tested_ns = row["tested_ns"]
    tested = tested_ns // 1000 if tested_ns else None
    return row | {"tested": tested, "calibration_id": calibration_id}


def growth_rows(report: HealthReport) -> list[dict[str, Any]]:
    """Return one row per fault and requirement after a test, without unit columns."""
    return [
        _row_of(item, _OF_ITEM_ELSEWHERE) | {"is_requirement": is_requirement}
        for items, is_requirement in ((report.faults, False), (report.requirements, True))
        for item in items
    ]


def _row_of(report: Any, without: Iterable[str] = ()) -> dict[str, Any]:
    """Convert a report to a row with the columns of ``_columns_of``."""
    row: dict[str, Any] = {}
    for item in fields(report):
        value = getattr(report, item.name)
        if item.name in without:
            continue
        if isinstance(value, Stamp):
            row[f"{item.name}_ns"] = value.ns
        elif is_dataclass(value):
            row[item.name] = _row_of(value)
        elif isinstance(value, tuple):
            row[item.name] = [_row_of(member) for member in value]
        else:
            row[item.name] = float(value) if item.type is float else value
    return row
