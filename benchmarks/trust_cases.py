"""What the trust in the monitor is measured on: units, motions, faults and hidden causes, by seeds.

A unit is the simulator's own actuator or a foreign one (`foreign`). Every window is reproducible
from its task.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Final, Literal, NamedTuple, get_args

import numpy as np
from cases import CURRENT_NOISE, RESOLUTIONS
from foreign.effects import DEVELOPMENT, HELD_OUT, Effect, draw_plant
from foreign.plant import ForeignPlant
from numpy.typing import NDArray

from ema_core.commands import THESIS_CHIRP, Command, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.faults import (
    ECCENTRICITY_PHASE,
    GAIN,
    HIGHEST,
    N_FAULTS,
    SHORT_CIRCUITS,
    healthy_faults,
    random_faults,
)
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.windows.trigger import WindowTrigger
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator, at_rest
from ema_sim.sensors import Sensors

Kind = Literal["own", "foreign", "exact drive", "held out"]
"""The simulator's own actuator, or foreign ones: of the effects for development, of these with the
gains of the drive as described, of the effects held out."""

T_MAX: Final = ActuatorParameters().T_max
"""Limit of the motor torque [N.m]."""

HEALTHY: Final = tuple(healthy_faults().tolist())
"""Fault vector of a healthy actuator."""

CALIBRATION_WINDOWS: Final = 12
"""Healthy windows that each unit is calibrated on."""

_NOMINAL: Final = ActuatorParameters()
_ROOT: Final = 20_314
_FIRST_HELD_OUT: Final = 500
_STIR: Final = 1.2e-5
_DURATION: Final = 0.55
_MORE_S: Final = 0.52

MOTIONS: Final = ("chirp", "small chirp", "sine", "moves", "move")
"""Commands: the test cycle's chirp; one of 3 mrad up to 20 Hz; a sine of 10 mrad and 4 Hz; random
smooth moves, others in every window; the same moves in every window."""


class Unit(NamedTuple):
    """An actuator with its sensors, by number: foreign ones are drawn with it as the seed."""

    kind: Kind
    number: int = 0


@dataclass(frozen=True)
class Task:
    """A window to be recorded.

    Attributes
    ----------
    unit
        What it is recorded on.
    seed
        Seed of everything random in it.
    faults
        Fault vector, eight values.
    causes
        Hidden causes by name, in the units of the registry.
    motion
        One of ``MOTIONS``.
    sample_period
        Period of the telemetry [s].
    calibrated_on
        Motion of the healthy windows that the unit was calibrated on.
    """

    unit: Unit
    seed: tuple[int, ...]
    faults: tuple[float, ...] = HEALTHY
    causes: Mapping[str, float] = field(default_factory=dict)
    motion: str = "chirp"
    sample_period: float = 1e-4
    calibrated_on: str = "chirp"

    @property
    def description(self) -> ActuatorDescription:
        """What the monitor is told."""
        return ActuatorDescription(sample_period=self.sample_period)

    def window(self) -> Window:
        """Record it.

        Raises
        ------
        RuntimeError
            When there is no window in the telemetry.
        """
        rng = np.random.default_rng([*self.seed, 0])
        commands = self._commands(rng)
        telemetry = telemetry_of(
            self.unit, commands, self.faults, self.causes, rng, self.sample_period
        )
        events = WindowTrigger(_NOMINAL).feed(telemetry)
        if len(events) != 1 or not isinstance(events[0], Window):
            raise RuntimeError(f"{self}: no window: {events}")
        return events[0]

    def healthy(self) -> list["Task"]:
        """Return the tasks of the windows that this one's unit is calibrated on."""
        return [
            replace(
                self,
                seed=_seed(0, self.unit, MOTIONS.index(self.calibrated_on), i),
                faults=HEALTHY,
                causes={},
                motion=self.calibrated_on,
            )
            for i in range(CALIBRATION_WINDOWS)
        ]

    def _commands(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return the part of the test cycle from its approach, stirred before."""
        h = self.sample_period
        cycle = build_cycle(_command(self.motion, h, rng), h)
        below = int(np.argmin(cycle.samples[: cycle.start]))
        end = cycle.start + round(_MORE_S / h)
        stirred = round(rng.uniform(5e-3, 40e-3) / h)
        stir = cycle.samples[below] + _STIR * rng.standard_normal(stirred)
        return np.concatenate([stir, cycle.samples[below:end]])


class Condition(NamedTuple):
    """A set of windows that are judged together."""

    name: str
    tasks: list[Task]


def units(kind: Kind, count: int) -> list[Unit]:
    """Return the units of a kind; of the simulator's own there is one."""
    if kind == "own":
        return [Unit("own")]
    first = _FIRST_HELD_OUT if kind == "held out" else 0
    return [Unit(kind, first + number) for number in range(count)]


def faulty(
    kind: Kind,
    plants: int,
    count: int,
    *,
    causes: Callable[[np.random.Generator], dict[str, float]] | None = None,
    motion: str = "chirp",
    sample_period: float = 1e-4,
    calibrated_on: str | None = None,
    stream: int,
) -> list[Task]:
    """Return tasks with random faults, half by the thesis's law and half moderate ones."""
    chosen = units(kind, plants)
    tasks = []
    for i in range(count):
        unit = chosen[i % len(chosen)]
        rng = np.random.default_rng(_seed(stream, unit, i))
        # Half of each unit's windows, too.
        draw = random_faults if (i // len(chosen)) % 2 else moderate_faults
        tasks.append(
            Task(
                unit,
                _seed(stream, unit, i, 1),
                tuple(draw(rng).tolist()),
                causes(rng) if causes else {},
                motion,
                sample_period,
                calibrated_on or motion,
            )
        )
    return tasks


def moderate_faults(rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw faults in one to three components, uniform from 0.02 to 0.35 off healthy."""
    k = healthy_faults()
    components = [n for n in range(N_FAULTS) if n != ECCENTRICITY_PHASE]
    for n in rng.choice(components, rng.integers(1, 4), replace=False):
        sign = rng.choice([-1.0, 1.0]) if n == GAIN else 1.0
        k[n] += sign * rng.uniform(0.02, 0.35)
    k[ECCENTRICITY_PHASE] = rng.random()
    return np.minimum(k, HIGHEST)


def mixed_causes(rng: np.random.Generator) -> dict[str, float]:
    """Draw one or two hidden causes."""
    names = rng.choice(list(_RANGES), rng.integers(1, 3), replace=False)
    return {str(name): float(rng.uniform(*_RANGES[name])) for name in names}


def load(rng: np.random.Generator) -> dict[str, float]:
    """Draw a constant load of up to 30 % of the torque limit."""
    return {"load_torque": float(rng.uniform(*_RANGES["load_torque"]))}


_RANGES: Final = {
    "load_torque": (-0.3 * T_MAX, 0.3 * T_MAX),
    "torque_constant": (-0.1, 0.05),
    "winding_temperature": (-30.0, 80.0),
    "supply_voltage": (-0.2, 0.1),
    "viscous_friction": (-0.5, 2.0),
    "inertia": (-0.2, 0.25),
    "current_offset": (-0.1, 0.1),
    "current_gain": (-0.05, 0.05),
    "speed_gain": (-0.02, 0.02),
    "speed_offset": (-1.0, 1.0),
    "position_gain": (-0.02, 0.02),
}

HIDDEN: Final[Mapping[str, Mapping[str, float]]] = {
    "none": {},
    "load 0.005 N.m": {"load_torque": 0.005},
    "load 0.01 N.m": {"load_torque": 0.01},
    "load 0.02 N.m": {"load_torque": 0.02},
    "load 0.3 N.m": {"load_torque": 0.3},
    "torque constant - 5 %": {"torque_constant": -0.05},
    "torque constant - 10 %": {"torque_constant": -0.1},
    "current + 2 %": {"current_gain": 0.02},
    "current - 5 %": {"current_gain": -0.05},
    "current + 0.1 A": {"current_offset": 0.1},
    "viscous friction x 3": {"viscous_friction": 2.0},
    "inertia + 25 %": {"inertia": 0.25},
    "speed + 1 %": {"speed_gain": 0.01},
    "position + 1 %": {"position_gain": 0.01},
    "current 0.3 ms late": {"current_delay": 3e-4},
    "resistance + 30 %": {"winding_temperature": 0.3 / 3.93e-3},
    "supply - 20 %": {"supply_voltage": -0.2},
    "load by position 50 N.m/rad": {"load_stiffness": 50.0},
    "open phase A": {"open_phase_a": 1.0},
    "dead switch": {"dead_switch": 1.0},
    "jam": {"jam": 1.0},
}
"""Hidden causes of the table, each on a healthy actuator."""

MAY_BE_SILENT: Final = frozenset({"none", "resistance + 30 %", "supply - 20 %"})
"""Rows in which nothing need be named."""


def hidden(kind: Kind, plants: int, name: str, count: int) -> list[Task]:
    """Return tasks of a row of the table, dealt among the units."""
    chosen = units(kind, plants)
    row = list(HIDDEN).index(name)
    return [
        Task(unit, _seed(100 + row, unit, i), causes=HIDDEN[name])
        for i, unit in ((i, chosen[i % len(chosen)]) for i in range(count))
    ]


def sine_faults(kind: Kind, plants: int, count: int) -> list[Task]:
    """Return tasks with friction 0.15 and a short circuit of 0.1, calibrated and run on a sine."""
    k = healthy_faults()
    k[0], k[SHORT_CIRCUITS[0]] = 0.15, 0.1
    chosen = units(kind, plants)
    return [
        Task(unit, _seed(60, unit, i), tuple(k.tolist()), motion="sine", calibrated_on="sine")
        for i, unit in ((i, chosen[i % len(chosen)]) for i in range(count))
    ]


def two_shorts(kind: Kind, plants: int, count: int) -> list[Task]:
    """Return tasks with two phases shorted by more than half."""
    chosen = units(kind, plants)
    tasks = []
    for i in range(count):
        unit = chosen[i % len(chosen)]
        rng = np.random.default_rng(_seed(61, unit, i))
        k = healthy_faults()
        k[rng.choice(SHORT_CIRCUITS, 2, replace=False)] = rng.uniform(0.5, 0.8, 2)
        tasks.append(Task(unit, _seed(61, unit, i, 1), tuple(k.tolist())))
    return tasks


def telemetry_of(
    unit: Unit,
    commands: NDArray[np.float64],
    faults: Sequence[float],
    causes: Mapping[str, float],
    rng: np.random.Generator,
    sample_period: float,
) -> Telemetry:
    """Record a unit from rest at the first of some commands, ``(n,)`` [rad]."""
    if unit.kind != "own":
        return _foreign(unit).telemetry(commands, faults, causes, rng, sample_period)
    actuator = SimulatedActuator(_NOMINAL, sample_period=sample_period)
    actuator.faults = np.array(faults)
    actuator.causes = causes
    start = float(commands[0]) / _NOMINAL.tau
    actuator.state = at_rest(start, start)
    sensors = Sensors(CURRENT_NOISE, RESOLUTIONS, rng)
    sensors.set_causes(actuator.causes)
    return sensors.measure(actuator.advance(commands))


@cache
def _foreign(unit: Unit) -> ForeignPlant:
    effects = HELD_OUT if unit.kind == "held out" else DEVELOPMENT
    if unit.kind == "exact drive":
        effects -= {Effect.DRIVE_OFF}
    return draw_plant(unit.number, effects)


def _command(motion: str, h: float, rng: np.random.Generator) -> Command:
    if motion == "chirp":
        return THESIS_CHIRP
    if motion == "small chirp":
        return Command(amplitude=0.003, end_frequency=20.0)
    if motion == "sine":
        return Command(shape="sine", amplitude=0.01, start_frequency=4.0, duration=_DURATION)
    if motion == "move":
        rng = np.random.default_rng(_ROOT)
    return Command(shape="custom", samples=_moves(h, rng))


def _moves(h: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return smooth moves to and fro between random angles of up to 8 mrad, with dwells [rad].

    The dwells are so short that no move ends in a rest, which would end the window.
    """
    parts, at = [], 0.0
    side = rng.choice([-1.0, 1.0])
    while sum(map(len, parts)) < _DURATION / h:
        side = -side
        to = float(side * rng.uniform(2e-3, 8e-3))
        # At most half the largest speed of the motor on the way.
        lasts = max(abs(to - at) * np.pi / 2.0 / 0.4, rng.uniform(0.05, 0.1))
        u = np.arange(1, round(lasts / h) + 1) * h / lasts
        parts.append(at + (to - at) * (1.0 - np.cos(np.pi * np.minimum(u, 1.0))) / 2.0)
        parts.append(np.full(round(rng.uniform(0.0, 0.003) / h), to))
        at = to
    return np.concatenate(parts)


def _seed(stream: int, unit: Unit, *more: int) -> tuple[int, ...]:
    return (_ROOT, stream, get_args(Kind).index(unit.kind), unit.number, *more)
