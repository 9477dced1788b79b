"""Histories of version 0.1, files of JSON lines, as tests."""

import json
import math
import zlib
from pathlib import Path
from typing import Any, Final

import numpy as np

from ema_core.faults import FAULT_NAMES
from ema_monitor.identification.estimate import estimate_of
from ema_monitor.prognosis.history_entry import (
    Entry,
    UnusedCycle,
    as_value_error,
    count_of,
    cycles_of,
    whole,
)

_FORMATS: Final = ("ema_history 1", "ema_history 2")
_CHECKSUM: Final = b', "crc32": "'


def import_lines(
    path: Path, actuator_id: str, serial_number: str
) -> tuple[list[Entry | UnusedCycle], str]:
    """Return the tests in a file of an earlier version, and the result of the import in words.

    The file is left as it is. Of a damaged one, or one of another unit, the tests before the damage
    are returned.

    Raises
    ------
    OSError
        When it cannot be read.
    """
    # What follows the last line break is a line that a kill cut off.
    *complete, rest = path.read_bytes().split(b"\n")
    header, *lines = complete or [b""]
    tests: list[Entry | UnusedCycle] = []
    number = 1
    result = (
        f"without line {len(complete) + 1}, which is cut off" if rest else "which stays as it is"
    )
    try:
        values = _values(header)
        if values.get("format") not in _FORMATS:
            raise ValueError(f"format {values.get('format')!r} is none of {', '.join(_FORMATS)}")
        unit = (values.get("actuator_id"), values.get("serial_number"))
        if unit != (actuator_id, serial_number):
            raise ValueError(f"it is of unit {unit}, not {(actuator_id, serial_number)}")
        for line in lines:
            number += 1
            with as_value_error():
                tests.append(_test(_values(line)))
    except (ValueError, KeyError, TypeError) as error:
        result = f"not all: line {number} is damaged or of another kind: {error}"
    return tests, f"{len(tests)} test cycles are imported from {path.name}, {result}"


def _values(line: bytes) -> dict[str, Any]:
    body, mark, checksum = line.rpartition(_CHECKSUM)
    if not mark or checksum != f'{zlib.crc32(body):08x}"}}'.encode():
        raise ValueError("its checksum is wrong")
    return json.loads(body + b"}")


def _test(values: dict[str, Any]) -> Entry | UnusedCycle:
    if "without_estimate_ns" in values:
        return UnusedCycle(whole(values, "without_estimate_ns"))
    estimate = values["estimate"]
    estimate["faults"] = dict(zip(FAULT_NAMES, estimate["faults"], strict=True))
    for name in ("unobservable", "insignificant"):
        estimate[name] = [FAULT_NAMES[number] for number in np.flatnonzero(estimate[name])]
    count, hours = values.get("count"), values["hours"]
    whole(estimate, "end_ns")
    return Entry(
        estimate_of(estimate),
        math.nan if count or hours is None else hours,
        cycles_of(values),
        count_of(count) if count else None,
    )
