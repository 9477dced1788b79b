# SPDX-License-Identifier: Apache-2.0
"""Validation windows of the fault estimator, each reproducible from its ``Case``.

The pulse-width modulation of the reference actuator is chaotic but deterministic: two runs from
the same state are equal to the last bit. Windows of a real drive differ. Therefore a small random
command, too small to move the gear, precedes the approach for some milliseconds ("stirring").
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from ema_core.commands import THESIS_CHIRP, build_cycle
from ema_core.description import SAMPLE_PERIOD
from ema_core.faults import (
    ECCENTRICITY,
    ECCENTRICITY_PHASE,
    N_FAULTS,
    degrade,
    fault_vector,
    healthy_faults,
    random_faults,
)
from ema_core.parameters import ActuatorParameters, constants
from ema_core.telemetry import Telemetry
from ema_monitor.windows.trigger import WindowTrigger
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator, at_rest
from ema_sim.field_oriented import field_oriented_at_rest
from ema_sim.sensors import Sensors
from ema_study.cases import CASES

CURRENT_NOISE: Final = 0.05
"""Standard deviation of the current sensor's noise [A]."""

RESOLUTIONS: Final = {"current": 0.005, "position": 1e-6, "speed": 0.05}
"""Resolutions of the sensors [A, rad, rad/s]."""

PLANT_TOLERANCE: Final = 0.05
"""Largest relative deviation of a plant's parameters from nominal [-]."""

THESIS_FAULTS: Final = {name: case.faults for name, case in CASES.items()}
"""The thesis's ten single faults and its multiple fault, by name."""

HEALTHY: Final = tuple(healthy_faults().tolist())
"""Fault vector of a healthy actuator."""

DETECTABLE: Final = tuple(n for n in range(N_FAULTS) if n != ECCENTRICITY_PHASE)
"""Components that can be a fault alone: all but the direction of eccentricity."""

_NOMINAL = ActuatorParameters()
_CYCLE = build_cycle(THESIS_CHIRP, SAMPLE_PERIOD)
# A window begins when the chirp exceeds the threshold, so it ends shortly after the chirp.
_END = _CYCLE.stop + 100
_STIR = 1.2e-5
_SIMPLY_OFF = ("R_s", "L_s", "k_t", "k_e")
_JOINTLY_OFF = (("J_m", "J_u"), ("C_m", "C_u"), ("f_sm", "f_su"))

# Each set draws from a separate stream, so that a change of one set does not affect the others.
_STREAMS = ["first", "single", "law", "wide", "plant", "play", "healthy", "calibration", "step"]


@dataclass(frozen=True)
class Case:
    """Faults, plant and start of a simulated window.

    ``plant`` has the true parameters; the monitor knows the nominal parameters only. With
    ``start`` "approach", the command stirs, then approaches as the test cycle does. With
    "anywhere" it stirs and starts without approach, at a random position in the play. "first
    cycle" is the whole test cycle from the start of the simulation, without stirring.
    """

    faults: tuple[float, ...]
    seed: tuple[int, ...]
    plant: ActuatorParameters = field(default=_NOMINAL, repr=False)
    start: Literal["approach", "anywhere", "first cycle"] = "approach"
    drive: str = "six_step"

    def telemetry(self) -> Telemetry:
        """Return the simulated telemetry of ideal sensors up to the end of the window."""
        rng = np.random.default_rng([*self.seed, 0])
        actuator = SimulatedActuator(self.plant, drive=self.drive)
        place = at_rest if self.drive == "six_step" else field_oriented_at_rest
        actuator.faults = fault_vector(self.faults)
        chirp = _CYCLE.samples[_CYCLE.start + 1 : _END]
        if self.start == "first cycle":
            return actuator.advance(_CYCLE.samples[:_END])
        if self.start == "anywhere":
            mechanics = degrade(constants(self.plant), self.faults).mechanics
            actuator.state = place(rng.uniform(-1.0, 1.0) * float(mechanics.half_backlash), 0.0)
            stir, rest = _STIR * rng.standard_normal(600), np.zeros(600)
            return actuator.advance(np.concatenate([stir, rest, chirp]))
        # Start at the lowest command, where the approach begins: earlier motion has no effect.
        below = int(np.argmin(_CYCLE.samples[: _CYCLE.start]))
        depth = float(_CYCLE.samples[below])
        actuator.state = place(depth / self.plant.tau, depth / self.plant.tau)
        stir = depth + _STIR * rng.standard_normal(int(rng.integers(50, 400)))
        return actuator.advance(np.concatenate([stir, _CYCLE.samples[below:_END]]))

    def window(self, telemetry: Telemetry, *, noisy: bool) -> Window:
        """Return the window in the ideal ``telemetry`` of this case.

        ``noisy`` applies noise and resolutions of the sensors first.

        Raises
        ------
        RuntimeError
            If the trigger refuses the window.
        """
        if noisy:
            rng = np.random.default_rng([*self.seed, 1])
            telemetry = Sensors(CURRENT_NOISE, RESOLUTIONS, rng).measure(telemetry)
        [window] = WindowTrigger(_NOMINAL).feed(telemetry)
        if not isinstance(window, Window):
            raise RuntimeError(f"{self}: no window: {window.reason}")
        return window


@dataclass(frozen=True)
class Plant:
    """Cases of an actuator that deviates from its nominal parameters.

    The healthy cases are for calibration.
    """

    healthy: list[Case]
    faulty: list[Case]


def first_cycles() -> dict[str, Case]:
    """Return the thesis's faults by name, in the first cycle after the start of the simulation."""
    return {
        name: Case(_tuple(fault_vector(faults)), _seed("first"), start="first cycle")
        for name, faults in THESIS_FAULTS.items()
    }


def thesis_faults(repetitions: int) -> dict[str, list[Case]]:
    """Return the thesis's faults by name, each with several realisations of the modulation."""
    return {
        name: [Case(case.faults, _seed("single", number, i)) for i in range(repetitions)]
        for number, (name, case) in enumerate(first_cycles().items())
    }


def by_the_law(count: int) -> list[Case]:
    """Return cases with faults from the thesis's distribution: most are small, some are large."""
    return _drawn("law", count, random_faults)


def wide(count: int) -> list[Case]:
    """Return cases with random faults in all components."""
    return _drawn("wide", count, wide_faults)


def without_approach(count: int) -> list[Case]:
    """Return cases with wide faults that start at an unknown position in the play."""
    return [replace(case, start="anywhere") for case in _drawn("play", count, wide_faults)]


def healthy(count: int, purpose: Literal["healthy", "calibration"] = "healthy") -> list[Case]:
    """Return healthy cases, to count false alarms or, from another stream, to calibrate on."""
    return _drawn(purpose, count, lambda rng: healthy_faults())


def step(fault: int, size: float, count: int) -> list[Case]:
    """Return cases with a single fault of ``size``, a share of the range [-].

    A change of gain has either sign; eccentricity has any direction.
    """

    def draw(rng: np.random.Generator) -> NDArray[np.float64]:
        k = healthy_faults()
        k[fault] += size * (rng.choice([-1.0, 1.0]) if k[fault] else 1.0)
        if fault == ECCENTRICITY:
            k[ECCENTRICITY_PHASE] = rng.random()
        return k

    return _drawn("step", count, draw, fault, round(1e5 * size))


def plants(faulty: list[Case], count: int, healthy_count: int) -> list[Plant]:
    """Return plants that deviate from nominal; the faulty cases are assigned to them in turn."""
    result = []
    for number in range(count):
        parameters = _off_nominal(np.random.default_rng(_seed("plant", number)))
        dealt = [HEALTHY] * healthy_count, [case.faults for case in faulty[number::count]]
        result.append(
            Plant(
                *(
                    [Case(k, _seed("plant", number, kind, i), parameters) for i, k in enumerate(ks)]
                    for kind, ks in enumerate(dealt)
                )
            )
        )
    return result


def _drawn(
    stream: str, count: int, draw: Callable[[np.random.Generator], NDArray[np.float64]], *more: int
) -> list[Case]:
    rng = np.random.default_rng(_seed(stream, *more))
    return [Case(_tuple(draw(rng)), _seed(stream, *more, i)) for i in range(count)]


def _seed(stream: str, *more: int) -> tuple[int, ...]:
    return (20_180, _STREAMS.index(stream), *more)


def wide_faults(rng: np.random.Generator) -> NDArray[np.float64]:
    k = 0.6 * rng.random(N_FAULTS)
    k[2:5] = 0.4 * rng.random(3)
    k[ECCENTRICITY_PHASE] = rng.random()
    k[-1] = rng.uniform(0.2, 0.8)
    return k


def _off_nominal(rng: np.random.Generator) -> ActuatorParameters:
    values = _NOMINAL.as_mapping()
    off: dict[str, Any] = {}
    for names in (*((name,) for name in _SIMPLY_OFF), *_JOINTLY_OFF):
        factor = 1.0 + rng.uniform(-PLANT_TOLERANCE, PLANT_TOLERANCE)
        off |= {name: factor * values[name] for name in names}
    return _NOMINAL.replace(off)


def _tuple(faults: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(faults.tolist())
