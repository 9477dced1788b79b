"""Identification of one window of any drive, or of its refusal."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

from numpy.typing import ArrayLike

from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibrations import AnyCalibration
from ema_monitor.current_balance.identifying import identify_by_current
from ema_monitor.current_balance.unit import UnknownDriveUnit
from ema_monitor.identification.estimate import Estimate, refusal
from ema_monitor.identification.search import Generation, ModelIdentification
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.model.measured import measured_causes
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window


class Identification:
    """One identification: iterate over its generations, then read ``estimate``.

    Parameters
    ----------
    window, description, calibration, settings, force, previous
        As of `ModelIdentification`; where the drive is unknown there is no search, and the measured
        current takes its place.

    Attributes
    ----------
    estimate
        The estimate; None before the iteration has ended.
    """

    def __init__(
        self,
        window: Window | Refusal,
        description: ActuatorDescription,
        calibration: AnyCalibration | str,
        settings: SearchSettings,
        *,
        force: bool = False,
        previous: ArrayLike | None = None,
    ) -> None:
        self._window, self._description = window, description
        self._calibration, self._settings = calibration, settings
        self._force, self._previous = force, previous
        self.estimate: Estimate | None = None

    def __iter__(self) -> Iterator[Generation]:
        """Yield the state after each generation; there is none where a window is refused."""
        calibration = self._calibration
        if isinstance(calibration, UnknownDriveUnit):
            if isinstance(self._window, Window):
                self.estimate = identify_by_current(
                    self._window, self._description, calibration, self._settings, force=self._force
                )
            else:
                self.estimate = refusal(
                    self._window, calibration, self._settings, self._window.reason
                )
            return
        previous = None if self._previous is None else fault_vector(self._previous)
        found = yield from ModelIdentification(
            self._window, self._description, calibration, self._settings, self._force, previous
        ).run()
        self.estimate = found.estimate


def identify(
    window: Window | Refusal,
    description: ActuatorDescription | None = None,
    calibration: AnyCalibration | str | None = None,
    settings: SearchSettings | None = None,
    *,
    force: bool = False,
    previous: ArrayLike | None = None,
    measured: Mapping[str, tuple[float, float]] | None = None,
) -> Estimate:
    """Identify the faults in a window, without progress.

    Parameters
    ----------
    window, description, calibration, settings, force, previous
        As of ``Identification``. Description and calibration are those of the built-in actuator
        when None.
    measured
        Hidden causes that were measured, value and standard deviation by name, as of
        ``measured_causes``; those of the window when None.

    Raises
    ------
    ValueError
        As of ``measured_causes``.
    """
    if measured is not None:
        known = measured_causes(measured)
        window = window if isinstance(window, Refusal) else replace(window, measured=known)
    identification = Identification(
        window,
        description or ActuatorDescription(),
        Calibration.builtin() if calibration is None else calibration,
        settings or SearchSettings(),
        force=force,
        previous=previous,
    )
    for _ in identification:
        pass
    if identification.estimate is None:
        raise RuntimeError("the identification ended without an estimate")
    return identification.estimate
