"""Stretches of ordinary motion, combined until the faults are known well enough (M29)."""

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.description import ActuatorDescription
from ema_core.faults import (
    ECCENTRICITY,
    ECCENTRICITY_PHASE,
    FAULTS,
    N_FAULTS,
    fault_vector,
    healthy_faults,
)
from ema_core.quantity import check_quantities, quantity
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.fitness import DEFAULT_FITNESS
from ema_monitor.identification.knowledge import Before, Knowledge, information
from ema_monitor.identification.objective import Coordinates, Linearisation, Objective
from ema_monitor.identification.search import Identification
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identification.uncertainty import SPANS, UNOBSERVABLE_SIGMA
from ema_monitor.optimizers.bounded_quadratic import lowest_in_box
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

NUISANCES: Final = ("load_torque",)
"""Hidden causes that are usual in ordinary motion: fitted to every stretch, without evidence."""

WORTHWHILE: Final = 0.9
"""What a stretch must lower the standard deviation of a fault to at least, of that before [-]."""

MOST_SURPRISE: Final = 60.0
"""Squared distance from what is known beyond which a stretch does not belong to it [-]."""

_CARTESIAN: Final = Coordinates(play=0.0, cartesian=True)
_RANGE: Final = np.diag((SPANS / UNOBSERVABLE_SIGMA) ** 2)
_LOADS: Final = 17
_REFUSED_IN_A_ROW: Final = 3
_REACHED: Final = 1.2


@dataclass(frozen=True)
class CombinationSettings:
    """Until when stretches of ordinary motion are combined to one estimate.

    Raises
    ------
    ValueError
        When a figure is outside its range; the message names it.
    """

    wanted_sigma: float = quantity(
        0.01, "-", 1e-4, 0.25, "standard deviation of each fault at which motion gives an estimate"
    )
    most_stretches: int = quantity(
        20, "-", 1, 10_000, "largest number of stretches of motion in an estimate"
    )
    longest_s: float = quantity(
        600.0, "s", 0.01, 1e7, "longest time from the first to the last stretch of an estimate"
    )

    def __post_init__(self) -> None:
        check_quantities(self)


class Tally(NamedTuple):
    """How many stretches there were, and what became of them.

    Attributes
    ----------
    stretches
        All of them.
    combined
        Those that an estimate rests on, or the next one will.
    skipped
        Those that would not have told anything new.
    refused
        Those that nothing explains.
    reason
        Why the latest one was refused; empty when an estimate has been made since.
    """

    stretches: int = 0
    combined: int = 0
    skipped: int = 0
    refused: int = 0
    reason: str = ""


class Combination:
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
        As of ``Identification``.

    Attributes
    ----------
    tally
        How many stretches there were.

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
        self._settings = settings or CombinationSettings()
        self._previous = healthy_faults() if previous is None else fault_vector(previous)
        self._force = force
        self._loads: tuple[float, ...] = ()
        self.tally = Tally()
        self._refused_in_a_row = 0
        self._begin()

    def add(self, stretch: Window | Refusal) -> list[Estimate]:
        """Process the next stretch; return the estimates that it completes.

        Parameters
        ----------
        stretch
            The stretch, or why there is none.
        """
        self._count(stretches=1)
        estimates: list[Estimate] = []
        if self._is_too_old(stretch):
            estimates += self._conclude("")
        if (
            isinstance(stretch, Window)
            and not isinstance(self._calibration, str)
            and not self._is_worthwhile(stretch, self._calibration)
        ):
            self._count(skipped=1)
            return estimates
        run = self._identify(stretch, self._known)
        if self._estimates and not self._belongs(run):
            alone = self._identify(stretch, self._nothing)
            if self._is_valid(alone):
                estimates += self._conclude("the motion that followed does not agree with it")
                run = alone
        if not self._is_valid(run):
            return estimates + self._refuse(run)
        return estimates + self._accept(run)

    def finish(self) -> list[Estimate]:
        """End the motion; return the estimate of what was combined so far, if there is one."""
        return self._conclude("the motion ended")

    def _begin(self) -> None:
        self._estimates: list[Estimate] = []
        self._known = self._nothing

    def _count(self, **more: int) -> None:
        counts = {name: getattr(self.tally, name) + number for name, number in more.items()}
        self.tally = self.tally._replace(**counts)

    def _is_too_old(self, stretch: Window | Refusal) -> bool:
        if not self._estimates:
            return False
        return (stretch.end_ns - self._estimates[0].start_ns) * 1e-9 > self._settings.longest_s

    def _is_worthwhile(self, stretch: Window, calibration: Calibration) -> bool:
        """Return whether a stretch lowers a standard deviation that is larger than wanted."""
        if calibration.shape_mismatch(stretch) or stretch.excitation_defect():
            # To be refused with its reason.
            return True
        causes = Before(None, NUISANCES).causes(calibration.parameters, stretch)
        objective = Objective(stretch, calibration, causes=causes)
        # What moves the motor shows what a stretch can tell: first to a load that explains it.
        points = np.tile(objective.encode(self._start), (_LOADS, 1))
        points[:, -1] = np.linspace(0.0, 1.0, _LOADS)
        costs = np.sum(objective.residuals(points) ** 2, axis=1)
        at = objective.linearise(points[np.argmin(costs)])
        at = objective.linearise(_explained(at, self._known, objective.noise))
        self._loads = (float(at.point[-1]),)
        gained = information(at.jacobian, objective.noise)
        known = self._known
        before = _RANGE + known.gained
        left = np.sqrt(np.diag(np.linalg.inv(before + gained)) / np.diag(np.linalg.inv(before)))
        sigma, common = known.sigma, known.systematic_sigma
        after = np.hypot(left * np.sqrt(sigma**2 - common**2), common)
        wanted = sigma > self._settings.wanted_sigma
        return bool(np.any(wanted & (after < WORTHWHILE * sigma)))

    @property
    def _nothing(self) -> Knowledge:
        """What is known of the faults where nothing is: they are about those before."""
        return Knowledge.of_range(_CARTESIAN.encode(self._previous))

    @property
    def _start(self) -> NDArray[np.float64]:
        """Faults at which the next search begins, ``(8,)``."""
        return np.array(self._estimates[-1].faults) if self._estimates else self._previous

    def _identify(self, stretch: Window | Refusal, known: Knowledge) -> Identification:
        run = Identification(
            stretch,
            self._description,
            self._calibration,
            self._search,
            force=self._force,
            previous=self._start,
            before=Before(known, NUISANCES, self._loads),
        )
        for _ in run:
            pass
        return run

    @staticmethod
    def _is_valid(run: Identification) -> bool:
        return run.estimate is not None and run.estimate.valid and run.knowledge is not None

    def _belongs(self, run: Identification) -> bool:
        return self._is_valid(run) and run.surprise <= MOST_SURPRISE

    def _refuse(self, run: Identification) -> list[Estimate]:
        """Count a stretch that nothing explains; several in a row are worth saying once."""
        if run.estimate is None:
            raise RuntimeError("the identification ended without an estimate")
        self._count(refused=1)
        self.tally = self.tally._replace(reason=run.estimate.reason)
        self._refused_in_a_row += 1
        if self._refused_in_a_row != _REFUSED_IN_A_ROW:
            return []
        return [self._signed(replace(run.estimate, stretches=1))]

    def _accept(self, run: Identification) -> list[Estimate]:
        if run.estimate is None or run.knowledge is None:
            raise RuntimeError("the identification ended without an estimate")
        self._refused_in_a_row = 0
        self._count(combined=1)
        self._known = run.knowledge
        self._estimates.append(run.estimate)
        reached = not np.any(self._not_reached(run.knowledge))
        if reached or len(self._estimates) >= self._settings.most_stretches:
            return self._conclude("")
        return []

    def _conclude(self, remark: str) -> list[Estimate]:
        """Return the estimate of what was combined, and begin anew."""
        known, estimates = self._known, self._estimates
        if estimates:
            self._previous = np.array(estimates[-1].faults)
        self._begin()
        if not estimates:
            return []
        last = estimates[-1]
        unknown = last.unobservable | self._not_reached(known)
        if np.all(unknown | (np.arange(N_FAULTS) == ECCENTRICITY_PHASE)):
            return []
        self.tally = self.tally._replace(reason="")
        covariance = last.covariance.copy()
        covariance[unknown, :] = np.nan
        covariance[:, unknown] = np.nan
        hidden = [
            fault.label
            for fault, is_unknown in zip(FAULTS, unknown, strict=True)
            if is_unknown and fault.limit is not None
        ]
        remarks = [remark, f"the motion does not show {', '.join(hidden)}" if hidden else ""]
        combined = replace(
            last,
            start_ns=estimates[0].start_ns,
            stretches=len(estimates),
            covariance=covariance,
            unobservable=unknown,
            excitation=max(one.excitation for one in estimates),
            evaluations=sum(one.evaluations for one in estimates),
            computing_time_s=sum(one.computing_time_s for one in estimates),
            warm_start=estimates[0].warm_start,
            reason="; ".join(filter(None, [*remarks, last.reason])),
        )
        return [self._signed(combined)]

    def _not_reached(self, known: Knowledge) -> NDArray[np.bool_]:
        """Return which faults are not known as well as wanted, nor as well as can be, ``(8,)``."""
        enough = np.maximum(self._settings.wanted_sigma, _REACHED * known.systematic_sigma)
        missed = known.sigma > enough
        missed[[ECCENTRICITY, ECCENTRICITY_PHASE]] = np.any(
            missed[[ECCENTRICITY, ECCENTRICITY_PHASE]]
        )
        return missed

    def _signed(self, estimate: Estimate) -> Estimate:
        return replace(estimate, calibration_id=self._calibration_id)


def _explained(at: Linearisation, known: Knowledge, noise: float) -> NDArray[np.float64]:
    """Return the point, ``(d,)``, that explains a stretch best, by the linear model.

    Parameters
    ----------
    at
        Linearisation of the stretch alone.
    known
        What is known of the faults.
    noise
        Variance of an effective residual.
    """
    normal, gradient = at.jacobian.T @ at.jacobian / noise, at.jacobian.T @ at.residuals / noise
    normal += 1e-9 * max(np.max(np.diag(normal)), 1e-200) * np.eye(len(normal))
    faults, rows = slice(0, N_FAULTS), known.rows()
    normal[faults, faults] += rows.T @ rows
    gradient[faults] += rows.T @ (rows @ (at.point[faults] - known.point))
    return lowest_in_box(normal, gradient, at.point)
