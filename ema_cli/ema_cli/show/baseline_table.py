# SPDX-License-Identifier: Apache-2.0
"""Learned baselines as text: a table of joints, and the details of a joint."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from ema_core.dates import utc_minute
from ema_core.wording import counted, text_table
from ema_monitor.baselines.changes import BaselineChange
from ema_monitor.baselines.progress import BaselineProgress

_HEADINGS: Final = (
    *("joint", "serial number", "state", "records", "days", "same day", "other day", "accepted"),
)


@dataclass(frozen=True)
class BaselineSummary:
    """State of a learned baseline, for display."""

    actuator_id: str
    serial_number: str
    is_accepted: bool
    progress: BaselineProgress
    calibration_id: str = ""
    """Identity of the accepted calibration; empty while learning."""
    author: str = ""
    accepted_ns: int = 0
    """Person or rule that accepted the baseline, and time of the acceptance [ns]; 0 while
    learning."""

    @property
    def state(self) -> str:
        """State in capitals."""
        return "ACCEPTED" if self.is_accepted else "LEARNING"


def table(baselines: Iterable[BaselineSummary]) -> str:
    """Return a table of baselines, one line per joint."""
    rows = [
        (
            item.actuator_id,
            item.serial_number,
            item.state,
            _records(item.progress),
            str(item.progress.days),
            _percent(item.progress.detectable_same_day),
            _percent(item.progress.detectable_other_day),
            _accepted(item) or item.progress.reason or "-",
        )
        for item in baselines
    ]
    note = "same day, other day: smallest detectable change of friction"
    return f"{text_table(_HEADINGS, rows)}\n{note}"


def details(item: BaselineSummary, changes: Sequence[BaselineChange] | None) -> str:
    """Return state, progress and history of a baseline as text.

    ``changes`` is None if the history is unknown.
    """
    progress = item.progress
    lines = [f"{item.actuator_id} ({item.serial_number}): {item.state}"]
    if item.is_accepted:
        lines.append(f"calibration {item.calibration_id}, accepted by {_accepted(item)}")
    lines.append(f"{_records(progress)} records on {counted(progress.days, 'day')}")
    if math.isfinite(progress.slowest):
        lines.append(
            f"usual speeds {progress.slowest:.3g} to {progress.fastest:.3g}; "
            f"{_percent(progress.forward_share)} of the motion is forward"
        )
    if math.isfinite(progress.detectable_other_day):
        lines.append(
            f"changes of friction above {_percent(progress.detectable_same_day)} are detectable "
            f"on a day with records, above {_percent(progress.detectable_other_day)} on another "
            "day"
        )
    if progress.reason:
        lines.append(f"cannot be accepted yet: {progress.reason}")
    lines += [f"- {sentence}" for sentence in progress.advice]
    if changes is not None:
        lines += ["changes:" if changes else "no change so far", *map(str, changes)]
    return "\n".join(lines)


def _records(progress: BaselineProgress) -> str:
    needed = f" of {progress.records_needed}" if progress.records_needed else ""
    return f"{progress.records}{needed}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if math.isfinite(share) else "-"


def _accepted(item: BaselineSummary) -> str:
    if not item.is_accepted:
        return ""
    when = f", {utc_minute(item.accepted_ns)}" if item.accepted_ns else ""
    return f"{item.author or 'unknown'}{when}"
