"""What is known of a unit after its tests so far, so that later ones need not repeat these."""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from ema_archive.tables import estimate_from
from ema_core.description import UnitKey
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.assessment import Assessment
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Count, Entry, UnusedCycle
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.prognosis.unit_event import UnitEvent
from ema_monitor.unit import Unit

Row = Mapping[str, Any]


@dataclass(frozen=True)
class KeptState:
    """State of the tracker of a unit, and what it rests on.

    It is no part of the results: losing it costs time alone.

    Attributes
    ----------
    made_by
        Identity of what health and life follow from, beside the tests.
    tests
        Number of its windows that it rests on, the refused ones included.
    digest
        Identity of these and of the counts up to them.
    growth
        State of the tracker.
    """

    made_by: str
    tests: int
    digest: str
    growth: bytes

    def as_bytes(self) -> bytes:
        """Return the state as a file holds it."""
        head = asdict(self)
        del head["growth"]
        return json.dumps(head).encode() + b"\n" + self.growth

    @classmethod
    def of_bytes(cls, content: bytes) -> "KeptState | None":
        """Return the state that a file holds; None when it is damaged."""
        head, _, growth = content.partition(b"\n")
        try:
            return cls(growth=growth, **json.loads(head))
        except (ValueError, TypeError):
            return None


def state_digest(estimates: Sequence[Row], usage: Sequence[Row]) -> str:
    """Return the identity of windows and of the counts up to the last of them."""
    digest = hashlib.sha256()
    names = ("end_ns", "bag_sha256", "number", "calibration_id", "software", "settings")
    for row in estimates:
        digest.update(" ".join(str(row[name]) for name in names).encode() + b"\n")
    last_ns = estimates[-1]["end_ns"] if estimates else 0
    for row in usage:
        if row["stamp_ns"] <= last_ns:
            words = f"{row['stamp_ns']} {row['hours']!r} {row['cycles']}\n"
            digest.update(words.encode())
    return digest.hexdigest()


def entry_columns(entry: Entry, assessment: Assessment) -> dict[str, Any]:
    """Return what the row of health after a test keeps of its entry in the history."""
    count = entry.count
    return {
        "entry_hours": float(entry.hours),
        "count_ns": None if count is None else count.stamp_ns,
        "count_hours": None if count is None else float(count.hours),
        "count_cycles": None if count is None else count.cycles,
        "alarms": [{"name": n, "level": level} for n, level in assessment.alarms.items()],
    }


def resumed(
    key: UnitKey,
    kept: KeptState,
    settings: PrognosisSettings,
    estimates: Sequence[Row],
    health: Sequence[Row],
) -> Unit | None:
    """Return the prognosis of a unit after the tests that a state rests on.

    Parameters
    ----------
    key
        Actuator and serial number.
    estimates
        Its windows up to there.
    health
        Its rows of health; later ones do not matter.

    Returns
    -------
    Unit
        None where a row is missing, so that all tests have to be repeated.
    """
    rows = {row["stamp_ns"]: row for row in health}
    history = History(*key)
    for row in estimates:
        estimate = estimate_from(row)
        if not estimate.valid:
            if not history.holds(estimate.end_ns):
                refused = UnusedCycle(estimate.end_ns, estimate.verdict, estimate.reason)
                history.append(refused)
        elif not history.holds_valid(estimate.end_ns):
            found = rows.get(estimate.end_ns)
            if found is None:
                return None
            history.append(_entry(estimate, found))
            history.assess(_assessment(found))
    history.growth = kept.growth
    return Unit(history, settings)


def _entry(estimate: Estimate, row: Row) -> Entry:
    count = None
    if row["count_ns"] is not None:
        count = Count(row["count_ns"], row["count_hours"], row["count_cycles"])
    return Entry(estimate, row["entry_hours"], row["cycles"], count)


def _assessment(row: Row) -> Assessment:
    life = None
    if row["rul_known"]:
        life = (row["rul_05"], row["rul_50"], row["rul_95"])
    return Assessment(
        row["stamp_ns"],
        row["hours"],
        row["level"],
        row["health_index"],
        row["dominant_fault"],
        life,
        {alarm["name"]: alarm["level"] for alarm in row["alarms"]},
        tuple(UnitEvent(**event) for event in row["events"]),
    )


def can_resume(settings: PrognosisSettings) -> bool:
    """Return whether a prognosis depends on what a state holds alone.

    Where hours by cycle take the place of counts, that is said once, at the first count.
    """
    return math.isclose(settings.service.hours_per_cycle, 0.0)
