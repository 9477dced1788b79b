"""Diagnosis of what a watch found: the estimate of a window, or the refusal of one."""

from collections.abc import Iterator
from dataclasses import dataclass

from ema_core.quantity import check_quantities, flag, quantity, text
from ema_monitor.calibration import Calibration
from ema_monitor.estimate import GOODNESS_LIMIT, Estimate, Settings, refusal
from ema_monitor.fitness import DEFAULT_FITNESS, FITNESS
from ema_monitor.identification import Generation, Identification
from ema_monitor.last_faults import LastFaults
from ema_monitor.optimizers import ALGORITHMS, DEFAULT_ALGORITHM
from ema_monitor.optimizers.driver import Termination
from ema_monitor.trigger import Refusal
from ema_monitor.watch import Found
from ema_monitor.window import Window


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
    goodness_limit: float = quantity(
        GOODNESS_LIMIT,
        "-",
        0.1,
        1e6,
        "goodness of fit beyond which no fault explains a window; larger for a shorted motor",
    )
    seed: int = quantity(0, "-", 0, 2**53, "seed of the optimizer's random numbers")
    warm_start: bool = flag(
        True, "begin the search at the faults of the actuator's last valid estimate"
    )

    def __post_init__(self) -> None:
        check_quantities(self)

    def settings(self) -> Settings:
        """Return these as settings of an identification."""
        return Settings(
            self.algorithm,
            self.fitness,
            Termination(self.budget),
            self.seed,
            goodness_limit=self.goodness_limit,
        )


class Diagnosis:
    """One diagnosis: iterate over its generations, then read ``estimate``.

    Parameters
    ----------
    found
        What a watch found.
    calibration
        Calibration of the model; why there is none, as a text, where there is none.
    search
        How to identify.
    force
        Make an estimate even if the calibration does not fit.
    last_faults
        Where the search begins if it may begin warm; takes in the estimate. Cold when None.
    """

    def __init__(
        self,
        found: Found,
        calibration: Calibration | str,
        search: Search,
        *,
        force: bool = False,
        last_faults: LastFaults | None = None,
    ) -> None:
        self._found = found
        self._calibration = calibration
        self._search = search
        self._force = force
        self._last_faults = last_faults
        self.estimate: Estimate | None = None

    def __iter__(self) -> Iterator[Generation]:
        """Yield the progress after each generation; there is none where a window is refused."""
        window, calibration = self._found.window, self._calibration
        settings = self._search.settings()
        if isinstance(window, Refusal):
            is_known = not isinstance(calibration, str)
            self.estimate = refusal(
                window.start_ns,
                window.end_ns,
                settings,
                calibration.calibration_id if is_known else "",
                window.reason,
                calibration_windows=calibration.windows if is_known else 0,
            )
        elif isinstance(calibration, str):
            self.estimate = refusal(
                window.start_ns, window.end_ns, settings, "", calibration, window.excitation
            )
        else:
            yield from self._identify(window, calibration, settings)

    def _identify(
        self, window: Window, calibration: Calibration, settings: Settings
    ) -> Iterator[Generation]:
        description, last = self._found.description, self._last_faults
        previous = last.of(description, calibration) if last and self._search.warm_start else None
        run = Identification(
            window, description, calibration, settings, force=self._force, previous=previous
        )
        yield from run
        self.estimate = run.estimate
        if last and run.estimate is not None:
            last.note(description, run.estimate)
