"""Units whose controller is withheld, for unknown_drive.py: their telemetry, and slow records."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from cases import CURRENT_NOISE
from foreign.effects import DEVELOPMENT, draw_plant
from numpy.typing import NDArray
from scipy.signal import lfilter

from ema_core.acquisition import Acquisition
from ema_core.commands import THESIS_CHIRP, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.api import find_windows
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator
from ema_sim.sensors import Sensors

RATE_HZ: Final = 1000.0
SLOW_RATES_HZ: Final = (25.0, 50.0, 100.0)
RECORD_S: Final = 20.0

_FINE_S: Final = 2e-3
_RESOLUTIONS: Final = {"position": 1e-6, "speed": 0.05}
_OFF: Final = {
    **{"f_sm": 0.3, "f_su": 0.3, "J_m": 0.3, "J_u": 0.3, "C_m": 0.5, "C_u": 0.5},
    **{"k_e": 0.1, "R_s": 0.1, "L_s": 0.1, "h_b": 0.2},
}
"""How far a unit is off its description, in either direction [-]: nothing says so."""


def _drawn(
    rng: np.random.Generator, controller: Mapping[str, tuple[float, float]]
) -> ActuatorParameters:
    """Return parameters of a unit, with the gains of its controller drawn in some ranges."""
    nominal = ActuatorParameters().as_mapping()
    values = {name: nominal[name] * (1.0 + rng.uniform(-off, off)) for name, off in _OFF.items()}
    for name, (low, high) in controller.items():
        values[name] = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    values["f_ratio"] = rng.uniform(0.5, 0.8)
    return ActuatorParameters().replace(values)


@dataclass(frozen=True, eq=False)
class FastUnit:
    """A unit at 1 kHz under the thesis's chirp: the reference plant, or a foreign one."""

    seed: int
    foreign: bool
    speed: bool  # whether it is measured

    @property
    def description(self) -> ActuatorDescription:
        """What the monitor is told: gear, pole pairs and nominal play; no controller, no motor."""
        return ActuatorDescription(
            serial_number=f"U{self.seed}",
            sample_period=1.0 / RATE_HZ,
            drive="unknown",
            acquisition=Acquisition(speed=self.speed),
        )

    def window(
        self, faults: Mapping[str, float], causes: Mapping[str, float], number: int
    ) -> Window:
        """Return a window of a test cycle."""
        rng = np.random.default_rng((16, self.seed, number))
        period = self.description.sample_period
        commands = build_cycle(THESIS_CHIRP, period).samples
        if self.foreign:
            plant = draw_plant(self.seed, DEVELOPMENT)
            telemetry = plant.telemetry(commands, fault_vector(faults), causes, rng, period)
        else:
            drawn = np.random.default_rng((17, self.seed))
            parameters = _drawn(drawn, {"G_prop": (5e4, 2e5), "GAP": (0.025, 0.1)})
            actuator = SimulatedActuator(parameters, sample_period=period)
            actuator.faults, actuator.causes = faults, causes
            # So that the modulation of each test is another one.
            actuator.advance(np.zeros(1 + number % 7))
            sensors = Sensors(CURRENT_NOISE, _RESOLUTIONS, rng)
            telemetry = sensors.measure(actuator.advance(commands))
        if not self.speed:
            telemetry = replace(telemetry, speed=np.zeros(len(telemetry)))
        return find_windows(telemetry, self.description)[0]


class SlowUnit:
    """A unit that is logged slowly in trapezoidal moves: set point, position error and current.

    Gear, motor and controller gains are drawn; the controller is slow, as those of logged machines
    are: 10 to 60 rad/s of its position loop.
    """

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng((18, seed))
        self.seed = seed
        self.parameters = _drawn(rng, {"G_prop": (5e3, 3e4), "GAP": (0.025, 0.075)})
        period = 1.0 / float(rng.choice(SLOW_RATES_HZ))
        sampling = str(rng.choice(["mean", "filtered", "instantaneous"]))
        lag = 0.5 * period if sampling == "filtered" else 0.0
        self.description = ActuatorDescription(
            serial_number=f"S{seed}",
            sample_period=period,
            drive="unknown",
            acquisition=Acquisition(sampling, lag, speed=False),
        )
        # Reach [rad], speed [rad/s] and acceleration [rad/s2].
        self._moves = rng.uniform((0.1, 0.3, 2.0), (0.25, 0.6, 5.0)).tolist()
        self._noise = rng.uniform(0.02, 0.1)
        self._resolution = float(rng.choice([2e-6, 1e-5]))

    @property
    def friction(self) -> float:
        """Dry friction when healthy [N.m]."""
        return self.parameters.f_ratio * (self.parameters.f_sm + self.parameters.f_su)

    def record(
        self,
        faults: Mapping[str, float],
        causes: Mapping[str, float],
        number: int,
        *,
        preloaded: bool = False,
    ) -> Window:
        """Return a record; ``preloaded`` has the gear on one flank, as a heavy load keeps it."""
        rng = np.random.default_rng((19, self.seed, number))
        period = self.description.sample_period
        steps = round(period / _FINE_S)
        commands = trapezoids(rng, *self._moves)
        commands = commands[: len(commands) // steps * steps]
        parameters = self.parameters.replace({"BLK": 0.0}) if preloaded else self.parameters
        actuator = SimulatedActuator(parameters, sample_period=_FINE_S)
        actuator.faults, actuator.causes = faults, causes
        fine = actuator.advance(commands)
        last = slice(steps - 1, None, steps)
        current = self._sampled(fine.current, steps)
        current = current + self._noise * rng.standard_normal(len(current))
        position = self._resolution * np.round(fine.position[last] / self._resolution)
        columns = (fine.command[last], current, position, np.zeros(len(position)))
        return Window(Telemetry(round(1e9 * period), period, 1, *columns))

    def _sampled(self, current: NDArray[np.float64], steps: int) -> NDArray[np.float64]:
        acquisition = self.description.acquisition
        if acquisition.current == "mean":
            return current.reshape(-1, steps).mean(axis=1)
        if acquisition.current == "filtered":
            share = -np.expm1(-_FINE_S / acquisition.current_filter)
            current = np.asarray(lfilter([share], [1.0, share - 1.0], current))
        return current[steps - 1 :: steps]


def trapezoids(
    rng: np.random.Generator, reach: float, speed: float, acceleration: float
) -> NDArray[np.float64]:
    """Return moves to and fro with trapezoidal speed and dwells, every 2 ms [rad]."""
    parts, at, side, samples = [np.zeros(round(0.3 / _FINE_S))], 0.0, 1.0, 0
    while samples * _FINE_S < RECORD_S:
        to = side * reach * rng.uniform(0.6, 1.0)
        distance, fastest = abs(to - at), speed * float(rng.choice([0.4, 0.7, 1.0]))
        ramp = min(fastest / acceleration, float(np.sqrt(distance / acceleration)))
        fastest = acceleration * ramp
        lasts = distance / fastest + ramp
        t = np.arange(_FINE_S, lasts + _FINE_S, _FINE_S)
        way = np.where(
            t < ramp,
            acceleration * t**2 / 2.0,
            np.where(
                t < lasts - ramp,
                fastest * (t - ramp / 2.0),
                distance - acceleration * np.maximum(lasts - t, 0.0) ** 2 / 2.0,
            ),
        )
        parts += [
            at + np.sign(to - at) * np.minimum(way, distance),
            np.full(round(rng.uniform(0.1, 0.4) / _FINE_S), to),
        ]
        at, side = to, -side
        samples += len(parts[-1]) + len(parts[-2])
    return np.concatenate(parts)
