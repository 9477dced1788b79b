# SPDX-License-Identifier: Apache-2.0
"""Combination of stretches of ordinary motion until the faults are accurate enough.

The method is described in ``docs/identification.md``, M29.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ema_core.arrays import Array
from ema_core.description import ActuatorDescription
from ema_core.expecting import require_type, value_or_default
from ema_core.faults import fault_vector, healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.defects import drive_defect
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.estimate_of_stretches import combined_estimate
from ema_monitor.identification.fitness import DEFAULT_FITNESS
from ema_monitor.identification.inference import WindowResult
from ema_monitor.identification.knowledge import Knowledge
from ema_monitor.identification.objective import PLAIN
from ema_monitor.identification.preview import Preview, StretchMotion
from ema_monitor.identification.search import Generation, ModelIdentification, Search
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings, Combining
from ema_monitor.identification.uncertainty import SPANS, UNOBSERVABLE_SIGMA
from ema_monitor.reasons import CalibrationMissing, MotionDisagrees, MotionEnded, Reason
from ema_monitor.windows.window import Window

WORTHWHILE: Final = 0.97
"""Largest predicted ratio of a fault's standard deviation after a stretch to the value before, at
which the stretch is searched [-]."""

MOST_SURPRISE: Final = 60.0
"""Largest squared distance from the prior knowledge at which a stretch is combined [-]."""

_RANGE: Final = np.diag((SPANS / UNOBSERVABLE_SIGMA) ** 2)
_UNFIT: Final = 2.0
_REACHED: Final = 1.2


class Combination(Combining):
    """Combines stretches of ordinary motion into estimates of an actuator's faults.

    The result of a stretch is the prior of the next stretch. The combination is complete when every
    fault has reached the target standard deviation or the limit of what further motion can achieve,
    or when the largest number of stretches or the time limit is reached. Faults that are not
    accurate enough are then flagged as unobservable. A new combination begins after each estimate,
    so that successive estimates are independent.

    Parameters
    ----------
    description
        Description of the actuator.
    calibration
        Calibration of the actuator's model, or the reason why there is none.
    search
        Settings of the search.
    settings
        Settings of the combination.
    previous
        Faults at which the first search begins, ``(8,)``; None for healthy.
    force
        Whether to accept the calibration of a different unit.

    Raises
    ------
    ValueError
        If an argument has a wrong type, or the search does not use the default fitness, which is
        the only one that models the noise.
    """

    def __init__(
        self,
        description: ActuatorDescription,
        calibration: Calibration | CalibrationMissing,
        search: SearchSettings | None = None,
        settings: CombinationSettings | None = None,
        *,
        previous: ArrayLike | None = None,
        force: bool = False,
    ) -> None:
        require_type("description", description, ActuatorDescription)
        require_type("calibration", calibration, (Calibration, Reason))
        super().__init__(
            value_or_default("settings", settings, CombinationSettings, CombinationSettings)
        )
        self._description = description
        self._calibration_id = "" if isinstance(calibration, Reason) else calibration.calibration_id
        self._calibration = (
            calibration if isinstance(calibration, Reason) else calibration.of_any_motion()
        )
        self._search = value_or_default("search", search, SearchSettings, SearchSettings)
        if self._search.fitness != DEFAULT_FITNESS:
            raise ValueError(
                f"fitness = {self._search.fitness!r}: stretches of motion are combined with "
                f"{DEFAULT_FITNESS!r} only"
            )
        self._previous = healthy_faults() if previous is None else fault_vector(previous)
        self._force = force
        self._begin()

    def _process(self, stretch: Window) -> Iterator[Generation | Estimate]:
        if self._is_complete(stretch):
            yield from self._conclude()
        if self._is_paused(stretch) and not self._is_defective(stretch):
            self.tally = self.tally.plus(skipped=1)
            return
        self._examined += 1
        if not isinstance(self._calibration, Reason) and not self._is_worthwhile(
            stretch, self._calibration
        ):
            self.tally = self.tally.plus(skipped=1)
            return
        result = yield from self._identify(stretch, self._knowledge)
        if self._parts and not (_is_valid(result) and result.surprise <= MOST_SURPRISE):
            alone = yield from self._identify(stretch, self._initial)
            if _is_valid(alone):
                preview = self._preview
                yield from self._conclude(MotionDisagrees())
                result, self._preview = alone, preview
        if _is_valid(result):
            yield from self._accept(result)
        else:
            refused = self._signed(result.estimate)
            yield from self._count_refused(refused, is_identified=result.knowledge is not None)

    def finish(self) -> list[Estimate]:
        """End the combination. Return the estimate of the stretches combined so far, if any."""
        return self._conclude(MotionEnded())

    def _begin(self) -> None:
        self._parts: list[WindowResult] = []
        self._motions: list[StretchMotion] = []
        self._examined = 0
        self._knowledge = self._initial
        self._preview: Preview | None = None

    def _is_complete(self, stretch: Window) -> bool:
        """Return whether a stretch would exceed the limits on number or time."""
        if not self._parts:
            return False
        first_ns, last_ns = (self._parts[i].estimate.start_ns for i in (0, -1))
        return self._reaches_limit(stretch, self._examined, first_ns, last_ns)

    def _is_worthwhile(self, stretch: Window, calibration: Calibration) -> bool:
        """Return whether a stretch is worth a search.

        A search is worthwhile if it would reduce a standard deviation that exceeds the target, if
        the faults estimated so far do not explain the stretch, or if the search would refuse the
        stretch with a reason to report. A stretch that is explained and repeats an earlier motion
        is not worth a search.
        """
        self._preview = None
        if calibration.shape_mismatch(stretch) or stretch.excitation_defect():
            return True
        if self._is_defective(stretch):
            return True
        self._preview = preview = Preview.of(stretch, calibration, self._knowledge, self._start)
        if self._parts and preview.misfit > _UNFIT * self._knowledge.misfit:
            return True
        if any(preview.motion.repeats(motion) for motion in self._motions):
            return False
        return self._lowers(self._knowledge, preview.gained)

    def _is_defective(self, stretch: Window) -> bool:
        """Return whether a stretch shows a defect of drive, shaft or sensor."""
        return drive_defect(stretch, self._description.parameters) is not None

    def _lowers(self, knowledge: Knowledge, gained: Array) -> bool:
        """Return whether the information ``gained`` from a stretch, ``(8, 8)``, is worth a search.

        It must significantly reduce a standard deviation that exceeds the target.
        """
        before = _RANGE + knowledge.gained
        ratio = np.sqrt(np.diag(np.linalg.inv(before + gained)) / np.diag(np.linalg.inv(before)))
        sigma, common = knowledge.sigma, knowledge.systematic_sigma
        after = np.hypot(ratio * np.sqrt(sigma**2 - common**2), common)
        is_inaccurate = sigma > self._settings.wanted_sigma
        return bool(np.any(is_inaccurate & (after < WORTHWHILE * sigma)))

    @property
    def _initial(self) -> Knowledge:
        """Prior before the first stretch: the fault ranges, centred on the previous faults."""
        return Knowledge.of_range(PLAIN.encode(self._previous))

    @property
    def _start(self) -> Array:
        """Faults at which the next search begins, ``(8,)``."""
        return np.array(self._parts[-1].estimate.faults) if self._parts else self._previous

    def _identify(self, stretch: Window, knowledge: Knowledge) -> Search:
        return ModelIdentification(
            stretch,
            self._description,
            self._calibration,
            self._search,
            force=self._force,
            previous=self._start,
            knowledge=knowledge,
            load=self._preview.load if self._preview else None,
        ).run()

    def _accept(self, result: WindowResult) -> list[Estimate]:
        knowledge = result.knowledge or self._initial
        self._refused_in_a_row = 0
        if not self._parts:
            self._examined = 1  # refused stretches before the first combined stretch do not count
        self.tally = self.tally.plus(combined=1)
        self._knowledge = knowledge
        self._parts.append(result)
        if self._preview is not None:
            self._motions.append(self._preview.motion)
        # Further motion does not reduce the systematic part.
        target = np.maximum(self._settings.wanted_sigma, _REACHED * knowledge.systematic_sigma)
        return self._conclude() if np.all(knowledge.sigma <= target) else []

    def _conclude(self, ending: Reason | None = None) -> list[Estimate]:
        """Return the estimate of the combined stretches, and begin a new combination.

        The list is empty if no stretch was combined, or no fault is accurate enough.
        """
        parts, knowledge = self._parts, self._knowledge
        if parts:
            self._previous = np.array(parts[-1].estimate.faults)
        self._begin()
        if not parts:
            return []
        combined = combined_estimate(parts, knowledge, self._settings.wanted_sigma, ending)
        return self._concluded(combined and self._signed(combined))

    def _signed(self, estimate: Estimate) -> Estimate:
        return replace(estimate, calibration_id=self._calibration_id)


def _is_valid(result: WindowResult) -> bool:
    return result.estimate.valid and result.knowledge is not None
