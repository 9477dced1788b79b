"""The tables of an archive: their columns, and estimates, counts and outlooks as their rows."""

import math
from collections.abc import Mapping
from dataclasses import asdict, fields
from itertools import chain
from typing import Any, Final

import numpy as np
import pyarrow as pa

from ema_core.faults import FAULT_NAMES, N_FAULTS
from ema_monitor.identification.estimate import Estimate, estimate_of, estimate_values
from ema_monitor.prognosis.growth.prediction import RemainingLife
from ema_monitor.prognosis.history_entry import Count
from ema_monitor.prognosis.outlook import Outlook

_STAMP: Final = pa.timestamp("us")  # UTC
_CAUSE: Final = pa.struct([("name", pa.string()), ("value", pa.float64()), ("sigma", pa.float64())])
_EVENT: Final = pa.struct(
    [
        ("stamp_ns", pa.int64()),
        ("hours", pa.float64()),
        ("kind", pa.string()),
        ("text", pa.string()),
    ]
)
_PROVENANCE: Final = [
    ("bag", pa.string()),
    ("bag_sha256", pa.string()),
    ("software", pa.string()),
    ("settings", pa.string()),
]
_UNIT: Final = [("actuator_id", pa.string()), ("serial_number", pa.string())]
_TYPES: Final = {int: pa.int64(), float: pa.float64(), bool: pa.bool_(), str: pa.string()}
_FLAGS: Final = ("unobservable", "insignificant")
_CAUSES: Final = ("causes", "measured")
_PLAIN: Final = [
    (item.name, _TYPES[item.type])  # pyright: ignore[reportArgumentType]
    for item in fields(Estimate)
    if item.type in _TYPES
]

ESTIMATES: Final = pa.schema(
    [
        *_UNIT,
        ("tested", _STAMP),
        *_PLAIN,
        *((name, pa.float64()) for name in FAULT_NAMES),
        *((f"{name}_sigma", pa.float64()) for name in FAULT_NAMES),
        ("covariance", pa.list_(pa.float64())),
        *((name, pa.list_(pa.string())) for name in _FLAGS),
        *((name, pa.list_(_CAUSE)) for name in _CAUSES),
        ("alternatives", pa.list_(pa.list_(pa.string()))),
        ("number", pa.int32()),
        *_PROVENANCE,
    ]
)
"""A row for each window, valid or not; ``tested`` is its end."""

USAGE: Final = pa.schema(
    [
        *_UNIT,
        ("counted", _STAMP),
        ("stamp_ns", pa.int64()),
        ("hours", pa.float64()),
        ("cycles", pa.int64()),
        ("number", pa.int32()),
        ("bag", pa.string()),
    ]
)
"""A row for each count of service hours."""

_LIVES: Final = ("rul", "rul_faults", "rul_requirements")
_LIFE: Final = [
    ("{}_known", pa.bool_()),
    ("{}_05", pa.float64()),
    ("{}_50", pa.float64()),
    ("{}_95", pa.float64()),
    ("{}_criterion", pa.string()),
    ("{}_reason", pa.string()),
]

_REMOVAL: Final = ("risk", "hours", "cycles", "days")

HEALTH: Final = pa.schema(
    [
        *_UNIT,
        ("tested", _STAMP),
        ("stamp_ns", pa.int64()),
        ("hours", pa.float64()),
        ("cycles", pa.int64()),
        ("hours_per_cycle", pa.float64()),
        ("level", pa.int8()),
        ("last_level", pa.int8()),
        ("health_index", pa.float64()),
        ("severity", pa.int8()),
        ("confidence", pa.float64()),
        ("dominant_fault", pa.string()),
        *((name.format(life), kind) for life in _LIVES for name, kind in _LIFE),
        ("events", pa.list_(_EVENT)),
        ("reason", pa.string()),
        *((f"removal_{name}", pa.float64()) for name in _REMOVAL),
        ("calibration_id", pa.string()),
        ("entry_hours", pa.float64()),
        ("count_ns", pa.int64()),
        ("count_hours", pa.float64()),
        ("count_cycles", pa.int64()),
        ("alarms", pa.list_(pa.struct([("name", pa.string()), ("level", pa.int8())]))),
        ("software", pa.string()),
        ("settings", pa.string()),
    ]
)
"""A row for each test, valid or refused: health and remaining life after it."""

GROWTH: Final = pa.schema(
    [
        *_UNIT,
        ("item", pa.string()),
        ("is_requirement", pa.bool_()),
        ("level", pa.int8()),
        ("value", pa.float64()),
        ("sigma", pa.float64()),
        ("limit", pa.float64()),
        ("limit_is_lower", pa.bool_()),
        ("share", pa.float64()),
        ("trend_per_hour", pa.float64()),
        *((name.format("rul"), kind) for name, kind in _LIFE),
    ]
)
"""A row for each fault and requirement of a unit, after its latest valid test."""


def estimate_row(one: Estimate, number: int) -> dict[str, Any]:
    """Return an estimate as a row, exactly; provenance and unit are the caller's to add.

    Parameters
    ----------
    number
        Running number of the window in its bag.
    """
    row = estimate_values(one)
    row |= row.pop("faults")
    row |= {f"{name}_sigma": value for name, value in one.sigma._asdict().items()}
    row["covariance"] = list(chain.from_iterable(row["covariance"]))
    return row | {"tested": one.end_ns // 1000, "number": number}


def estimate_from(row: Mapping[str, Any]) -> Estimate:
    """Return the estimate that a row of `estimate_row` holds, to the bit."""
    covariance = np.reshape(row["covariance"], (N_FAULTS, N_FAULTS))
    return estimate_of({**row, "faults": row, "covariance": covariance})


def count_row(count: Count, number: int) -> dict[str, Any]:
    """Return a count as a row; bag and unit are the caller's to add."""
    return {
        "counted": count.stamp_ns // 1000,
        "stamp_ns": count.stamp_ns,
        "hours": float(count.hours),
        "cycles": count.cycles,
        "number": number,
    }


def count_from(row: Mapping[str, Any]) -> Count:
    """Return the count that a row holds."""
    return Count(row["stamp_ns"], row["hours"], row["cycles"])


def health_row(outlook: Outlook, calibration_id: str) -> dict[str, Any]:
    """Return health and life after a test as a row; provenance and unit are the caller's to add."""
    health, stamp_ns = outlook.health, outlook.claim.measured_ns
    row: dict[str, Any] = {
        "tested": stamp_ns // 1000 if stamp_ns else None,
        "stamp_ns": stamp_ns,
        "hours": float(outlook.hours),
        "cycles": outlook.cycles,
        "hours_per_cycle": float(outlook.hours_per_cycle),
        "level": health.level,
        "last_level": outlook.known_level,
        "health_index": float(health.health_index),
        "severity": health.severity,
        "confidence": float(health.confidence),
        "dominant_fault": outlook.dominant,
        "events": [asdict(event) for event in outlook.events],
        "reason": health.reason,
        "calibration_id": calibration_id,
    }
    row |= {f"removal_{name}": float(getattr(outlook.removal, name)) for name in _REMOVAL}
    for name in _LIVES:
        row |= _life(name, getattr(outlook, name))
    return row


def growth_rows(outlook: Outlook) -> list[dict[str, Any]]:
    """Return what is known of each fault and requirement after a test; the unit is to be added."""
    rows = []
    requirements = {item.name for item in outlook.health.requirements}
    for item in (*outlook.health.faults, *outlook.health.requirements):
        life = outlook.lives.get(item.name)
        rows.append(
            {
                "item": item.name,
                "is_requirement": item.name in requirements,
                "level": item.level,
                "value": float(item.value),
                "sigma": float(item.sigma),
                "limit": float(item.limit),
                "limit_is_lower": item.limit_is_lower,
                "share": float(item.share),
                "trend_per_hour": float(outlook.trends.get(item.name, math.nan)),
                **_life("rul", life or RemainingLife.unknown("", outlook.rul.reason)),
            }
        )
    return rows


def _life(name: str, life: RemainingLife) -> dict[str, Any]:
    return {
        f"{name}_known": life.known,
        f"{name}_05": float(life.hours_05),
        f"{name}_50": float(life.hours_50),
        f"{name}_95": float(life.hours_95),
        f"{name}_criterion": life.criterion,
        f"{name}_reason": life.reason,
    }
