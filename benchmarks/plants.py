# SPDX-License-Identifier: Apache-2.0
"""Actuators and recordings, drawn from seeds that the monitor was not tuned on.

A unit is the simulator's own actuator or a foreign one (`foreign`). A ``Task`` is a window of a
test cycle, a ``Recording`` is ordinary motion.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from operator import methodcaller
from typing import Any, Final, Literal, NamedTuple, TypeVar, get_args

import numpy as np
from cases import CURRENT_NOISE, DETECTABLE, HEALTHY, RESOLUTIONS
from foreign.effects import DEVELOPMENT, HELD_OUT, Effect, draw_plant
from foreign.plant import ForeignPlant
from numpy.typing import NDArray
from script import Workers
from trials import ACTUATOR

from ema_core.commands import THESIS_CHIRP, Command, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.faults import (
    ECCENTRICITY_PHASE,
    GAIN,
    HIGHEST,
    SHORT_CIRCUITS,
    healthy_faults,
    random_faults,
)
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.api import find_windows
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.windows.trigger import ANY_MOTION, TriggerSettings, WindowTrigger
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator, at_rest
from ema_sim.sensors import Sensors

Kind = Literal["own", "foreign", "exact drive", "held out"]
"""Kinds of actuators.

"own" is the simulator's own actuator. "foreign" plants have the effects for development, "exact
drive" the same without deviations of the drive, "held out" the held-out effects.
"""

T_MAX: Final = ActuatorParameters().T_max
CALIBRATION_WINDOWS: Final = 12
"""Number of healthy windows that each unit is calibrated on."""
CALIBRATION_STRETCHES: Final = 24
"""Number of healthy stretches of ordinary motion for calibration, equal for all motions."""
SECONDS: Final = 20.0
"""Length of a recording of ordinary motion [s]."""

_NOMINAL: Final = ActuatorParameters()
_ROOT: Final = 20_314
_ROOT_OF_MOTION: Final = 41_507
_FIRST_HELD_OUT: Final = 500
_STIR: Final = 1.2e-5
_DURATION: Final = 0.55
_MORE_S: Final = 0.52
_REACH: Final = 8e-3
_H: Final = 1e-4

TEST_MOTIONS: Final = ("chirp", "small chirp", "sine", "moves", "move")
"""Names of the commands of test windows.

"chirp" is the chirp of the test cycle, "small chirp" has 3 mrad up to 20 Hz, "sine" 10 mrad and 4
Hz. "moves" are random smooth moves that differ between windows, "move" is the same in every window.
"""

Recorded = TypeVar("Recorded", "Task", "Recording")
Result = TypeVar("Result")


class Unit(NamedTuple):
    """An actuator with its sensors. The number is the seed of a foreign actuator."""

    kind: Kind
    number: int = 0


@dataclass(frozen=True)
class Task:
    """A window to record: faults, hidden causes in the units of the registry, and motion.

    The motion is one of ``TEST_MOTIONS`` or a command. ``calibrated_on`` is the motion of the
    healthy windows that the unit is calibrated on.
    """

    unit: Unit
    seed: tuple[int, ...]
    faults: tuple[float, ...] = HEALTHY
    causes: Mapping[str, float] = field(default_factory=dict)
    motion: str | Command = "chirp"
    sample_period: float = _H
    calibrated_on: str | Command = "chirp"

    @property
    def description(self) -> ActuatorDescription:
        """Description of the actuator that the monitor receives."""
        return ActuatorDescription(sample_period=self.sample_period)

    @property
    def calibration_key(self) -> tuple[Any, ...]:
        """Key that is equal for tasks with the same calibration."""
        return self.unit, self.calibrated_on, self.sample_period

    def window(self) -> Window:
        """Simulate the task and return its window. The command stirs before the approach.

        Raises
        ------
        RuntimeError
            If the telemetry does not contain exactly one window.
        """
        rng, h = np.random.default_rng(self.seed), self.sample_period
        cycle = build_cycle(_command(self.motion, h, rng), h)
        below, settings = int(np.argmin(cycle.samples[: cycle.start])), TriggerSettings()
        end = cycle.start + round(_MORE_S / h)
        if isinstance(self.motion, Command):
            # A window begins when the command exceeds the threshold, so it ends shortly after it.
            end = cycle.stop + round(0.02 / h)
            settings = TriggerSettings(window_s=(cycle.stop - cycle.start - 1) * h)
        stirred = round(rng.uniform(5e-3, 40e-3) / h)
        stir = cycle.samples[below] + _STIR * rng.standard_normal(stirred)
        commands = np.concatenate([stir, cycle.samples[below:end]])
        telemetry = telemetry_of(self.unit, commands, self.faults, self.causes, rng, h)
        events = WindowTrigger(_NOMINAL, settings).feed(telemetry)
        if len(events) != 1 or not isinstance(events[0], Window):
            raise RuntimeError(f"{self}: no window: {events}")
        return events[0]

    def healthy(self) -> list["Task"]:
        """Return the tasks of the healthy windows that the unit is calibrated on."""
        on = self.calibrated_on
        motion = TEST_MOTIONS.index(on) if isinstance(on, str) else len(TEST_MOTIONS)
        seeds = [_seed(0, self.unit, motion, i, 0) for i in range(CALIBRATION_WINDOWS)]
        return [replace(self, seed=s, faults=HEALTHY, causes={}, motion=on) for s in seeds]

    def calibration(self) -> Calibration:
        """Return the calibration of the unit."""
        return calibrate_model([task.window() for task in self.healthy()], self.description)


@dataclass(frozen=True)
class Recording:
    """Ordinary motion to record: one of ``MOTIONS`` or ``UNINFORMATIVE``.

    ``calibrated_on`` is "chirp" (the test cycle), "motion" or "chirp and motion".
    """

    unit: Unit
    seed: tuple[int, ...]
    motion: str
    faults: tuple[float, ...] = HEALTHY
    causes: Mapping[str, float] = field(default_factory=dict)
    calibrated_on: str = "chirp"

    @property
    def calibration_key(self) -> tuple[Any, ...]:
        """Key that is equal for recordings with the same calibration."""
        return self.unit, self.calibrated_on

    def stretches(self) -> list[Window]:
        """Simulate the recording and return its stretches."""
        rng = np.random.default_rng(self.seed)
        t = _H * np.arange(1.0, round(SECONDS / _H) + 1)
        commands = {**MOTIONS, **UNINFORMATIVE}[self.motion](rng, t)
        telemetry = telemetry_of(self.unit, commands, self.faults, self.causes, rng, _H)
        return find_windows(telemetry, settings=TriggerSettings(windows=ANY_MOTION))

    def calibration(self) -> Calibration:
        """Return the calibration of the unit on the windows that ``calibrated_on`` names."""
        windows = []
        if "chirp" in self.calibrated_on:
            windows += [task.window() for task in Task(self.unit, (0,)).healthy()]
        if "motion" in self.calibrated_on:
            each = CALIBRATION_STRETCHES // len(MOTIONS)
            for i, motion in enumerate(MOTIONS):
                healthy = Recording(self.unit, _motion_seed(0, self.unit, i), motion)
                windows += healthy.stretches()[:each]
        return calibrate_model(windows, ACTUATOR)


def results_by_condition(
    pool: Workers,
    what: str,
    conditions: Mapping[str, Sequence[Recorded]],
    work: Callable[[tuple[Recorded, Calibration]], Result],
) -> dict[str, list[Result]]:
    """Calibrate each unit, and return the results of ``work`` by condition.

    ``work`` receives a task or recording, and the calibration of its unit. ``what`` labels the
    progress.
    """
    every = [task for tasks in conditions.values() for task in tasks]
    units = {task.calibration_key: task for task in every}
    made = pool.map(f"{what}: calibrations", methodcaller("calibration"), list(units.values()))
    calibrations = dict(zip(units, made, strict=True))
    results = iter(
        pool.map(what, work, [(task, calibrations[task.calibration_key]) for task in every])
    )
    return {name: [next(results) for _ in tasks] for name, tasks in conditions.items()}


def dealt(kind: Kind, plants: int, count: int) -> list[tuple[int, Unit]]:
    """Return the numbers from 0 to ``count`` - 1, each with a unit of a kind, in turn.

    Kind "own" has one unit, the other kinds have ``plants``.
    """
    first = _FIRST_HELD_OUT if kind == "held out" else 0
    each = 1 if kind == "own" else plants
    return [(i, Unit(kind, 0 if kind == "own" else first + i % each)) for i in range(count)]


def faulty(
    kind: Kind,
    plants: int,
    count: int,
    *,
    causes: Callable[[np.random.Generator], dict[str, float]] = lambda _: {},
    motion: str = "chirp",
    sample_period: float = _H,
    calibrated_on: str | None = None,
    stream: int,
) -> list[Task]:
    """Return tasks with random faults, half by the thesis's law and half moderate.

    ``causes`` draws the hidden causes of a task. ``calibrated_on`` None is ``motion``. ``stream``
    separates the random numbers of different calls.
    """
    tasks = []
    for i, unit in dealt(kind, plants, count):
        rng = np.random.default_rng(_seed(stream, unit, i))
        # The law alternates between the windows of each unit.
        draw = random_faults if (i // (1 if kind == "own" else plants)) % 2 else moderate_faults
        k, seed = tuple(draw(rng).tolist()), _seed(stream, unit, i, 1, 0)
        on = calibrated_on or motion
        tasks.append(Task(unit, seed, k, causes(rng), motion, sample_period, on))
    return tasks


def moderate_faults(rng: np.random.Generator) -> NDArray[np.float64]:
    """Return random faults in one to three components, at uniform 0.02 to 0.35 from healthy."""
    k = healthy_faults()
    for n in rng.choice(DETECTABLE, rng.integers(1, 4), replace=False):
        sign = rng.choice([-1.0, 1.0]) if n == GAIN else 1.0
        k[n] += sign * rng.uniform(0.02, 0.35)
    k[ECCENTRICITY_PHASE] = rng.random()
    return np.minimum(k, HIGHEST)


def mixed_causes(rng: np.random.Generator) -> dict[str, float]:
    """Return one or two random hidden causes, by name, in the units of the registry."""
    names = rng.choice(list(_RANGES), rng.integers(1, 3), replace=False)
    return {str(name): float(rng.uniform(*_RANGES[name])) for name in names}


def load(rng: np.random.Generator) -> dict[str, float]:
    """Return a random constant load of up to 30 % of the torque limit, as a hidden cause."""
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
"""Hidden causes by row of the table, each on a healthy actuator."""

MAY_BE_SILENT: Final = frozenset({"none", "resistance + 30 %", "supply - 20 %"})
"""Rows in which the estimate need not name a cause."""


def hidden(kind: Kind, plants: int, name: str, count: int) -> list[Task]:
    """Return healthy tasks with the hidden causes of a row of ``HIDDEN``, units in turn."""
    stream = 100 + list(HIDDEN).index(name)
    return [
        Task(unit, _seed(stream, unit, i, 0), causes=HIDDEN[name])
        for i, unit in dealt(kind, plants, count)
    ]


def sine_faults(kind: Kind, plants: int, count: int) -> list[Task]:
    """Return tasks with friction 0.15 and short circuit 0.1, calibrated and run with a sine."""
    k = healthy_faults()
    k[0], k[SHORT_CIRCUITS[0]] = 0.15, 0.1
    return [
        Task(unit, _seed(60, unit, i, 0), tuple(k.tolist()), motion="sine", calibrated_on="sine")
        for i, unit in dealt(kind, plants, count)
    ]


def two_shorts(kind: Kind, plants: int, count: int) -> list[Task]:
    """Return tasks with a short circuit of 0.5 to 0.8 in two phases."""
    tasks = []
    for i, unit in dealt(kind, plants, count):
        rng = np.random.default_rng(_seed(61, unit, i))
        k = healthy_faults()
        k[rng.choice(SHORT_CIRCUITS, 2, replace=False)] = rng.uniform(0.5, 0.8, 2)
        tasks.append(Task(unit, _seed(61, unit, i, 1, 0), tuple(k.tolist())))
    return tasks


def recordings(
    kind: Kind, plants: int, motion: str, calibrated_on: str, count: int
) -> list[Recording]:
    """Return recordings with one to three faults and a load of up to 30 % of the torque limit."""
    names, result = [*MOTIONS, *UNINFORMATIVE], []
    for i, unit in dealt(kind, plants, count):
        stream = 1 if motion in MOTIONS else 2
        seed = _motion_seed(stream, unit, names.index(motion), i)
        rng = np.random.default_rng([*seed, 1])
        k = tuple(moderate_faults(rng).tolist())
        result.append(Recording(unit, seed, motion, k, load(rng), calibrated_on))
    return result


def telemetry_of(
    unit: Unit,
    commands: NDArray[np.float64],
    faults: Sequence[float],
    causes: Mapping[str, float],
    rng: np.random.Generator,
    sample_period: float,
) -> Telemetry:
    """Return the simulated telemetry of a unit, from rest at the first command.

    ``commands`` are ``(n,)`` in rad, ``sample_period`` is in s.
    """
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


def _command(motion: str | Command, h: float, rng: np.random.Generator) -> Command:
    if isinstance(motion, Command):
        return motion
    if motion == "chirp":
        return THESIS_CHIRP
    if motion == "small chirp":
        return Command(amplitude=0.003, end_frequency=20.0)
    if motion == "sine":
        return Command(shape="sine", amplitude=0.01, start_frequency=4.0, duration=_DURATION)
    if motion == "move":
        rng = np.random.default_rng(_ROOT)
    return Command(shape="custom", samples=_test_moves(h, rng))


def _test_moves(h: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return smooth moves back and forth between random angles of up to 8 mrad, with dwells [rad].

    The dwells are short enough that no move ends in a rest, which would end the window.
    """
    parts, at = [], 0.0
    side = rng.choice([-1.0, 1.0])
    while sum(map(len, parts)) < _DURATION / h:
        side = -side
        to = float(side * rng.uniform(2e-3, 8e-3))
        # Limits the speed to half the largest speed of the motor.
        lasts = max(abs(to - at) * np.pi / 2.0 / 0.4, rng.uniform(0.05, 0.1))
        u = np.arange(1, round(lasts / h) + 1) * h / lasts
        parts.append(at + (to - at) * (1.0 - np.cos(np.pi * np.minimum(u, 1.0))) / 2.0)
        parts.append(np.full(round(rng.uniform(0.0, 0.003) / h), to))
        at = to
    return np.concatenate(parts)


def _seed(stream: int, unit: Unit, *more: int) -> tuple[int, ...]:
    return (_ROOT, stream, get_args(Kind).index(unit.kind), unit.number, *more)


def _motion_seed(stream: int, unit: Unit, *more: int) -> tuple[int, ...]:
    return (_ROOT_OF_MOTION, stream, 0 if unit.kind == "own" else 1, unit.number, *more)


def _moves(rng: np.random.Generator, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the command at times ``t`` [s], ``(n,)`` [rad]: smooth random moves with dwells."""
    return _between(rng, t, (0.02, 0.3), 0.05, (0.0, 0.3), smooth=True)


def _ramps(rng: np.random.Generator, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the command at times ``t`` [s], ``(n,)`` [rad]: random ramps with dwells."""
    return _between(rng, t, (0.01, 0.1), 0.02, (0.05, 0.5), smooth=False)


def _sine(rng: np.random.Generator, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the command at times ``t`` [s], ``(n,)`` [rad]: a sine, random in size and rate."""
    f = rng.uniform(0.5, 5.0)
    amplitude = min(rng.uniform(2e-3, _REACH), 0.4 / (2.0 * np.pi * f))
    return amplitude * np.sin(2.0 * np.pi * f * t)


def _between(
    rng: np.random.Generator,
    t: NDArray[np.float64],
    speeds: tuple[float, float],
    shortest_s: float,
    dwells: tuple[float, float],
    *,
    smooth: bool,
) -> NDArray[np.float64]:
    parts, at, count = [np.zeros(round(0.05 / _H))], 0.0, 0
    while count < len(t):
        to = float(rng.uniform(-_REACH, _REACH))
        share = np.pi / 2.0 if smooth else 1.0
        steps = round(max(share * abs(to - at) / rng.uniform(*speeds), shortest_s) / _H)
        u = np.arange(1, steps + 1) / steps
        parts.append(at + (to - at) * ((1.0 - np.cos(np.pi * u)) / 2.0 if smooth else u))
        parts.append(np.full(round(rng.uniform(*dwells) / _H), to))
        at, count = to, sum(map(len, parts))
    return np.concatenate(parts)[: len(t)]


MOTIONS: Final[Mapping[str, Callable[..., NDArray[np.float64]]]] = {
    "moves": _moves,
    "ramps": _ramps,
    "sine": _sine,
}
"""Ordinary motions by name: functions of a random generator and times [s] to a command [rad]."""

UNINFORMATIVE: Final[Mapping[str, Callable[..., NDArray[np.float64]]]] = {
    "rest": lambda rng, t: np.full(len(t), rng.uniform(-_REACH, _REACH)),
    # Below the least travel of a window.
    "tiny sine": lambda rng, t: (
        rng.uniform(1e-4, 4e-4) * np.sin(2.0 * np.pi * rng.uniform(0.5, 5.0) * t)
    ),
    "drift": lambda rng, t: rng.choice([-1.0, 1.0]) * rng.uniform(1e-4, 1.5e-3) * t,
}
"""Motions that carry no information on the faults."""
