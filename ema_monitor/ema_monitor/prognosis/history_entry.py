"""A test in the history of a unit, and its record in files of this and of earlier versions."""

import json
import math
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from ema_core.faults import FAULT_NAMES
from ema_core.quantity import is_finite_number
from ema_monitor.duty.flown import FlownDuty
from ema_monitor.identification.estimate import Estimate, estimate_of, estimate_record, plain_number
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.packed_estimate import pack, unpack

_MOST_HOURS: Final = 1e7
_MOST_CYCLES: Final = 10**12
_MOST: Final = 2**63
_FORMATS: Final = ("ema_history 1", "ema_history 2")
_CHECKSUM: Final = b', "crc32": "'


@dataclass(frozen=True, slots=True)
class Count:
    """Service life of a unit as it was counted.

    Attributes
    ----------
    stamp_ns
        When the counts were read [ns].
    hours
        Hours in service since new [h], at most 1e7.
    cycles
        Test cycles since new, at most 1e12; 0 when they are not counted.

    Raises
    ------
    ValueError
        When a figure is impossible; the message names it.
    """

    stamp_ns: int
    hours: float
    cycles: int

    def __post_init__(self) -> None:
        if not is_finite_number(self.hours) or not 0.0 <= self.hours <= _MOST_HOURS:
            raise ValueError(
                f"flight_hours = {self.hours:g} h: expected a number in [0, {_MOST_HOURS:g}]"
            )
        if not 0 <= self.cycles <= _MOST_CYCLES:
            raise ValueError(
                f"cycles = {self.cycles}: expected a whole number in [0, {_MOST_CYCLES:g}]"
            )


class Entry:
    """One valid test.

    Attributes
    ----------
    stamp_ns
        Stamp of the window's end [ns].
    hours
        Service hour of the test by ``hours_per_cycle`` [h]; NaN where it is counted or unknown.
    cycles
        Test cycles up to it, itself included.
    count
        The latest count of service hours before the test; None where there is none, or where
        ``hours_per_cycle`` holds.
    number
        Its number among all test cycles of its history, from 1 on; 0 as long as it is in none.

    Raises
    ------
    ValueError
        When the estimate is not valid, or a figure of it is impossible.
    """

    __slots__ = (
        "_estimate",
        "_file",
        "_flown",
        "_packed",
        "count",
        "cycles",
        "hours",
        "number",
        "stamp_ns",
    )

    def __init__(
        self,
        estimate: Estimate,
        hours: float,
        cycles: int,
        count: Count | None = None,
        flown: FlownDuty | None = None,
    ) -> None:
        Measurement.of(estimate, 0.0 if math.isnan(hours) else hours)
        self.stamp_ns = estimate.end_ns
        self.hours = hours
        self.cycles = cycles
        self.count = count
        self.number = 0
        self._flown = flown.as_array() if flown else None
        self._estimate: Estimate | None = estimate
        self._packed = b""
        self._file: EstimateFile | None = None

    @property
    def flown(self) -> FlownDuty | None:
        """Duty since the valid test before; made anew at each call."""
        return FlownDuty.of_array(self._flown) if self._flown else None

    @property
    def estimate(self) -> Estimate:
        """Estimate of its window; made anew at each call once it is packed, or left to a file.

        Raises
        ------
        ValueError
            When it is in a file and cannot be read.
        """
        if (kept := self.in_memory) is None and self._file is not None:
            return self._file.estimate_of(self)
        # It may just have been taken back from the file.
        return kept or unpack(self._packed)

    @property
    def in_memory(self) -> Estimate | None:
        """The estimate, as ``estimate`` gives it; None when it is in a file alone."""
        return self._estimate or (unpack(self._packed) if self._packed else None)

    def pack(self) -> None:
        """Keep the estimate in a quarter of the memory, as one that is seldom read."""
        if self._estimate is not None:
            # In this order: another thread may be reading.
            self._packed = pack(self._estimate)
            self._estimate = None

    def leave_to(self, file: "EstimateFile") -> None:
        """Keep the estimate no longer: a file gives it from now on."""
        self._file = file
        self._estimate, self._packed = None, b""

    def take_back(self, estimate: Estimate) -> None:
        """Keep the estimate that was left to a file."""
        self._packed = pack(estimate)
        self._file = None


class EstimateFile(Protocol):
    """Where estimates are that are not in memory; any thread may read."""

    def estimate_of(self, entry: Entry) -> Estimate:
        """Return the estimate of a test; ValueError when it cannot be read."""
        ...


@dataclass(frozen=True, slots=True)
class UnusedCycle:
    """A test cycle that counts as use but has no valid estimate.

    Attributes
    ----------
    stamp_ns
        Stamp of the window's end [ns].
    flown
        Duty since the test cycle before; None where no telemetry tells it.
    """

    stamp_ns: int
    flown: FlownDuty | None = None


@contextmanager
def as_value_error() -> Iterator[None]:
    """Raise ``ValueError`` for whatever else a record that is none makes its reader raise."""
    try:
        yield
    except (ArithmeticError, AttributeError, IndexError, RecursionError) as error:
        raise ValueError(f"it is no record: {error!r}") from error


def whole(record: Mapping[str, Any], name: str) -> int:
    """Return a number of a record that is whole and has 64 bits; raise ``ValueError`` else."""
    value = record[name]
    if isinstance(value, bool) or not isinstance(value, int) or not -_MOST <= value < _MOST:
        raise ValueError(f"{name} = {str(value)[:40]}: expected a whole number of 64 bits")
    return value


def as_text(test: Entry | UnusedCycle) -> str:
    """Return a test as JSON."""
    record: dict[str, Any] = {"end_ns": test.stamp_ns}
    if isinstance(test, Entry):
        record |= {
            "hours": plain_number(test.hours),
            "cycles": test.cycles,
            "count": asdict(test.count) if test.count else None,
            "estimate": estimate_record(test.estimate),
        }
    if test.flown is not None:
        record["duty"] = test.flown.as_record()
    return json.dumps(record, ensure_ascii=False, allow_nan=False)


@as_value_error()
def entry_of(text: str) -> Entry | UnusedCycle:
    """Return the test that a text of ``as_text`` describes.

    Raises
    ------
    ValueError, KeyError, TypeError
        When it describes none.
    """
    record: dict[str, Any] = json.loads(text)
    flown = FlownDuty.of_record(record["duty"]) if "duty" in record else None
    if "estimate" not in record:
        return UnusedCycle(whole(record, "end_ns"), flown)
    hours, count = record["hours"], record["count"]
    return Entry(
        estimate_of(record["estimate"]),
        math.nan if hours is None else hours,
        whole(record, "cycles"),
        Count(**count) if count else None,
        flown,
    )


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
    *whole, rest = path.read_bytes().split(b"\n")
    header, *lines = whole or [b""]
    tests: list[Entry | UnusedCycle] = []
    number = 1
    result = f"without line {len(whole) + 1}, which is cut off" if rest else "which stays as it is"
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
    return Entry(
        estimate_of(estimate),
        math.nan if count or hours is None else hours,
        whole(values, "cycles"),
        Count(**count) if count else None,
    )
