"""The combinations of several actuators' ordinary motion."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from numpy.typing import ArrayLike

from ema_core.description import ActuatorDescription
from ema_monitor.calibration.loading import AnyCalibration
from ema_monitor.identification.combination import Combination
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings, Tally
from ema_monitor.unknown_drive.combining import CurrentCombination
from ema_monitor.unknown_drive.unit import UnknownDriveUnit
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window


class Combined(NamedTuple):
    """An estimate of ordinary motion, its running number, and the actuator that it is of."""

    number: int
    description: ActuatorDescription
    estimate: Estimate


class Combinations:
    """The combinations of several actuators.

    They depend on the stretches and their order alone: live, in a replay and offline, the same
    stretches give the same estimates. Under another description, calibration or other settings a
    new combination begins.
    """

    def __init__(self) -> None:
        self._of: dict[str, _Held] = {}

    def add(
        self,
        description: ActuatorDescription,
        calibration: AnyCalibration | str,
        search: SearchSettings,
        settings: CombinationSettings,
        stretch: Window | Refusal,
        *,
        previous: ArrayLike | None = None,
        force: bool = False,
        is_stopped: Callable[[], bool] = lambda: False,
    ) -> list[Combined]:
        """Process the next stretch of an actuator; return the estimates that it completes.

        Parameters
        ----------
        description, calibration, search, settings, previous, force
            As of `Combination`; the latter two hold for a new one.
        stretch, is_stopped
            As of `Combination.add`.

        Raises
        ------
        ValueError
            As of `Combination`.
        """
        identity = calibration if isinstance(calibration, str) else calibration.calibration_id
        key, ended = (description, identity, search, settings), []
        held = self._of.get(description.actuator_id)
        if held is None or held.key != key:
            if isinstance(calibration, UnknownDriveUnit):
                combination = CurrentCombination(
                    description, calibration, search, settings, force=force
                )
            else:
                combination = Combination(
                    description, calibration, search, settings, previous=previous, force=force
                )
            ended = held.numbered(held.combination.finish()) if held else []
            held = _Held(key, description, combination, held.estimates if held else 0)
            self._of[description.actuator_id] = held
        return ended + held.numbered(held.combination.add(stretch, is_stopped))

    def tally(self, actuator_id: str) -> Tally:
        """Return how many stretches of an actuator there were since its combination was set up."""
        held = self._of.get(actuator_id)
        return Tally() if held is None else held.combination.tally

    def finish(self) -> list[Combined]:
        """End all motion; return the estimates of what was combined so far."""
        return [
            one for held in self._of.values() for one in held.numbered(held.combination.finish())
        ]

    def forget(self, actuator_id: str) -> None:
        """Forget the stretches of an actuator."""
        self._of.pop(actuator_id, None)

    def clear(self) -> None:
        """Forget all."""
        self._of.clear()


@dataclass
class _Held:
    """The combination of one actuator, what it depends on, and how many estimates there were."""

    key: tuple[object, ...]
    description: ActuatorDescription
    combination: Combination | CurrentCombination
    estimates: int

    def numbered(self, found: list[Estimate]) -> list[Combined]:
        """Give estimates their numbers."""
        first, self.estimates = self.estimates, self.estimates + len(found)
        return [Combined(first + i, self.description, one) for i, one in enumerate(found)]
