"""Stretches of ordinary motion of a unit whose drive is unknown, fitted together (M46)."""

import math
from dataclasses import replace
from typing import Final

from ema_core.description import ActuatorDescription
from ema_monitor.current_balance.identifying import defect_of, identify_unknown
from ema_monitor.current_balance.unit import UnknownDriveUnit
from ema_monitor.identification.estimate import Estimate, refusal
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings, Tally
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

_REFUSED_IN_A_ROW: Final = 3
_EACH_UP_TO: Final = 5
_EVERY: Final = 5


class CurrentCombination:
    """Combines stretches of one actuator's motion, as `Combination` does for a known drive.

    Parameters
    ----------
    description, unit
        The actuator, and its calibration.
    search, settings
        The limit of the goodness of fit, and until when stretches are combined.
    force
        Make an estimate although the calibration is of another unit.

    Attributes
    ----------
    tally
        How many stretches there were.
    """

    def __init__(
        self,
        description: ActuatorDescription,
        unit: UnknownDriveUnit,
        search: SearchSettings,
        settings: CombinationSettings,
        *,
        force: bool = False,
    ) -> None:
        self._description, self._unit = description, unit
        self._search, self._settings = search, settings
        self.tally = Tally()
        mismatch = unit.unit_mismatch(description)
        self._caveats = [f"forced although {mismatch}"] if mismatch and force else []
        self._mismatch = "" if force else mismatch
        self._windows: list[Window] = []
        self._refused_in_a_row = 0
        self._pause_ns = (0, 0)

    def add(self, stretch: Window | Refusal) -> list[Estimate]:
        """Process the next stretch; return the estimates that it completes."""
        self._count(stretches=1)
        if isinstance(stretch, Refusal):
            self._count(**{"dropped" if stretch.is_dropped else "refused": 1})
            self.tally = self.tally._replace(reason=stretch.reason)
            return []
        if defect := defect_of(stretch, self._description, self._unit, self._mismatch):
            # Several in a row are said once.
            self._count(refused=1)
            self.tally = self.tally._replace(reason=defect.reason)
            self._refused_in_a_row += 1
            if self._refused_in_a_row != _REFUSED_IN_A_ROW:
                return []
            reason, is_failure = defect
            refused = refusal(stretch, self._unit, self._search, reason, is_failure=is_failure)
            return [replace(refused, stretches=1)]
        estimates = self.finish() if self._is_complete(stretch) else []
        begin_ns, end_ns = self._pause_ns
        if begin_ns <= stretch.start_ns < end_ns:
            self._count(skipped=1)
            return estimates
        self._refused_in_a_row = 0
        self._windows.append(stretch)
        self._count(combined=1)
        number = len(self._windows)
        if number > _EACH_UP_TO and number % _EVERY and number < self._settings.most_stretches:
            return estimates
        found = self._identified()
        if isinstance(found, Estimate) and self._is_enough(found):
            return [*estimates, *self._conclude(found)]
        return estimates

    def finish(self) -> list[Estimate]:
        """End the motion; return the estimate of what was combined so far, if there is one."""
        return self._conclude(self._identified()) if self._windows else []

    def _identified(self) -> Estimate | str:
        limit = self._search.goodness_limit
        return identify_unknown(self._windows, self._description, self._unit, limit, self._caveats)

    def _is_enough(self, found: Estimate) -> bool:
        """Return whether all that this motion can show is known as well as wanted."""
        sigmas = [found.sigma.friction]
        if not math.isnan(self._unit.play):
            sigmas.append(found.sigma.backlash)
        sigmas += [one.sigma for one in found.causes if one.name == "torque_constant"]
        return len(sigmas) > 2 and all(one <= self._settings.wanted_sigma for one in sigmas)

    def _is_complete(self, stretch: Window) -> bool:
        if not self._windows:
            return False
        if stretch.start_ns < self._windows[-1].start_ns:
            return True
        age_s = (stretch.end_ns - self._windows[0].start_ns) * 1e-9
        is_full = len(self._windows) >= self._settings.most_stretches
        return is_full or age_s > self._settings.longest_s

    def _conclude(self, found: Estimate | str) -> list[Estimate]:
        """Return the estimate of what was combined, and begin anew."""
        windows, self._windows = self._windows, []
        if isinstance(found, str):
            self._count(fruitless=1)
            self.tally = self.tally._replace(reason=found)
            return []
        pause_ns = round(self._settings.pause_s * 1e9)
        self._pause_ns = (found.end_ns, found.end_ns + pause_ns)
        self.tally = self.tally._replace(reason="")
        return [replace(found, stretches=len(windows))]

    def _count(self, **more: int) -> None:
        counts = {name: getattr(self.tally, name) + number for name, number in more.items()}
        self.tally = self.tally._replace(**counts)
