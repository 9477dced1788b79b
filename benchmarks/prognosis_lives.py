"""The lives that prognosis is scored on, and what the real estimator finds in their tests."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from cases import CURRENT_NOISE, RESOLUTIONS, Case
from numpy.typing import NDArray
from trials import ACTUATOR

from ema_core.faults import FAULT_NAMES, TYPICAL
from ema_core.growth_laws import TypicalGrowth
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.diagnosis import identify
from ema_monitor.health import HealthLimits
from ema_monitor.identification.estimate import Estimate
from ema_monitor.windows.trigger import WindowTrigger
from ema_monitor.windows.window import Window
from ema_sim.lives import NOISE_OF_DISTURBED, SimulatedLife, constant_life, run_to_failure
from ema_sim.sensors import Sensors

SEED: Final = 20_231
"""Root of the seeds of scored lives.

Nothing was tuned on them, but that designs of version 0.2 were compared on numbers 200 to 229.
"""

LIMITS: Final[Mapping[str, float]] = {
    name: HealthLimits().of(name) for name in FAULT_NAMES if name != "eccentricity_phase"
}

OTHER_LAWS: Final[Mapping[str, TypicalGrowth]] = {
    "friction": TypicalGrowth("power", 1500.0, 2.0),
    "backlash": TypicalGrowth("self_heating", 4e-4, 3.0),
    "short_circuit": TypicalGrowth("power", 2000.0, 1.6),
    "eccentricity": TypicalGrowth("exponential", 1.8e-3, 0.1),
    "gain": TypicalGrowth("archard", 1.7e-4, 4.0),
}
"""Growth by laws that are not those of the type, in lives of about the same length."""

_GROWING, _CONSTANT, _REAL, _REPAIRED, _OTHERWISE, _ADVISED, _ADVISED_OTHERS = range(7)
_FLEET, _FLEET_OTHERWISE, _NEXT = range(7, 10)


@dataclass(frozen=True)
class ScoredLife:
    """A life by its number; ``rng`` gives a stream for everything else that is random in it."""

    number: int
    stream: int

    @property
    def kind(self) -> str:
        """Dominant fault; empty in a constant life."""
        return "" if self.stream == _CONSTANT else list(TYPICAL)[self.number % len(TYPICAL)]

    def rng(self, purpose: int) -> np.random.Generator:
        """Return the random numbers for a purpose."""
        return np.random.default_rng([SEED, self.stream, self.number, purpose])

    def life(self) -> SimulatedLife:
        """Return what happens in it."""
        rng = self.rng(0)
        if self.stream == _CONSTANT:
            return constant_life(LIMITS, rng)
        typical = OTHER_LAWS if self.stream in (_OTHERWISE, _FLEET_OTHERWISE) else TYPICAL
        repaired = self.stream == _REPAIRED
        return run_to_failure(LIMITS, rng, self.kind, with_repair=repaired, typical=typical)

    def case(self, life: SimulatedLife, test: int) -> Case:
        """Return a test of it to simulate."""
        seed = (SEED, self.stream, self.number, test)
        return Case(tuple(life.faults[test].tolist()), seed)


def growing(count: int) -> list[ScoredLife]:
    """Return lives to failure, each kind of fault in turn."""
    return [ScoredLife(number, _GROWING) for number in range(count)]


def constant(count: int) -> list[ScoredLife]:
    """Return lives without growth."""
    return [ScoredLife(number, _CONSTANT) for number in range(count)]


def real(count: int) -> list[ScoredLife]:
    """Return lives to failure that are simulated and identified test by test."""
    return [ScoredLife(number, _REAL) for number in range(count)]


def repaired(count: int) -> list[ScoredLife]:
    """Return lives to failure with a repair of the dominant fault in them."""
    return [ScoredLife(number, _REPAIRED) for number in range(count)]


def growing_otherwise(count: int) -> list[ScoredLife]:
    """Return lives to failure by laws that are not those of the type."""
    return [ScoredLife(number, _OTHERWISE) for number in range(count)]


def advised(count: int) -> list[ScoredLife]:
    """Return lives to failure on which the advice is judged."""
    return [ScoredLife(number, _ADVISED) for number in range(count)]


def advised_others(count: int) -> list[ScoredLife]:
    """Return lives to failure of the same population, which fixed intervals are fitted to."""
    return [ScoredLife(number, _ADVISED_OTHERS) for number in range(count)]


def fleet(count: int) -> list[ScoredLife]:
    """Return lives to failure of the units of a fleet."""
    return [ScoredLife(number, _FLEET) for number in range(count)]


def fleet_otherwise(count: int) -> list[ScoredLife]:
    """Return those of another kind of unit, whose faults grow by other laws."""
    return [ScoredLife(number, _FLEET_OTHERWISE) for number in range(count)]


def next_units(count: int) -> list[ScoredLife]:
    """Return lives to failure of units that come after the fleet."""
    return [ScoredLife(number, _NEXT) for number in range(count)]


def estimate_of(
    case: Case,
    window: str,
    calibration: Calibration,
    previous: NDArray[np.float64] | None = None,
) -> Estimate | None:
    """Simulate a test and identify its faults; None where the monitor has no window to use.

    Parameters
    ----------
    case
        The test.
    window
        What becomes of its window, as of ``ema_sim.lives``.
    calibration
        Calibration on windows of such sensors.
    previous
        Faults of the last valid estimate, ``(8,)``, at which the search begins; cold when None.
    """
    if window in ("missing", "gap"):
        return None
    noise = NOISE_OF_DISTURBED if window == "noisy" else CURRENT_NOISE
    rng = np.random.default_rng([*case.seed, 1])
    telemetry = Sensors(noise, RESOLUTIONS, rng).measure(case.telemetry())
    [found] = WindowTrigger(ACTUATOR.parameters).feed(telemetry)
    if not isinstance(found, Window):
        return None
    return identify(found, ACTUATOR, calibration, previous=previous)
