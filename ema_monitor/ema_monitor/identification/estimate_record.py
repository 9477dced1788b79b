"""An estimate as plain values, for JSON, and back."""

import math
from dataclasses import MISSING, fields
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import FAULT_NAMES, N_FAULTS
from ema_monitor.identification.estimate import Estimate

_FLAGS: Final = ("unobservable", "insignificant")


def estimate_record(estimate: Estimate) -> dict[str, Any]:
    """Return every field of an estimate as plain values, exactly.

    Faults are values by name, flags the names of those that have them. What is not a number is
    None; infinite values are text, for JSON has neither.

    Parameters
    ----------
    estimate
        The estimate.
    """
    record = {item.name: getattr(estimate, item.name) for item in fields(Estimate)}
    record["faults"] = by_fault(estimate.faults)
    record["covariance"] = [[plain_number(value) for value in row] for row in estimate.covariance]
    for name in _FLAGS:
        record[name] = [FAULT_NAMES[number] for number in np.flatnonzero(record[name])]
    return {
        name: plain_number(value) if isinstance(value, float | np.generic) else value
        for name, value in record.items()
    }


def estimate_of(record: dict[str, Any]) -> Estimate:
    """Return the estimate whose record it is.

    Parameters
    ----------
    record
        As of ``estimate_record``, or read from JSON.

    Raises
    ------
    ValueError, KeyError, TypeError
        When it is the record of none.
    """
    values = {item.name: record[item.name] for item in fields(Estimate) if item.name in record}
    for item in fields(Estimate):
        if item.name not in values and item.default is item.default_factory is MISSING:
            raise ValueError(f"{item.name} is missing")
        if item.type is float:
            values[item.name] = _number(values[item.name])
    values["faults"] = np.array([_number(record["faults"][name]) for name in FAULT_NAMES])
    values["covariance"] = np.array(
        [[_number(value) for value in row] for row in record["covariance"]]
    )
    if values["covariance"].shape != (N_FAULTS, N_FAULTS):
        raise ValueError(f"covariance has shape {values['covariance'].shape}")
    for name in _FLAGS:
        values[name] = np.isin(FAULT_NAMES, record.get(name, []))
    return Estimate(**values)


def by_fault(values: NDArray[np.float64]) -> dict[str, Any]:
    """Return values of the faults, ``(8,)``, by name.

    Parameters
    ----------
    values
        The values; those that are not a number become None.
    """
    return dict(zip(FAULT_NAMES, map(plain_number, values), strict=True))


def plain_number(value: Any) -> Any:
    """Return a number as JSON can hold it: None for NaN, text for an infinite one.

    Parameters
    ----------
    value
        Number of Python or numpy.
    """
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value


def _number(value: float | str | None) -> float:
    return math.nan if value is None else float(value)
