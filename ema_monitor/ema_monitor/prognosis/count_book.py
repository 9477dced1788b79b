"""Counts of service life, kept for the units that they are of."""

import threading
from collections import OrderedDict
from typing import Final

from ema_monitor.prognosis.counts import Count, KeptCounts

Unit = tuple[str, str]
"""``actuator_id`` and ``serial_number``."""

_MOST_COUNTS: Final = 100
_MOST_UNITS: Final = 1000
# No unit is without a serial number.
_UNNAMED: Final = ""


class CountBook:
    """Keeps the latest counts of each unit, one a second, until somebody asks for them.

    A count without serial number that comes before the actuator is described belongs to the unit
    that is described first. Any thread may call. Of more than a thousand units, those not heard
    of for longest are forgotten; of more than a hundred counts of a unit, those that came first.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: OrderedDict[Unit, KeptCounts] = OrderedDict()

    def add(self, actuator_id: str, serial_number: str, count: Count) -> None:
        """Keep a count.

        Parameters
        ----------
        actuator_id
            Which actuator.
        serial_number
            Which unit; empty as long as that is not known.
        count
            The count.
        """
        with self._lock:
            self._page((actuator_id, serial_number or _UNNAMED)).add(count)

    def name(self, actuator_id: str, serial_number: str) -> None:
        """Give what was counted of an actuator that was not described to the unit that it is.

        Parameters
        ----------
        actuator_id, serial_number
            The unit.
        """
        with self._lock:
            early = self._counts.pop((actuator_id, _UNNAMED), None)
            if early is None:
                return
            unit = (actuator_id, serial_number)
            named = self._counts.pop(unit, None)
            page = self._page(unit)
            # Of counts of the same stamp, one that names the unit holds.
            for count in (*early.all(), *(named.all() if named else ())):
                page.add(count)

    def take(self, actuator_id: str, serial_number: str) -> list[Count]:
        """Return what was counted of a unit and strike it out.

        Parameters
        ----------
        actuator_id, serial_number
            The unit.
        """
        with self._lock:
            page = self._counts.pop((actuator_id, serial_number), None)
            return page.all() if page else []

    def _page(self, unit: Unit) -> KeptCounts:
        page = self._counts.setdefault(unit, KeptCounts(_MOST_COUNTS))
        self._counts.move_to_end(unit)
        if len(self._counts) > _MOST_UNITS:
            self._counts.popitem(last=False)
        return page
