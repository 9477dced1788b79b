"""Diagnosis of what a watch found: the estimate of a window, or the refusal of one."""

from collections.abc import Iterator
from dataclasses import dataclass

from ema_core.quantity import check_quantities, quantity, text
from ema_monitor.calibration import Calibration
from ema_monitor.estimate import Estimate, Settings, refusal
from ema_monitor.fitness import DEFAULT_FITNESS, FITNESS
from ema_monitor.identification import Generation, Identification
from ema_monitor.optimizers import ALGORITHMS, DEFAULT_ALGORITHM
from ema_monitor.optimizers.driver import Termination
from ema_monitor.trigger import Refusal
from ema_monitor.watch import Found


@dataclass(frozen=True)
class Search:
    """How to look for the faults, in plain figures and names.

    Raises
    ------
    ValueError
        When a value is impossible; the message names it.
    """

    algorithm: str = text(DEFAULT_ALGORITHM, "optimizer", tuple(ALGORITHMS))
    fitness: str = text(DEFAULT_FITNESS, "distance that is minimised", tuple(FITNESS))
    budget: int = quantity(
        Termination.budget, "-", 1, 2**53, "largest number of model evaluations a window"
    )
    seed: int = quantity(0, "-", 0, 2**53, "seed of the optimizer's random numbers")

    def __post_init__(self) -> None:
        check_quantities(self)

    def settings(self) -> Settings:
        """Return these as settings of an identification."""
        return Settings(self.algorithm, self.fitness, Termination(self.budget), self.seed)


class Diagnosis:
    """One diagnosis: iterate over its generations, then read ``estimate``.

    Parameters
    ----------
    found
        What a watch found.
    calibration
        Calibration of the model; why there is none, as a text, where there is none.
    settings
        How to identify.
    force
        Make an estimate even if the calibration does not fit.
    """

    def __init__(
        self,
        found: Found,
        calibration: Calibration | str,
        settings: Settings,
        *,
        force: bool = False,
    ) -> None:
        self._found = found
        self._calibration = calibration
        self._settings = settings
        self._force = force
        self.estimate: Estimate | None = None

    def __iter__(self) -> Iterator[Generation]:
        """Yield the progress after each generation; there is none where a window is refused."""
        window, calibration = self._found.window, self._calibration
        if isinstance(window, Refusal):
            identity = "" if isinstance(calibration, str) else calibration.calibration_id
            self.estimate = refusal(
                window.start_ns, window.end_ns, self._settings, identity, window.reason
            )
        elif isinstance(calibration, str):
            self.estimate = refusal(
                window.start_ns,
                window.end_ns,
                self._settings,
                "",
                calibration,
                window.excitation,
            )
        else:
            run = Identification(
                window, self._found.description, calibration, self._settings, force=self._force
            )
            yield from run
            self.estimate = run.estimate
