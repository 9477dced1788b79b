# SPDX-License-Identifier: Apache-2.0
"""Design of the shortest test that reaches wanted standard deviations (M31)."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import NoneType
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.commands import THESIS_CHIRP, Command
from ema_core.description import ActuatorDescription
from ema_core.expecting import require_type
from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS
from ema_core.quantity import is_finite_number
from ema_core.wording import unknown_name
from ema_monitor.design.information import Information
from ema_monitor.design.limits import SHORTEST_S, SMALLEST_TRAVEL, UNITS, Demands, MotionLimits
from ema_monitor.design.rehearsal import RIG_HINT, ActuatorRig, Rehearsed, rehearse
from ema_monitor.optimizers.differential_evolution import DifferentialEvolution
from ema_monitor.optimizers.driver import Termination, minimise

MOST_ROUNDS: Final = 5
"""Largest number of rounds of design, rehearsal and correction."""

FINEST: Final = 2e-3
"""Smallest wanted standard deviation if the accuracy of the chirp is the target [-]: errors below
0.2 % of the range are irrelevant."""

# A repeated calibration changes the uncertainty of the unit by a few per cent.
_SAME: Final = 1.1
_MARGIN: Final = 0.98
_WORTHWHILE: Final = 0.95
_BINDING: Final = 0.96
_POPULATION: Final = 24
_SEARCH: Final = Termination(_POPULATION * 40, stall_generations=8, tolerance=2e-3)
# Range of the highest frequency of a swing, limited by the frequency for which the mismatch of the
# model is known; the lowest frequency is at most a third of it.
_END_FREQUENCIES: Final = (3.0, 15.0)
_START_SHARES: Final = (0.03, 0.33)
_SMALLEST_SHARE: Final = 0.05
_LAST_FRACTIONS: Final = (0.1, 1.0)
_START: Final = np.array([0.8, 0.9, 0.8, 0.5, 0.8])
_LEAST_CORRECTED: Final = 0.3
_NOT_SHOWN: Final = 10.0
# The frequency is rounded to a whole number of half periods.
_TOLERANCE: Final = 1.1
# Above the cost of any duration or ratio of standard deviations.
_EXCEEDS_LIMITS: Final = 10.0


@dataclass(frozen=True)
class Design:
    """A designed test."""

    command: Command
    """Designed command, a swing."""
    wanted: Mapping[str, float]
    """Largest permitted standard deviations by fault [-]."""
    limits: MotionLimits
    """Permitted demands."""
    demands: Demands
    """Demands of the command, predicted by the model."""
    rehearsed: Rehearsed
    """Rehearsal of the command, which decides whether it reaches the wanted accuracy."""
    reference_s: float | None
    """Duration of the chirp of the thesis [s] if its accuracy is the target, else None."""
    predicted: Mapping[str, float]
    """Standard deviations by fault that the model predicts [-]."""

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviations in the rehearsal by fault [-], large enough for the rehearsed errors.

        The value is NaN for faults that are not detected.
        """
        return {fault.name: fault.effective for fault in self.rehearsed.faults}

    @property
    def reached(self) -> bool:
        """Whether all wanted standard deviations are reached."""
        sigma = self.sigma
        return all(sigma[name] <= limit for name, limit in self.wanted.items())

    @property
    def worst(self) -> tuple[str, float]:
        """Fault with the largest ratio of standard deviation to its wanted value, and the ratio.

        For a fault that is not detected, the ratio uses the predicted value, and is at least 10.
        """
        ratios = {
            name: self.sigma[name] / limit
            if math.isfinite(self.sigma[name])
            else max(self.predicted[name] / limit, _NOT_SHOWN)
            for name, limit in self.wanted.items()
        }
        worst = max(ratios, key=lambda name: ratios[name])
        return worst, ratios[worst]

    @property
    def binding(self) -> list[str]:
        """Names of the active limits."""
        shares = self.demands.shares(self.limits)
        return [name for name, share in shares.items() if share >= _BINDING]

    @property
    def verdict(self) -> str:
        """Sentence on whether the wanted accuracy is reached, and on the limits that prevent it."""
        if self.reached:
            return "all wanted standard deviations are reached"
        name, _ = self.worst
        label, best = FAULTS[FAULT_NAMES.index(name)].label, self.sigma[name]
        reached = f"at best {best:.4f}" if math.isfinite(best) else "not shown at all"
        text = f"{label}: sigma {self.wanted[name]:g} is not reached, {reached}"
        bounds = [f"{name} {getattr(self.limits, name):g} {UNITS[name]}" for name in self.binding]
        if not bounds:
            return f"{text}; no limit is active; use a longer test or a different motion"
        return f"{text}; limited by {', '.join(bounds)}"


def design_command(
    rig: ActuatorRig,
    description: ActuatorDescription,
    limits: MotionLimits,
    wanted: Mapping[str, float] | None = None,
    *,
    on_progress: Callable[[str], None] = lambda _: None,
) -> Design:
    """Design the shortest test that reaches wanted standard deviations.

    Differential evolution searches for the best swing according to predictions of the model. The
    best swing is rehearsed, and the result corrects the predictions, until both agree.

    Parameters
    ----------
    rig
        Runs the tests, usually in simulation.
    description
        The actuator.
    limits
        Permitted demands.
    wanted
        Largest permitted standard deviations by fault; None for the accuracy of the chirp of the
        thesis on this actuator with these sensors, within 10 %, and at least ``FINEST``.
    on_progress
        Called with a description of each step.

    Returns
    -------
    Design
        If the wanted accuracy cannot be reached, the design that comes closest.

    Raises
    ------
    ValueError
        If an argument has a wrong type, a wanted value is out of range, or no motion within the
        limits gives a window.
    """
    require_type("rig", rig, ActuatorRig, RIG_HINT)
    require_type("description", description, ActuatorDescription)
    require_type("limits", limits, MotionLimits, "MotionLimits.within(parameters, travel=...)")
    require_type("wanted", wanted, (Mapping, NoneType), "standard deviation by name of the fault")
    for name, sigma in (wanted or {}).items():
        if name not in COMPONENTS:
            raise ValueError(unknown_name("fault", name, COMPONENTS))
        if not (is_finite_number(sigma) and sigma > 0.0):
            raise ValueError(f"wanted sigma of {name} = {sigma!r}: expected a number above 0")
    on_progress("rehearsing the chirp")
    chirp = THESIS_CHIRP
    if wanted is not None:
        chirp = replace(chirp, amplitude=min(chirp.amplitude, limits.travel / 2.0))
    rehearsed = rehearse(rig, chirp, description)
    reference_s = None
    if wanted is None:
        reference_s = chirp.duration
        wanted = {
            fault.name: max(_SAME * fault.effective, FINEST)
            for fault in rehearsed.faults
            if fault.shown
        }
    designs: list[Design] = []
    base, start = (rehearsed, chirp), _START
    for number in range(MOST_ROUNDS):
        # A new seed per round, so that the search does not return a motion with large errors again.
        search = _Search(*base, limits, wanted, number)
        for point, cost in search.run(start):
            on_progress(f"round {number + 1}: {search.words(point, cost)}")
            start = point
        command = search.command(start)
        is_feasible = search.is_feasible(start)
        reached = [design.command.duration for design in designs if design.reached]
        if reached and not (is_feasible and command.duration < _WORTHWHILE * min(reached)):
            break
        on_progress(f"round {number + 1}: rehearsing {command.duration:.3f} s")
        rehearsed = rehearse(rig, command, description)
        information = Information(rehearsed.calibration)
        windows = information.windows(command)
        predicted = dict(zip(FAULT_NAMES, information.sigma(windows).tolist(), strict=True))
        demands = information.demands(windows)
        designs.append(Design(command, wanted, limits, demands, rehearsed, reference_s, predicted))
        name, ratio = designs[-1].worst
        on_progress(f"round {number + 1}: {name} has {ratio:.2f} times the wanted sigma")
        if number and not designs[-1].reached and not is_feasible:
            break
        if all(
            fault.effective <= fault.sigma for fault in rehearsed.faults if fault.name in wanted
        ):
            base = rehearsed, command
        else:
            start = _START
    if any(design.reached for design in designs):
        return min(
            (design for design in designs if design.reached), key=lambda item: item.command.duration
        )
    return min(designs, key=lambda item: item.worst[1])


class _Search:
    """Search for the shortest swing with the wanted accuracy, by predictions of the model.

    Parameters
    ----------
    rehearsed, command
        A rehearsal and its command. The errors of the predicted variances for this command correct
        the predictions for all commands.
    limits
        Permitted demands.
    wanted
        Largest permitted standard deviations by fault.
    seed
        Seed of the search.
    """

    def __init__(
        self,
        rehearsed: Rehearsed,
        command: Command,
        limits: MotionLimits,
        wanted: Mapping[str, float],
        seed: int = 0,
    ) -> None:
        self._seed = seed
        self._information = Information(rehearsed.calibration)
        self._limits = limits
        self._h = rehearsed.calibration.sample_period
        self._numbers = [FAULT_NAMES.index(name) for name in wanted]
        predicted = self._information.sigma(self._information.windows(command))
        sigmas = {fault.name: fault.sigma for fault in rehearsed.faults}
        errors = np.array([sigmas[name] for name in wanted]) ** 2 - predicted[self._numbers] ** 2
        # A fault that is not detected gives no information about the correction.
        self._corrections = np.nan_to_num(errors, nan=0.0)
        self._wanted = _MARGIN * np.array(list(wanted.values()))

    def run(self, start: Array):
        """Yield the best point, ``(5,)``, and its cost after each generation."""
        rng = np.random.default_rng(self._seed)
        optimizer = DifferentialEvolution(start, rng, population=_POPULATION, F=0.6, CR=0.9)
        for progress in minimise(self._residuals, optimizer, _SEARCH):
            yield progress.point, math.sqrt(progress.cost)

    def command(self, point: Array) -> Command:
        """Return the swing that a point of the unit box, ``(5,)``, encodes.

        The swing has a whole number of half periods, so that it ends at rest. It begins slowly:
        the mismatch of the model averages out over a wide range of speeds, while at a single speed
        it would shift the estimates by more than their standard deviations.
        """
        limits = self._limits
        u_duration, u_frequency, u_amplitude, u_start, u_end = point.tolist()
        duration = SHORTEST_S * (limits.longest / SHORTEST_S) ** u_duration
        duration = self._h * math.floor(duration / self._h + 1e-6)
        low, high = _END_FREQUENCIES
        least, most = _START_SHARES
        end = low * (high / low) ** u_frequency
        start = round(end * (least + (most - least) * u_start), 3)
        halves = max(3, round((start + end) * duration))
        smallest = max(_SMALLEST_SHARE, SMALLEST_TRAVEL / limits.travel)
        share = smallest ** (1.0 - u_amplitude)
        first, last = _LAST_FRACTIONS
        return Command(
            "swing",
            amplitude=float(f"{0.5 * limits.travel * share:.4g}"),
            duration=round(duration, 9),
            start_frequency=start,
            end_frequency=round(halves / duration - start, 6),
            final_fraction=round(first + (last - first) * u_end, 3),
        )

    def is_feasible(self, point: Array) -> bool:
        """Return whether the model predicts that a point reaches the wanted accuracy."""
        return self._cost(point) <= 1.0

    def words(self, point: Array, cost: float) -> str:
        """Return the state of the search for a progress message."""
        if cost <= 1.0:
            return f"{self.command(point).duration:.3f} s"
        if cost < _EXCEEDS_LIMITS:
            return f"sigma {math.exp(cost - 1.0):.2f} times the wanted sigma"
        return "limits exceeded"

    def _residuals(self, points: Array) -> Array:
        return np.array([[self._cost(point)] for point in points])

    def _cost(self, point: Array) -> float:
        """Return the cost of a point of the unit box, ``(5,)`` [-].

        Up to 1, the cost is the share of the longest duration. Above 1, it measures by how far the
        swing misses the wanted accuracy or exceeds the limits.
        """
        command = self.command(point)
        windows = self._information.windows(command)
        demands = self._information.demands(windows)
        excess = max(
            command.end_frequency / (_TOLERANCE * _END_FREQUENCIES[1]),
            *demands.shares(self._limits).values(),
        )
        # Rounded travel and duration may exceed their limits slightly.
        if excess > 1.0 + 1e-3:
            return _EXCEEDS_LIMITS + math.log(excess)
        sigma = self._information.sigma(windows)[self._numbers]
        variance = np.maximum(sigma**2 + self._corrections, (_LEAST_CORRECTED * sigma) ** 2)
        worst = float(np.max(np.sqrt(variance) / self._wanted))
        if worst > 1.0:
            return 1.0 + min(math.log(worst), _EXCEEDS_LIMITS - 2.0)
        return command.duration / self._limits.longest
