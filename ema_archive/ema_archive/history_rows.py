# SPDX-License-Identifier: Apache-2.0
"""Storage of a unit's history as rows: tests, assessments and growth state."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import pyarrow as pa

from ema_archive.tables import (
    DUTY_LISTS,
    REASON,
    duty_from,
    duty_lists,
    estimate_from,
    reason_rows,
    reasons_from,
)
from ema_core.description import UnitKey
from ema_monitor.identification.estimate import Verdict
from ema_monitor.prognosis.duty.damage import NOTHING_FLOWN
from ema_monitor.prognosis.events import Occurrence, UnitEvent
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Assessment, Count, Entry, Test, UnusedCycle
from ema_monitor.prognosis.order import moved

Row = Mapping[str, Any]

_TEXT: Final = pa.string()
_INT: Final = pa.int64()
_FLOAT: Final = pa.float64()
_LEVELS: Final = pa.map_(_TEXT, pa.int8())
_EVENT: Final = pa.struct(
    {"stamp_ns": _INT, "flight_hours": _FLOAT, "code": _TEXT, "figures": _TEXT}
)

TESTS: Final = "manifest.test"
ASSESSMENTS: Final = "manifest.assessment"
GROWTH: Final = "manifest.growth"

_CHUNK: Final = 8192
"""Size of a stored piece of the growth state [bytes]; DuckDB rewrites neighbouring rows
together."""

HISTORY_TABLES: Final = {
    TESTS: pa.schema(
        {
            "number": pa.int32(),
            "end_ns": _INT,
            "is_valid": pa.bool_(),
            "hours": _FLOAT,
            "cycles": _INT,
            "count": pa.struct({"stamp_ns": _INT, "hours": _FLOAT, "cycles": _INT}),
            "flown": pa.struct({"hours": _FLOAT, **dict.fromkeys(DUTY_LISTS, pa.list_(_FLOAT))}),
            "shift_ns": _INT,
            "unordered": pa.list_(REASON),
        }
    ),
    ASSESSMENTS: pa.schema(
        {
            "stamp_ns": _INT,
            "flight_hours": _FLOAT,
            "level": pa.int8(),
            "health_index": _FLOAT,
            "dominant_fault": _TEXT,
            "life": pa.list_(_FLOAT),
            "alarms": _LEVELS,
            "events": pa.list_(_EVENT),
            "unconfirmed": _LEVELS,
        }
    ),
    GROWTH: pa.schema({"number": pa.int32(), "state": pa.binary()}),
}
"""Columns of the history tables: one row per test (which refers to its window by ``end_ns``), per
assessment, and per piece of the growth state. Columns are named like the fields of ``Entry``,
``UnusedCycle`` and ``Assessment``. ``unordered`` states why the order of tests is unknown; empty if
it is known. ``code`` and ``figures`` of an event are the code and the other fields of its
occurrence, the latter as JSON."""


@dataclass(frozen=True)
class KeptHistory:
    """History of a unit as rows, with the identity of its inputs."""

    made_by: str
    """Identity of settings and code."""
    digest: str
    """Digest of windows, counts and duty."""
    windows: int
    """Number of windows in the history."""
    tables: Mapping[str, pa.Table]
    """Rows, keyed by the names in ``HISTORY_TABLES``."""


def kept_history(
    history: History, growth: bytes, made_by: str, digest: str, windows: int
) -> KeptHistory:
    """Convert a history and its growth state to rows, without loss.

    ``made_by``, ``digest`` and ``windows`` are as in `KeptHistory`.
    """
    tests = [_test_row(number, test) for number, test in enumerate(history.tests)]
    assessments = [_assessment_row(assessment) for assessment in history.assessments.values()]
    pieces = [growth[begin : begin + _CHUNK] for begin in range(0, len(growth), _CHUNK)]
    states = [{"number": number, "state": piece} for number, piece in enumerate(pieces)]
    rows = {TESTS: tests, ASSESSMENTS: assessments, GROWTH: states}
    tables = {name: pa.Table.from_pylist(of, HISTORY_TABLES[name]) for name, of in rows.items()}
    return KeptHistory(made_by, digest, windows, tables)


def history_from(kept: KeptHistory, unit: UnitKey, windows: Iterable[Row]) -> History:
    """Rebuild a history from its rows, identical to the last bit.

    Parameters
    ----------
    kept
        The rows.
    unit
        Actuator id and serial number.
    windows
        Rows of the estimates of its tests.
    """
    history, by_end = History(*unit), {row["end_ns"]: row for row in windows}
    for row in kept.tables[TESTS].to_pylist():
        history.append(_test_from(row, by_end[row["end_ns"]]))
    for row in kept.tables[ASSESSMENTS].to_pylist():
        history.assess(_assessment_from(row))
    history.growth = b"".join(kept.tables[GROWTH]["state"].to_pylist())
    return history


def _test_row(number: int, test: Test) -> dict[str, Any]:
    row: dict[str, Any] = {
        "number": number,
        "end_ns": test.end_ns,
        "is_valid": isinstance(test, Entry),
        "shift_ns": test.shift_ns,
        "unordered": [],
    }
    if test.flown.hours:
        row["flown"] = {"hours": float(test.flown.hours), **duty_lists(test.flown)}
    if isinstance(test, Entry):
        count = None if test.count is None else asdict(test.count)
        return row | {"hours": float(test.hours), "cycles": test.cycles, "count": count}
    return row if test.is_ordered else row | {"unordered": reason_rows(test.reasons)}


def _test_from(row: Row, window: Row) -> Test:
    estimate, flown = moved(estimate_from(window), row["shift_ns"]), NOTHING_FLOWN
    if row["flown"] is not None:
        flown = duty_from(row["flown"])
    if row["is_valid"]:
        count = None if row["count"] is None else Count(**row["count"])
        return Entry(estimate, row["hours"], row["cycles"], count, flown, row["shift_ns"])
    test = UnusedCycle.of(estimate, flown, row["shift_ns"])
    if not row["unordered"]:
        return test
    return UnusedCycle(
        test.stamp_ns,
        Verdict.REFUSED,
        reasons_from(row["unordered"]),
        flown,
        shift_ns=row["shift_ns"],
        is_ordered=False,
    )


def _assessment_row(assessment: Assessment) -> dict[str, Any]:
    # Arrow represents a map as a list of pairs.
    return asdict(replace(assessment, events=())) | {
        "events": [_event_row(event) for event in assessment.events],
        "alarms": list(assessment.alarms.items()),
        "unconfirmed": list(assessment.unconfirmed.items()),
    }


def _assessment_from(row: Row) -> Assessment:
    life: Sequence[float] | None = row["life"]
    return Assessment(
        **{
            **row,
            "life": None if life is None else (life[0], life[1], life[2]),
            "alarms": dict(row["alarms"]),
            "events": tuple(map(_event_from, row["events"])),
            "unconfirmed": dict(row["unconfirmed"]),
        }
    )


def _event_row(event: UnitEvent) -> dict[str, Any]:
    figures = event.occurrence.as_record()
    code = figures.pop("code")
    text = json.dumps(figures, ensure_ascii=False)
    return {
        "stamp_ns": event.stamp_ns,
        "flight_hours": event.flight_hours,
        "code": code,
        "figures": text,
    }


def _event_from(row: Row) -> UnitEvent:
    record = {"code": row["code"], **json.loads(row["figures"])}
    return UnitEvent(row["stamp_ns"], row["flight_hours"], Occurrence.of_record(record))
