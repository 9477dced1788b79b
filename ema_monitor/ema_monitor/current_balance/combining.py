"""Stretches of ordinary motion of a unit whose drive is unknown, fitted together (M46)."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from ema_core.description import ActuatorDescription
from ema_monitor.current_balance.identifying import defect_of, identify_unknown
from ema_monitor.current_balance.unit import UnknownDriveUnit
from ema_monitor.identification.estimate import Estimate, refusal
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings, Combining
from ema_monitor.windows.window import Window

_EACH_UP_TO: Final = 5
_EVERY: Final = 5


class CurrentCombination(Combining):
    """Combines stretches of one actuator's motion, as `Combination` does for a known drive.

    Parameters
    ----------
    description, unit
        The actuator, and its calibration.
    search, settings
        The limit of the goodness of fit, and until when stretches are combined.
    force
        Make an estimate although the calibration is of another unit.
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
        super().__init__(settings)
        self._description, self._unit = description, unit
        self._search = search
        mismatch = unit.unit_mismatch(description)
        self._caveats = [f"forced although {mismatch}"] if mismatch and force else []
        self._mismatch = "" if force else mismatch
        self._windows: list[Window] = []

    def _take(self, stretch: Window) -> Iterator[Estimate]:
        if defect := defect_of(stretch, self._description, self._unit, self._mismatch):
            reason, is_failure = defect
            refused = refusal(stretch, self._unit, self._search, reason, is_failure=is_failure)
            yield from self._count_refused(refused)
            return
        if self._is_complete(stretch):
            yield from self.finish()
        if self._is_paused(stretch):
            self.tally = self.tally.plus(skipped=1)
            return
        self._refused_in_a_row = 0
        self._windows.append(stretch)
        self.tally = self.tally.plus(combined=1)
        number = len(self._windows)
        if number > _EACH_UP_TO and number % _EVERY and number < self._settings.most_stretches:
            return
        found = self._identified()
        if isinstance(found, Estimate) and self._is_enough(found):
            yield from self._conclude(found)

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
        windows = self._windows
        return bool(windows) and self._reaches_limit(
            stretch, len(windows), windows[0].start_ns, windows[-1].start_ns
        )

    def _conclude(self, found: Estimate | str) -> list[Estimate]:
        """Return the estimate of what was combined, and begin anew."""
        number, self._windows = len(self._windows), []
        if isinstance(found, str):
            return self._concluded(None, found)
        return self._concluded(replace(found, stretches=number))
