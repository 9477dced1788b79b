"""Units whose controller is withheld, for unknown_drive.py: their telemetry, and slow records."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
from foreign.effects import DEVELOPMENT, draw_plant
from numpy.typing import NDArray

from ema_core.acquisition import Acquisition
from ema_core.commands import THESIS_CHIRP, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator

RATE_HZ: Final = 1000.0
SLOW_RATES_HZ: Final = (25.0, 50.0, 100.0)
RECORD_S: Final = 20.0

_FINE_S: Final = 2e-3
_NOISE_A: Final = 0.05
_RESOLUTIONS: Final = (1e-6, 0.05)
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
    """A unit at 1 kHz under the thesis's chirp: the reference plant, or a foreign one.

    Attributes
    ----------
    description
        What the monitor is told: gear, pole pairs, nominal play; no controller, no motor.
    """

    seed: int
    foreign: bool
    description: ActuatorDescription

    @classmethod
    def of(cls, seed: int, *, foreign: bool, speed: bool) -> Self:
        """Return the unit of a seed, with or without a measured speed."""
        described = ActuatorDescription(
            serial_number=f"U{seed}",
            sample_period=1.0 / RATE_HZ,
            drive="unknown",
            acquisition=Acquisition(speed=speed),
        )
        return cls(seed, foreign, described)

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
            telemetry = actuator.advance(commands)
            position, speed = (
                digit * np.round(column / digit)
                for digit, column in zip(
                    _RESOLUTIONS, (telemetry.position, telemetry.speed), strict=True
                )
            )
            noise = _NOISE_A * rng.standard_normal(len(telemetry))
            telemetry = replace(
                telemetry, current=telemetry.current + noise, position=position, speed=speed
            )
        if not self.description.acquisition.speed:
            telemetry = replace(telemetry, speed=np.zeros(len(telemetry)))
        # Found with the speed column as it is: the trigger looks at the command alone.
        finder = WindowFinder(TriggerSettings(), self.description)
        events = [*finder.feed(telemetry), *finder.finish()]
        return next(
            one.window
            for one in events
            if isinstance(one, Segment) and isinstance(one.window, Window)
        )


@dataclass(frozen=True, eq=False)
class SlowUnit:
    """A unit that is logged slowly in trapezoidal moves: set point, position error and current.

    Gear, motor and controller gains are drawn; the controller is slow, as those of logged machines
    are: 10 to 60 rad/s of its position loop.
    """

    seed: int
    parameters: ActuatorParameters
    description: ActuatorDescription
    reach: float
    speed: float
    acceleration: float
    noise: float
    resolution: float

    @classmethod
    def of(cls, seed: int) -> Self:
        """Return the unit of a seed."""
        rng = np.random.default_rng((18, seed))
        parameters = _drawn(rng, {"G_prop": (5e3, 3e4), "GAP": (0.025, 0.075)})
        period = 1.0 / float(rng.choice(SLOW_RATES_HZ))
        sampling = str(rng.choice(["mean", "filtered", "instantaneous"]))
        acquisition = Acquisition(
            sampling, 0.5 * period if sampling == "filtered" else 0.0, speed=False
        )
        return cls(
            seed,
            parameters,
            ActuatorDescription(
                serial_number=f"S{seed}",
                sample_period=period,
                drive="unknown",
                acquisition=acquisition,
            ),
            reach=rng.uniform(0.1, 0.25),
            speed=rng.uniform(0.3, 0.6),
            acceleration=rng.uniform(2.0, 5.0),
            noise=rng.uniform(0.02, 0.1),
            resolution=float(rng.choice([2e-6, 1e-5])),
        )

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
        commands = trapezoids(rng, self.reach, self.speed, self.acceleration)
        commands = commands[: len(commands) // steps * steps]
        parameters = self.parameters.replace({"BLK": 0.0}) if preloaded else self.parameters
        actuator = SimulatedActuator(parameters, sample_period=_FINE_S)
        actuator.faults, actuator.causes = faults, causes
        fine = actuator.advance(commands)
        last = slice(steps - 1, None, steps)
        current = self._sampled(fine.current, steps)
        current = current + self.noise * rng.standard_normal(len(current))
        position = self.resolution * np.round(fine.position[last] / self.resolution)
        return Window(
            Telemetry(
                round(1e9 * period),
                period,
                1,
                fine.command[last],
                current,
                position,
                np.zeros(len(position)),
            )
        )

    def _sampled(self, current: NDArray[np.float64], steps: int) -> NDArray[np.float64]:
        acquisition = self.description.acquisition
        if acquisition.current == "mean":
            return current.reshape(-1, steps).mean(axis=1)
        if acquisition.current == "filtered":
            share, held, seen = -np.expm1(-_FINE_S / acquisition.current_filter), 0.0, []
            for value in current.tolist():
                held += share * (value - held)
                seen.append(held)
            current = np.array(seen)
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
