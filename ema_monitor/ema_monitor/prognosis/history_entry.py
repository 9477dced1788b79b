"""An entry of a history, and the line of its file that holds it."""

import json
import math
import zlib
from dataclasses import MISSING, asdict, dataclass, fields
from typing import Any, Final, Self

import numpy as np

from ema_core.faults import N_FAULTS
from ema_monitor.estimate import Estimate
from ema_monitor.prognosis.counts import Count
from ema_monitor.prognosis.measurement import Measurement

_SHAPES: Final = {
    "faults": (N_FAULTS,),
    "covariance": (N_FAULTS, N_FAULTS),
    "unobservable": (N_FAULTS,),
    "insignificant": (N_FAULTS,),
}
_FLAGS: Final = ("unobservable", "insignificant")
_CHECKSUM: Final = b', "crc32": "'
_WITHOUT_ESTIMATE: Final = "without_estimate_ns"


@dataclass(frozen=True, eq=False)
class Entry:
    """One valid test.

    Attributes
    ----------
    estimate
        What was found in its window.
    hours
        Service hour of the test [h]; NaN when not known.
    cycles
        Test cycles up to it, itself included.
    duty
        Future use that was assumed then, relative to that of the past [-].
    count
        The count that told the hours; None where nobody counted.

    Raises
    ------
    ValueError
        When the estimate is not valid, or a figure of it is impossible.
    """

    estimate: Estimate
    hours: float
    cycles: int
    duty: float
    count: Count | None = None

    def __post_init__(self) -> None:
        Measurement.of(self.estimate, 0.0 if math.isnan(self.hours) else self.hours)

    @property
    def stamp_ns(self) -> int:
        """Stamp of the window's end [ns]."""
        return self.estimate.end_ns

    def line(self) -> bytes:
        """Return the entry as a line of the file."""
        values: dict[str, Any] = {
            "hours": self.hours,
            "cycles": self.cycles,
            "duty": self.duty,
            "count": asdict(self.count) if self.count else None,
            "estimate": {item.name: getattr(self.estimate, item.name) for item in fields(Estimate)},
        }
        return as_line(values)

    @classmethod
    def of(cls, values: dict[str, Any]) -> Self:
        """Return the entry that the values of a line tell of.

        Raises
        ------
        ValueError, KeyError, TypeError
            When they tell of none.
        """
        found: dict[str, Any] = values["estimate"]
        for item in fields(Estimate):
            if item.name in _SHAPES:
                kind = bool if item.name in _FLAGS else np.float64
                array = np.array(found[item.name], dtype=kind)
                if array.shape != _SHAPES[item.name]:
                    raise ValueError(f"{item.name} has shape {array.shape}")
                found[item.name] = array
            elif item.name in found and item.type in (float, "float"):
                found[item.name] = _number(found[item.name])
            elif item.name not in found and item.default is MISSING:
                raise ValueError(f"{item.name} is missing")
        return cls(
            Estimate(**found),
            _number(values["hours"]),
            int(values["cycles"]),
            _number(values["duty"]),
            # Not in files of the first format.
            Count(**count) if (count := values.get("count")) else None,
        )


@dataclass(frozen=True)
class UnusedCycle:
    """A test cycle that counts as use and tells nothing of faults.

    Attributes
    ----------
    stamp_ns
        Stamp of the window's end [ns].
    """

    stamp_ns: int

    def line(self) -> bytes:
        """Return it as a line of the file."""
        return as_line({_WITHOUT_ESTIMATE: self.stamp_ns})


def read_line(line: bytes) -> Entry | UnusedCycle:
    """Return the test that a line of the file holds.

    Parameters
    ----------
    line
        The line, without its end.

    Raises
    ------
    ValueError, KeyError, TypeError
        When it holds none.
    """
    values = from_line(line)
    if _WITHOUT_ESTIMATE in values:
        return UnusedCycle(int(values[_WITHOUT_ESTIMATE]))
    return Entry.of(values)


def as_line(values: dict[str, Any]) -> bytes:
    """Return values as a line of JSON with a checksum; NaN becomes null.

    Parameters
    ----------
    values
        What the line holds by name.
    """
    text = json.dumps(_without_nan(values), ensure_ascii=False, allow_nan=False).encode()
    body = text.removesuffix(b"}")
    return body + _CHECKSUM + f'{zlib.crc32(body):08x}"}}\n'.encode()


def from_line(line: bytes) -> dict[str, Any]:
    """Return what a line holds without its checksum.

    Parameters
    ----------
    line
        The line, without its end.

    Raises
    ------
    ValueError
        When the checksum is wrong.
    """
    body, mark, checksum = line.rpartition(_CHECKSUM)
    if not mark or checksum != f'{zlib.crc32(body):08x}"}}'.encode():
        raise ValueError("a line is corrupted: its checksum is wrong")
    return json.loads(body + b"}")


def _without_nan(value: Any) -> Any:
    """Return a value with lists for arrays and None for NaN, which JSON does not have."""
    if isinstance(value, dict):
        return {name: _without_nan(item) for name, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
