# SPDX-License-Identifier: Apache-2.0
"""Reasons are values with a code: each has a sentence, and is restored from JSON."""

import json
import math
import re
from dataclasses import fields, replace
from enum import Enum
from typing import Any

import pytest

from ema_monitor.reason_texts import joined, text_of
from ema_monitor.reasons import (
    KINDS,
    DepartedFigure,
    MotorStill,
    NotConverged,
    NotMeasured,
    NoTravel,
    OtherUnit,
    Reason,
    RunTooShort,
    StateProbability,
    codes,
)

_RPM = ("unit", 60.0, "rpm", "rad/s")
_NAMES: dict[str, Any] = {
    "part": ("inertia",),
    "stand_ins": (("gain",), ("friction", "backlash")),
    "faults": ("friction", "gain"),
    "columns": ("position", "command"),
    "name": "load_torque",
    "mistake": _RPM,
    "mistakes": (_RPM, ("sign", -1.0, "", "")),
    "figures": (
        DepartedFigure("friction_current", math.inf, 0.1 + 0.2, 0.3),
        DepartedFigure("error_scatter_forward", 1.5, math.inf, math.inf),
    ),
    "states": (StateProbability("dry", 0.9), StateProbability("worn", 0.1)),
    "missing": ("current",),
    "missing_before": (),
    "changed": ("friction", "gravity"),
    "differences": (
        ("serial_number", "B", "A"),
        ("tau", 0.1 + 0.2, 0.3),
        ("drive", "x", "unknown"),
    ),
    "unit": ("flap", "A"),
    "bags": ("a.mcap", "b.mcap"),
    "empty": ("speed",),
    "filled": ("command",),
}


def made(kind: type[Reason]) -> Reason:
    """Return a reason with a value in each of its fields."""
    by_type = {float: 0.1 + 0.2, int: 3, bool: True, str: "speed"}
    value_fields = [item for item in fields(kind) if item.name not in ("stretches", "of_stretches")]
    values: dict[str, Any] = {
        item.name: next(iter(item.type))
        if isinstance(item.type, type) and issubclass(item.type, Enum)
        else _NAMES.get(item.name, by_type.get(item.type))
        for item in value_fields
    }
    return kind(**values)


REASONS = [made(kind) for kind in KINDS.values()]


@pytest.mark.parametrize("reason", REASONS, ids=KINDS)
def test_each_reason_has_a_sentence_with_its_values(reason: Reason):
    text = text_of(reason)
    assert text
    assert not text.endswith(".")
    assert not re.search(r"[{}]|None|reason\.|\br\.", text)


@pytest.mark.parametrize("reason", REASONS, ids=KINDS)
def test_each_reason_is_restored_from_json(reason: Reason):
    counted = replace(reason, stretches=2, of_stretches=5)
    for item in (reason, counted):
        assert Reason.of_record(json.loads(json.dumps(item.as_record()))) == item


def test_name_outside_of_its_set_is_refused():
    record = made(KINDS["not_determined"]).as_record() | {"subject": "bag"}
    with pytest.raises(ValueError, match="'bag' is not a valid Subject"):
        Reason.of_record(record)


def test_number_that_json_does_not_have_is_restored():
    reason = Reason.of_record({"code": "no_travel", "travel": None, "least": "inf"})
    assert isinstance(reason, NoTravel)
    assert math.isnan(reason.travel)
    assert reason.least == math.inf


def test_stretches_with_the_same_reason_are_counted_in_its_sentence():
    reason = NotConverged(stretches=2, of_stretches=5)
    assert text_of(reason) == ("the search was stopped before it converged (in 2 of 5 stretches)")


@pytest.mark.parametrize(
    ("reason", "text"),
    [
        (
            RunTooShort(0.01, 2.0, 200, 100, 0, is_record=True),
            "a record needs 2 s of motion, and the telemetry has only 1 s",
        ),
        (
            RunTooShort(0.01, 2.0, 200, 100, 7, is_record=True),
            "a record needs 2 s of motion, and the telemetry has at most 1 s without a gap "
            "(7 samples lost)",
        ),
        (
            RunTooShort(0.01, 0.5, 50, 40, 1, is_record=False),
            "a window of 0.5 s has 50 samples after its start, and there are never more than 40 "
            "samples without a gap (1 sample lost)",
        ),
    ],
)
def test_short_telemetry_is_compared_with_a_window_or_record(reason: RunTooShort, text: str):
    assert text_of(reason) == text


def test_codes_are_unique():
    reasons = (NotConverged(), MotorStill(), NotConverged(stretches=1, of_stretches=2))
    assert codes(reasons) == ("not_converged", "motor_still")
    assert joined(reasons).count("; ") == 2


def test_reasons_that_differ_only_in_numbers_are_of_one_kind():
    assert NoTravel(0.1, 0.5).kind == NoTravel(0.2, 0.5).kind
    assert NotMeasured("speed").kind != NotMeasured("current").kind
    tau, other_tau = (OtherUnit((("tau", value, 0.3),)) for value in (0.1, 0.2))
    assert tau.kind == other_tau.kind != OtherUnit((("k_t", 0.1, 0.3),)).kind
    assert replace(tau, stretches=2, of_stretches=5).kind == tau.kind
