# SPDX-License-Identifier: Apache-2.0
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

STREAMS: Final = {
    "growing": 0,
    "constant": 1,
    "real": 2,  # simulated and identified test by test
    "advised": 5,  # on which the advice is judged
    "advised_others": 6,  # which fixed intervals are fitted to
    "fleet": 7,
    "fleet_otherwise": 8,  # of another kind of unit, whose faults grow by other laws
    "next": 9,  # of units that come after the fleet
}
"""Kinds of lives, to failure but for the constant ones, with the numbers of their seeds."""


@dataclass(frozen=True)
class ScoredLife:
    """A life by its number; ``rng`` gives a stream for everything else that is random in it."""

    number: int
    stream: str

    @property
    def kind(self) -> str:
        """Dominant fault; empty in a constant life."""
        return "" if self.stream == "constant" else list(TYPICAL)[self.number % len(TYPICAL)]

    @property
    def _seed(self) -> tuple[int, int, int]:
        return SEED, STREAMS[self.stream], self.number

    def rng(self, purpose: int) -> np.random.Generator:
        """Return the random numbers for a purpose."""
        return np.random.default_rng([*self._seed, purpose])

    def life(self) -> SimulatedLife:
        """Return what happens in it."""
        rng = self.rng(0)
        if self.stream == "constant":
            return constant_life(LIMITS, rng)
        typical = OTHER_LAWS if self.stream == "fleet_otherwise" else TYPICAL
        return run_to_failure(LIMITS, rng, self.kind, typical=typical)

    def case(self, life: SimulatedLife, test: int) -> Case:
        """Return a test of it to simulate."""
        return Case(tuple(life.faults[test].tolist()), (*self._seed, test))


def lives_of(stream: str, count: int) -> list[ScoredLife]:
    """Return lives of one of ``STREAMS``, each kind of fault in turn."""
    return [ScoredLife(number, stream) for number in range(count)]


def estimate_of(
    case: Case, window: str, calibration: Calibration, previous: NDArray[np.float64] | None = None
) -> Estimate | None:
    """Simulate a test and identify its faults; None where the monitor has no window to use.

    The search begins at the faults of the last valid estimate, ``(8,)``; cold when None.
    """
    if window in ("missing", "gap"):
        return None
    noise = NOISE_OF_DISTURBED if window == "noisy" else CURRENT_NOISE
    rng = np.random.default_rng([*case.seed, 1])
    telemetry = Sensors(noise, RESOLUTIONS, rng).measure(case.telemetry())
    [segment] = WindowTrigger(ACTUATOR.parameters).feed(telemetry)
    if not isinstance(segment, Window):
        return None
    return identify(segment, ACTUATOR, calibration, previous=previous)
