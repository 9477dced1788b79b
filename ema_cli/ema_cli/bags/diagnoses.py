# SPDX-License-Identifier: Apache-2.0
"""Diagnoses of windows, with the true faults of their test cycles, live or from a bag."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.reader import Bag
from ema_bags.telemetry import ESTIMATE_TYPE, HEALTH_TYPE, TRUE_FAULTS_TYPE
from ema_core.faults import FAULT_NAMES, N_FAULTS
from ema_core.levels import STALE
from ema_monitor.joint.comparison import JUDGEMENTS, QuantityChange
from ema_monitor.reasons import StatedReason
from ema_monitor.recordings.windows import truth_at
from ema_ros.messages import StampedFaults, stamped_faults_from_message
from ema_ros.stamps import stamp_from_message

_LONGEST_LATENCY_S: Final = 600.0


@dataclass
class DiagnosedWindow:
    """Diagnosis of a window."""

    window: int
    """Running number of the window."""
    start_ns: int
    end_ns: int
    """Timestamps of the window's first and last sample [ns]."""
    faults: NDArray[np.float64]
    sigma: NDArray[np.float64]
    """Estimate and its standard deviation, ``(8,)``; NaN without an estimate."""
    valid: bool
    reason: str
    """Whether the estimate is usable, and the reason if it is not."""
    latency_s: float
    """Time from the end of the window to the reception of the estimate [s]."""
    cycle: int | None = None
    """Running number of the test cycle; None if the true faults are unknown."""
    truth: NDArray[np.float64] | None = None
    """True faults, ``(8,)``; None if unknown."""
    level: int | None = None
    """Level of health; None if unknown."""
    cause: str = ""
    """Reason for the level; empty without a warning."""
    quantities: tuple[QuantityChange, ...] = ()
    """Change of each quantity of a record; empty for the window of a modelled drive."""


@dataclass
class DiagnosisLog:
    """Diagnoses of one actuator in the order of their windows."""

    actuator_id: str = ""
    serial_number: str = ""
    """Identity of the actuator; empty before the first estimate."""
    truths: list[StampedFaults] = field(default_factory=list)
    """True faults of the test cycles, in chronological order."""
    limits: dict[str, float] = field(default_factory=dict)
    """Values at which life ends, keyed by fault."""
    remarks: list[str] = field(default_factory=list)
    """Defects of the bag."""
    _diagnosed: dict[int, DiagnosedWindow] = field(default_factory=dict)
    _levels: dict[int, tuple[int, str]] = field(default_factory=dict)

    def add(self, type_name: str, message: Any, received_ns: int) -> None:
        """Add a message, unless it belongs to another actuator than the first estimate.

        ``received_ns`` is the time of reception [ns].
        """
        if type_name == ESTIMATE_TYPE:
            self.actuator_id = self.actuator_id or message.actuator_id
            if message.actuator_id == self.actuator_id:
                self.serial_number = self.serial_number or message.serial_number
                covariance = np.reshape(message.covariance, (N_FAULTS, N_FAULTS))
                variances = np.diag(covariance)
                end_ns = stamp_from_message(message.window_end)
                self._diagnosed[end_ns] = DiagnosedWindow(
                    window=message.window,
                    start_ns=stamp_from_message(message.window_start),
                    end_ns=end_ns,
                    faults=np.array([getattr(message.faults, name) for name in FAULT_NAMES]),
                    sigma=np.sqrt(np.where(variances >= 0.0, variances, np.nan)),
                    valid=message.valid,
                    reason=message.reason,
                    latency_s=(received_ns - end_ns) * 1e-9,
                    # Bags of earlier versions have no quantities.
                    quantities=tuple(map(quantity_of, getattr(message, "quantities", ()))),
                )
        elif type_name == TRUE_FAULTS_TYPE:
            self.truths.append(stamped_faults_from_message(message))
        elif type_name == HEALTH_TYPE and message.actuator_id == self.actuator_id:
            stamp_ns = stamp_from_message(message.header.stamp)
            # A repeated health message may assess more faults, unless it has become stale.
            if message.level != STALE or stamp_ns not in self._levels:
                self._levels[stamp_ns] = message.level, message.cause
            self.limits.update({item.name: item.limit for item in message.faults})

    def diagnoses(self) -> list[DiagnosedWindow]:
        """Return the diagnoses in chronological order, with recorded true faults and levels."""
        truths = [item for item in self.truths if item.actuator_id == self.actuator_id]
        windows = [self._diagnosed[end_ns] for end_ns in sorted(self._diagnosed)]
        for window in windows:
            truth = truth_at(truths, window.start_ns)
            if truth is not None:
                window.cycle, window.truth = truth.cycle, truth.faults
            window.level, window.cause = self._levels.get(window.end_ns, (None, ""))
        return windows


def quantity_of(message: Any) -> QuantityChange:
    """Convert an ``ema_interfaces/msg/QuantityChange`` message.

    Raises
    ------
    ValueError
        If the number of the judgement is unknown.
    """
    if message.judgement >= len(JUDGEMENTS):
        raise ValueError(f"quantities: judgement = {message.judgement}, expected 0, 1 or 2")
    return QuantityChange(
        message.name,
        JUDGEMENTS[message.judgement],
        message.change,
        message.low,
        message.high,
        message.smallest_change,
        message.unit,
        (StatedReason(message.reason),) if message.reason else (),
        tuple(message.rivals),
    )


def read_history(path: Path, actuator_id: str | None = None) -> DiagnosisLog:
    """Read the diagnoses of an actuator from a bag.

    Raises
    ------
    ValueError
        If the bag has no estimates of the actuator, or estimates of several actuators and
        ``actuator_id`` is None.
    """
    bag = Bag(path)
    topics = bag.topics_of(ESTIMATE_TYPE, TRUE_FAULTS_TYPE, HEALTH_TYPE)
    recorded = list(bag.messages(topics))
    estimated = {item.message.actuator_id for item in recorded if item.type_name == ESTIMATE_TYPE}
    names = ", ".join(sorted(estimated))
    if not estimated:
        raise ValueError(f"{path} has no estimates: use `ema report` to compute them")
    if actuator_id is None and len(estimated) > 1:
        raise ValueError(
            f"{path} has estimates of several actuators: {names}: select one with --actuator-id"
        )
    if actuator_id is not None and actuator_id not in estimated:
        raise ValueError(f"{path} has no estimates of actuator {actuator_id!r}, only of {names}")
    history = DiagnosisLog(actuator_id or estimated.pop())
    for item in recorded:
        try:
            history.add(item.type_name, item.message, item.log_time_ns)
        except ValueError as error:
            bag.malformed.note(item, str(error))
    history.remarks += bag.remarks
    return history


def has_latency(diagnoses: list[DiagnosedWindow]) -> bool:
    """Return whether timestamps and reception times seem to share a clock.

    If they do, all latencies are between 0 and 600 s.
    """
    latencies = np.array([window.latency_s for window in diagnoses])
    return bool(np.all((latencies >= 0.0) & (latencies < _LONGEST_LATENCY_S)))
