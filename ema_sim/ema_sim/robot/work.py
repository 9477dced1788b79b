# SPDX-License-Identifier: Apache-2.0
"""Work of a simulated arm: cycles, wear, temperature and measured telemetry."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, make_dataclass
from typing import Final

import numpy as np

from ema_core.quantity import Checked, quantity
from ema_sim.robot.arm import JOINT_NAMES, arm_unit, gravity_load, part_inertia
from ema_sim.robot.cycle import HOME, CyclePlan, plan_cycle
from ema_sim.robot.joint import CONTROL_S, Vector, controller_of, held, plant_of, simulate_joint

RATES: Final = tuple(rate for rate in range(1, 1001) if 1000 % rate == 0)
"""Possible telemetry rates: divisors of the control rate [Hz]."""

_NOMINAL_DEG_C: Final = 28.0  # temperature at which friction has its nominal value
_HEATING_S: Final = 900.0  # thermal time constant of the gears
_WANDER_S: Final = 7200.0  # correlation time of dry friction
_SPEED_NOISE: Final = 1e-3  # relative to the largest speed
_DAY_H: Final = 24.0
_PARTS_H: Final = 2.0  # time between changes of the part type


@dataclass(frozen=True)
class WorkSettings(Checked):
    """Task and environment of an arm; ValueError if a value is out of range."""

    cycle_pause: float = quantity(4.0, "s", 0.0, 3600.0, "rest at the end of a cycle")
    payload: float = quantity(2.0, "kg", 0.0, 5.0, "mass of the handled parts")
    ambient: float = quantity(22.0, "degC", -20.0, 60.0, "ambient temperature")
    healthy_cycles: int = quantity(0, "-", 0, 1_000_000_000, "cycles before wear begins")


_WEAR: Final = "increase of dry friction per cycle, relative to the healthy joint"
WearSettings: Final = make_dataclass(
    "WearSettings",
    [(name, float, quantity(0.0, "-", 0.0, 10.0, _WEAR)) for name in JOINT_NAMES],
    bases=(Checked,),
    frozen=True,
)
"""Wear of each joint; ValueError if a value is out of range."""


@dataclass(frozen=True, eq=False)
class ArmTelemetry:
    """Consecutive samples of all joints of an arm; columns are in the order of ``JOINT_NAMES``."""

    elapsed_ns: int
    """End of the first sample, counted from the start of the work [ns]."""
    rate: int
    """Sample rate [Hz]."""
    position: Vector
    """Measured position [rad], ``(n, 6)``, like all columns."""
    velocity: Vector
    """Measured speed [rad/s]."""
    effort: Vector
    """Measured motor torque referred to the output, averaged over the sample period [N.m]."""
    position_command: Vector
    """Commanded position [rad]."""
    velocity_command: Vector
    """Commanded speed [rad/s]."""
    temperature: Vector
    """True temperature of the gears [degC]."""
    payload: Vector
    """Mass of the part in the hand, ``(n,)`` [kg]."""

    def __len__(self) -> int:
        return len(self.position)

    @property
    def time_s(self) -> Vector:
        """Time of the samples since the start of the work [s], ``(n,)``."""
        return 1e-9 * self.elapsed_ns + np.arange(len(self)) / self.rate


@dataclass(frozen=True, eq=False)
class ArmCycle:
    """A cycle in progress."""

    number: int
    """Running number, from 0."""
    friction_ratio: Vector
    """Ratio of each joint's dry friction to its healthy value at the same temperature, ``(6,)``
    [-]."""
    plan: CyclePlan
    """The motion."""
    samples: int
    """Number of samples."""
    blocks: Iterator[ArmTelemetry]
    """Telemetry, computed on demand."""


class RobotArm:
    """Runs a unit of the simulated arm through cycles of work.

    The samples do not depend on the length of the blocks.

    Parameters
    ----------
    seed
        Seed of the unit, its goals and its noise.
    sample_rate
        Sample rate [Hz], one of ``RATES``.
    block_s
        Length of a block of telemetry [s]; None for whole cycles.

    Attributes
    ----------
    joints
        Joints of this unit, keyed by name.
    elapsed_ns
        Simulated time so far [ns].

    Raises
    ------
    ValueError
        If ``sample_rate`` is not one of ``RATES``.
    """

    def __init__(
        self, *, seed: int = 0, sample_rate: int = 500, block_s: float | None = None
    ) -> None:
        if sample_rate not in RATES:
            choices = ", ".join(map(str, RATES))
            raise ValueError(
                f"sample_rate = {sample_rate} Hz does not divide 1000 Hz: expected one of {choices}"
            )
        self.joints = arm_unit(seed)
        self.elapsed_ns = 0
        self._rate, self._each = sample_rate, round(1.0 / (sample_rate * CONTROL_S))
        self._block_samples = None if block_s is None else max(1, round(block_s * sample_rate))
        self._rng, self._goals, self._drift = np.random.default_rng((seed, 1)).spawn(3)
        joints = self.joints.values()
        # Loads come from the model of the whole arm; ``gravity`` of a joint only sizes its drive.
        self._plants = [plant_of(joint)._replace(gravity=0.0) for joint in joints]
        self._drives = [controller_of(joint) for joint in joints]
        self._per_kelvin = np.array(
            [(joint.dry_per_kelvin, joint.viscous_per_kelvin) for joint in joints]
        )
        self._warming = np.array([joint.warming for joint in joints])
        self._spread = np.array([joint.dry_of_days for joint in joints])
        self._wander = self._spread * self._drift.standard_normal(len(joints))
        self._wear = np.zeros(len(joints))
        self._temperature: Vector | None = None
        self._states: list[Vector] = []
        self._next_cycle = 0

    def begin_cycle(
        self, work: WorkSettings | None = None, wear: Mapping[str, float] | None = None
    ) -> ArmCycle:
        """Start and return the next cycle.

        If the previous cycle is not complete, the arm starts at rest in its home position.

        Parameters
        ----------
        work
            Settings of the cycle; None for the defaults.
        wear
            Increase of dry friction per cycle relative to its healthy value [-], keyed by joint;
            joints without an entry do not wear.
        """
        work, wear = work or WorkSettings(), wear or {}
        number, self._next_cycle = self._next_cycle, self._next_cycle + 1
        if number >= work.healthy_cycles:
            self._wear = self._wear + [wear.get(name, 0.0) for name in JOINT_NAMES]
        plan = plan_cycle(work.cycle_pause, self._goals)
        samples = math.ceil(round(plan.starts[-1] / CONTROL_S) / self._each)
        kept = math.exp(-samples / self._rate / _WANDER_S)
        noise = math.sqrt(1.0 - kept**2) * self._drift.standard_normal(len(JOINT_NAMES))
        self._wander = kept * self._wander + self._spread * noise
        ratio = (1.0 + self._wear) * (1.0 + self._wander)
        if not self._states:
            loads = gravity_load(HOME[:, None], np.zeros(1))[:, 0]
            self._states = [
                held(position, load, plant)
                for position, load, plant in zip(HOME, loads, self._plants, strict=True)
            ]
        blocks = self._blocks(plan, samples, work, ratio)
        return ArmCycle(number, ratio, plan, samples, blocks)

    def _blocks(
        self, plan: CyclePlan, samples: int, work: WorkSettings, ratio: Vector
    ) -> Iterator[ArmTelemetry]:
        states, self._states = self._states, []
        start_c = np.full(len(ratio), work.ambient)
        if self._temperature is not None:
            start_c = self._temperature
        duty = plan.moving_s * self._rate / samples
        final_c = work.ambient + duty * self._warming
        size = self._block_samples or samples
        for first in range(0, samples, size):
            steps = range(first * self._each, min(first + size, samples) * self._each)
            t = CONTROL_S * np.arange(1 + steps.start, 1 + steps.stop)
            cooling = np.exp(-t / _HEATING_S)[:, None]
            temperature = final_c + (start_c - final_c) * cooling
            self._temperature = temperature[-1]
            yield self._advance(plan, steps, work.payload, ratio, temperature, states)
        self._states = states

    def _advance(
        self,
        plan: CyclePlan,
        steps: range,
        payload: float,
        ratio: Vector,
        temperature: Vector,
        states: list[Vector],
    ) -> ArmTelemetry:
        """Simulate all joints for a range of control periods and return the measured samples."""
        reference = plan.reference(steps.start, steps.stop)
        part = payload * plan.weight(steps.start, steps.stop)
        kelvin = temperature - _NOMINAL_DEG_C
        dry, viscous = self._per_kelvin.T
        conditions = np.empty((len(ratio), len(steps), 4))
        conditions[:, :, 0] = (ratio * (1.0 + dry * kelvin)).T
        conditions[:, :, 1] = np.exp(viscous * kelvin).T
        conditions[:, :, 2] = gravity_load(reference[:, :, 0], part)
        conditions[:, :, 3] = part_inertia(part)
        recorded = np.stack(
            [
                simulate_joint(*inputs)
                for inputs in zip(
                    reference, conditions, self._plants, self._drives, states, strict=True
                )
            ]
        )
        last = slice(self._each - 1, None, self._each)
        position, velocity, effort = self._measure(recorded, last)
        period_ns = 1_000_000_000 // self._rate
        block = ArmTelemetry(
            self.elapsed_ns + period_ns,
            self._rate,
            position,
            velocity,
            effort,
            np.ascontiguousarray(reference[:, last, 0].T),
            np.ascontiguousarray(reference[:, last, 1].T),
            temperature[last],
            part[last],
        )
        self.elapsed_ns += len(block) * period_ns
        return block

    def _measure(self, recorded: Vector, last: slice) -> tuple[Vector, Vector, Vector]:
        """Return position, speed and effort with noise and resolution, ``(n, 6)`` each."""
        output, motor, speed, effort = np.moveaxis(recorded, 2, 0)
        effort = effort.reshape(len(effort), -1, self._each).mean(axis=2).T
        noise = self._rng.standard_normal((len(effort), 2, len(self.joints)))
        position, velocity = np.empty_like(effort), np.empty_like(effort)
        for i, joint in enumerate(self.joints.values()):
            seen = output if joint.sensor == "output" else motor
            position[:, i] = joint.position_step * np.round(seen[i, last] / joint.position_step)
            velocity[:, i] = speed[i, last] + _SPEED_NOISE * joint.speed * noise[:, 0, i]
            effort[:, i] += joint.effort_noise * joint.coulomb * noise[:, 1, i]
        return position, velocity, effort


def work_of_day(hour: float) -> WorkSettings:
    """Return settings for an hour of the work, with the highest ambient temperature at 15 h.

    The mass of the parts changes every 2 h.
    """
    ambient = 21.0 + 4.0 * math.cos(2.0 * math.pi * (hour - 15.0) / _DAY_H)
    kind = np.random.default_rng(int(hour / _PARTS_H))
    return WorkSettings(ambient=ambient, payload=float(np.round(kind.uniform(0.5, 4.0), 1)))


def simulate_work(
    hours: float,
    *,
    seed: int = 0,
    sample_rate: int = 500,
    work: Callable[[float], WorkSettings] = work_of_day,
    wear: Mapping[str, float] | None = None,
) -> Iterator[tuple[ArmCycle, ArmTelemetry]]:
    """Simulate the work of an arm and yield each cycle with its telemetry.

    Parameters
    ----------
    hours
        Duration of the work [h]; the last cycle is completed.
    seed, sample_rate
        See ``RobotArm``.
    work
        Function that returns the settings of a cycle from its start time [h].
    wear
        See ``RobotArm.begin_cycle``.
    """
    arm = RobotArm(seed=seed, sample_rate=sample_rate)
    while (hour := arm.elapsed_ns / 3.6e12) < hours:
        cycle = arm.begin_cycle(work(hour), wear)
        [telemetry] = cycle.blocks
        yield cycle, telemetry
