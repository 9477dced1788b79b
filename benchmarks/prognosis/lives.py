# SPDX-License-Identifier: Apache-2.0
"""Lives for which prognoses are scored, and estimates of the real estimator in their tests."""

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

They were not used for tuning, except that designs of version 0.2 were compared on numbers 200 to
229.
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
"""Growth by other laws than the typical ones, with lives of about the same length."""

STREAMS: Final = {
    "growing": 0,
    "constant": 1,
    "real": 2,  # simulated and identified test by test
    "advised": 5,  # to judge the advice
    "advised_others": 6,  # to fit fixed intervals
    "fleet": 7,
    "fleet_otherwise": 8,  # units of another kind, whose faults grow by other laws
    "next": 9,  # units that follow the fleet
}
"""Numbers in the seeds of lives, by kind. All but the constant lives end by failure."""


@dataclass(frozen=True)
class ScoredLife:
    """A life, identified by its stream and number."""

    number: int
    stream: str

    @property
    def kind(self) -> str:
        """Dominant fault; "" for a constant life."""
        return "" if self.stream == "constant" else list(TYPICAL)[self.number % len(TYPICAL)]

    @property
    def _seed(self) -> tuple[int, int, int]:
        return SEED, STREAMS[self.stream], self.number

    def rng(self, purpose: int) -> np.random.Generator:
        """Return the random generator for a purpose."""
        return np.random.default_rng([*self._seed, purpose])

    def life(self) -> SimulatedLife:
        """Return the simulated life."""
        rng = self.rng(0)
        if self.stream == "constant":
            return constant_life(LIMITS, rng)
        typical = OTHER_LAWS if self.stream == "fleet_otherwise" else TYPICAL
        return run_to_failure(LIMITS, rng, self.kind, typical=typical)

    def case(self, life: SimulatedLife, test: int) -> Case:
        """Return the case that simulates a test of the life."""
        return Case(tuple(life.faults[test].tolist()), (*self._seed, test))


def lives_of(stream: str, count: int) -> list[ScoredLife]:
    """Return lives of one of ``STREAMS``, with the kinds of fault in turn."""
    return [ScoredLife(number, stream) for number in range(count)]


def estimate_of(
    case: Case, window: str, calibration: Calibration, previous: NDArray[np.float64] | None = None
) -> Estimate | None:
    """Simulate a test and return the estimate of its faults, or None without a usable window.

    ``window`` is the kind of window in ``SimulatedLife``. ``previous`` has the faults of the last
    valid estimate, ``(8,)``, at which the search begins; None for a cold start.
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
