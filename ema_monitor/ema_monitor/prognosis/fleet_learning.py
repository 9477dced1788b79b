"""What the histories of units say of growth, as a fleet."""

from collections.abc import Iterable

from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.fleet import Fleet, FleetUnit, unit_digest
from ema_monitor.prognosis.growth.fleet import grid_digest
from ema_monitor.prognosis.growth.settings import TrackerSettings
from ema_monitor.prognosis.growth_record import GrowthRecord
from ema_monitor.prognosis.history import History


def fleet_of(histories: Iterable[History], limits: HealthLimits, name: str = "") -> Fleet:
    """Return what histories say.

    Parameters
    ----------
    histories
        Of a unit each.
    limits
        Where lives end.
    name
        What the fleet is called; empty: nothing.
    """
    units = {}
    for history in histories:
        record = GrowthRecord(limits, TrackerSettings(), history.entries)
        faults = tuple(record.tracker.grown_faults())
        units[unit_digest(*history.unit)] = FleetUnit(record.tests, faults)
    return Fleet(grid_digest(limits), units, frozenset([name] if name else []))
