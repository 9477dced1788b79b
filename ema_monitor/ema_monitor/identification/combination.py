"""Stretches of ordinary motion, combined until the faults are known well enough (M29)."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ema_core.arrays import Array
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector, healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.combined import combined_estimate
from ema_monitor.identification.defects import drive_defect
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.fitness import DEFAULT_FITNESS
from ema_monitor.identification.inference import Finding
from ema_monitor.identification.knowledge import Knowledge
from ema_monitor.identification.objective import PLAIN
from ema_monitor.identification.preview import Preview, StretchMotion
from ema_monitor.identification.search import Generation, ModelIdentification, Search
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings, Combining
from ema_monitor.identification.uncertainty import SPANS, UNOBSERVABLE_SIGMA
from ema_monitor.reasons import MotionDisagrees, MotionEnded, Reason
from ema_monitor.windows.window import Window

WORTHWHILE: Final = 0.97
"""What a stretch must lower the standard deviation of a fault to at least, of that before [-]."""

MOST_SURPRISE: Final = 60.0
"""Squared distance from what is known beyond which a stretch does not belong to it [-]."""

_RANGE: Final = np.diag((SPANS / UNOBSERVABLE_SIGMA) ** 2)
_UNFIT: Final = 2.0
_REACHED: Final = 1.2


class Combination(Combining):
    """Combines stretches of one actuator's motion to estimates of its faults.

    What a stretch tells of the faults is a prior of the next one. An estimate is made when every
    fault has the wanted standard deviation, or as good a one as further motion can give; or when
    the limit of number or time is reached: faults that are not known well enough are then flagged
    as unobservable. Then a new combination begins, so that successive estimates are independent.

    Parameters
    ----------
    description
        The actuator.
    calibration
        Calibration of its model, or why there is none.
    search
        How to identify.
    settings
        Until when stretches are combined.
    previous
        Faults at which the first search begins, ``(8,)``; None for a healthy actuator.
    force
        As of ``ModelIdentification``.

    Raises
    ------
    ValueError
        When the settings of the search know no noise to weigh stretches by.
    """

    def __init__(
        self,
        description: ActuatorDescription,
        calibration: Calibration | str,
        search: SearchSettings | None = None,
        settings: CombinationSettings | None = None,
        *,
        previous: ArrayLike | None = None,
        force: bool = False,
    ) -> None:
        super().__init__(settings or CombinationSettings())
        self._description = description
        self._calibration_id = "" if isinstance(calibration, str) else calibration.calibration_id
        self._calibration = (
            calibration if isinstance(calibration, str) else calibration.of_any_motion()
        )
        self._search = search or SearchSettings()
        if self._search.fitness != DEFAULT_FITNESS:
            raise ValueError(
                f"fitness = {self._search.fitness!r}: stretches of motion are combined with "
                f"{DEFAULT_FITNESS!r} only"
            )
        self._previous = healthy_faults() if previous is None else fault_vector(previous)
        self._force = force
        self._begin()

    def _take(self, stretch: Window) -> Iterator[Generation | Estimate]:
        if self._is_complete(stretch):
            yield from self._conclude()
        if self._is_paused(stretch) and not self._is_defective(stretch):
            self.tally = self.tally.plus(skipped=1)
            return
        self._looked_at += 1
        if not isinstance(self._calibration, str) and not self._is_worthwhile(
            stretch, self._calibration
        ):
            self.tally = self.tally.plus(skipped=1)
            return
        found = yield from self._identify(stretch, self._known)
        if self._parts and not (_is_valid(found) and found.surprise <= MOST_SURPRISE):
            alone = yield from self._identify(stretch, self._nothing)
            if _is_valid(alone):
                preview = self._preview
                yield from self._conclude(MotionDisagrees())
                found, self._preview = alone, preview
        if _is_valid(found):
            yield from self._accept(found)
        else:
            refused = self._signed(found.estimate)
            yield from self._count_refused(refused, is_known=found.knowledge is not None)

    def finish(self) -> list[Estimate]:
        """End the motion; return the estimate of what was combined so far, if there is one."""
        return self._conclude(MotionEnded())

    def _begin(self) -> None:
        self._parts: list[Finding] = []
        self._motions: list[StretchMotion] = []
        self._looked_at = 0
        self._known = self._nothing
        self._preview: Preview | None = None

    def _is_complete(self, stretch: Window) -> bool:
        """Return whether the limit of number or time is reached before a stretch."""
        if not self._parts:
            return False
        first_ns, last_ns = (one.estimate.start_ns for one in (self._parts[0], self._parts[-1]))
        return self._reaches_limit(stretch, self._looked_at, first_ns, last_ns)

    def _is_worthwhile(self, stretch: Window, calibration: Calibration) -> bool:
        """Return whether a stretch is worth a search.

        It is if it lowers a standard deviation that is larger than wanted, if what is known does
        not explain it, or to be refused with its reason.
        """
        self._preview = None
        if calibration.shape_mismatch(stretch) or stretch.excitation_defect():
            return True
        if self._is_defective(stretch):
            return True
        self._preview = preview = Preview.of(stretch, calibration, self._known, self._start)
        if self._parts and preview.misfit > _UNFIT * self._known.misfit:
            return True
        if any(preview.motion.repeats(one) for one in self._motions):
            return False
        return self._lowers(self._known, preview.gained)

    def _is_defective(self, stretch: Window) -> bool:
        """Return whether drive or shaft has a defect that must be named."""
        return drive_defect(stretch, self._description.parameters) is not None

    def _lowers(self, known: Knowledge, gained: Array) -> bool:
        """Return whether information lowers a standard deviation that is larger than wanted."""
        before = _RANGE + known.gained
        left = np.sqrt(np.diag(np.linalg.inv(before + gained)) / np.diag(np.linalg.inv(before)))
        sigma, common = known.sigma, known.systematic_sigma
        after = np.hypot(left * np.sqrt(sigma**2 - common**2), common)
        wanted = sigma > self._settings.wanted_sigma
        return bool(np.any(wanted & (after < WORTHWHILE * sigma)))

    @property
    def _nothing(self) -> Knowledge:
        """What is known of the faults where nothing is: they are about those before."""
        return Knowledge.of_range(PLAIN.encode(self._previous))

    @property
    def _start(self) -> Array:
        """Faults at which the next search begins, ``(8,)``."""
        return np.array(self._parts[-1].estimate.faults) if self._parts else self._previous

    def _identify(self, stretch: Window, known: Knowledge) -> Search:
        return ModelIdentification(
            stretch,
            self._description,
            self._calibration,
            self._search,
            force=self._force,
            previous=self._start,
            known=known,
            load=self._preview.load if self._preview else None,
        ).run()

    def _accept(self, found: Finding) -> list[Estimate]:
        known = found.knowledge or self._nothing
        self._refused_in_a_row = 0
        if not self._parts:
            self._looked_at = 1  # those refused before it are none of this estimate
        self.tally = self.tally.plus(combined=1)
        self._known = known
        self._parts.append(found)
        if self._preview is not None:
            self._motions.append(self._preview.motion)
        # As well as wanted, or as further motion can tell.
        enough = np.maximum(self._settings.wanted_sigma, _REACHED * known.systematic_sigma)
        return self._conclude() if np.all(known.sigma <= enough) else []

    def _conclude(self, ending: Reason | None = None) -> list[Estimate]:
        """Return the estimate of what was combined, and begin anew."""
        parts, known = self._parts, self._known
        if parts:
            self._previous = np.array(parts[-1].estimate.faults)
        self._begin()
        if not parts:
            return []
        combined = combined_estimate(parts, known, self._settings.wanted_sigma, ending)
        return self._concluded(combined and self._signed(combined))

    def _signed(self, estimate: Estimate) -> Estimate:
        return replace(estimate, calibration_id=self._calibration_id)


def _is_valid(found: Finding) -> bool:
    return found.estimate.valid and found.knowledge is not None
