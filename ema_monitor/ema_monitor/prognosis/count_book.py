"""Counts of service life, kept for the units that they are of."""

import threading
from collections import OrderedDict, deque
from typing import Final

from ema_monitor.prognosis.usage import Count

Unit = tuple[str, str]
"""``actuator_id`` and ``serial_number``."""

_MOST_COUNTS: Final = 100
_MOST_UNITS: Final = 1000
# No unit is without a serial number.
_UNNAMED: Final = ""


class CountBook:
    """Keeps the latest hundred counts of each unit until somebody asks for them.

    A count without serial number that comes before the actuator is described belongs to the unit
    that is described first. Any thread may call. Of more than a thousand units, those not heard
    of for longest are forgotten.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: OrderedDict[Unit, deque[Count]] = OrderedDict()

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
            self._page((actuator_id, serial_number or _UNNAMED)).append(count)

    def name(self, actuator_id: str, serial_number: str) -> None:
        """Give what was counted of an actuator that was not described to the unit that it is.

        Parameters
        ----------
        actuator_id, serial_number
            The unit.
        """
        with self._lock:
            early = self._counts.pop((actuator_id, _UNNAMED), ())
            if early:
                page = self._page((actuator_id, serial_number))
                # Of counts of the same stamp, the one that came last holds.
                named = list(page)
                page.clear()
                page.extend([*early, *named])

    def take(self, actuator_id: str, serial_number: str) -> list[Count]:
        """Return what was counted of a unit and strike it out.

        Parameters
        ----------
        actuator_id, serial_number
            The unit.
        """
        with self._lock:
            return list(self._counts.pop((actuator_id, serial_number), ()))

    def _page(self, unit: Unit) -> deque[Count]:
        page = self._counts.setdefault(unit, deque(maxlen=_MOST_COUNTS))
        self._counts.move_to_end(unit)
        if len(self._counts) > _MOST_UNITS:
            self._counts.popitem(last=False)
        return page
