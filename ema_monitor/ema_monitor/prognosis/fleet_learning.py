"""What the histories of units say of growth, as a fleet."""

from collections.abc import Iterable

from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.fleet import Fleet, FleetUnit, unit_digest
from ema_monitor.prognosis.growth.fleet import GrownFault, grid_digest
from ema_monitor.prognosis.growth.outliers import REPAIR
from ema_monitor.prognosis.growth.settings import TrackerSettings
from ema_monitor.prognosis.growth_record import GrowthRecord
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Entry


def fleet_of(histories: Iterable[History], limits: HealthLimits, name: str = "") -> Fleet:
    """Return what histories say.

    Parameters
    ----------
    histories
        Of a unit each. A fault that was repaired counts as it grew until then, and again if it
        grows after it.
    limits
        Where lives end.
    name
        What the fleet is called; empty: nothing.
    """
    units = {unit_digest(*history.unit): _unit_of(history, limits) for history in histories}
    return Fleet(grid_digest(limits), units, frozenset([name] if name else []))


def _unit_of(history: History, limits: HealthLimits) -> FleetUnit:
    entries: list[Entry] = []
    record = GrowthRecord(limits, TrackerSettings(), entries)
    repaired: list[GrownFault] = []
    growing: dict[str, GrownFault] = {}
    for entry in history.entries:
        before, findings = growing, record.add(entry)
        entries.append(entry)
        growing = record.tracker.grown_faults()
        if any(finding.kind == REPAIR for finding in findings):
            repaired += [fault for name, fault in before.items() if name not in growing]
    return FleetUnit(record.tests, (*repaired, *growing.values()))
