# SPDX-License-Identifier: Apache-2.0
"""Test bench of the simulated arm, which yields timestamped samples for its node."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from ema_core.quantity import Checked, quantity
from ema_sim.robot.joint import Vector
from ema_sim.robot.work import ArmTelemetry, RobotArm, WorkSettings

_BLOCK_S = 0.02  # samples in this time are computed in one call


@dataclass(frozen=True)
class RobotSettings(Checked):
    """Settings of a simulated arm and its telemetry; ValueError if a value is out of range."""

    sample_rate: int = quantity(500, "Hz", 1, 1000, "sample rate of all joints; must divide 1000")
    rate: float = quantity(1.0, "-", 0.01, 100.0, "ratio of simulated to wall time")
    seed: int = quantity(0, "-", 0, 2**62, "seed of the unit, its goals and its noise")


class ArmSample(NamedTuple):
    """Sample of all joints, ``(6,)`` each, and the payload; columns as in ``ArmTelemetry``."""

    stamp_ns: int
    """Time of the sample [ns]."""
    duration_s: float
    """Sample period [s]."""
    position: Vector
    velocity: Vector
    effort: Vector
    position_command: Vector
    velocity_command: Vector
    payload: float
    """Mass of the part in the hand [kg]."""


@dataclass(frozen=True, eq=False)
class ArmWork:
    """A timestamped cycle in progress."""

    number: int
    """Running number, from 0."""
    start_ns: int
    """Start time [ns]."""
    friction_ratio: Vector
    """See ``ArmCycle``."""
    blocks: Iterator[ArmSample]
    """Samples, computed on demand."""


class ArmBench:
    """Runs an arm through timestamped cycles.

    Assignments to ``work`` and ``wear`` take effect with the next cycle.

    Parameters
    ----------
    settings
        Unit of the arm and rate of its samples.
    work, wear
        See ``RobotArm.begin_cycle``.

    Attributes
    ----------
    end_ns
        End of the last sample so far [ns].

    Raises
    ------
    ValueError
        If the rate does not divide 1000 Hz.
    """

    def __init__(
        self, settings: RobotSettings, work: WorkSettings, wear: Mapping[str, float]
    ) -> None:
        self.work, self.wear = work, wear
        self.end_ns = 0
        self._arm = RobotArm(seed=settings.seed, sample_rate=settings.sample_rate, block_s=_BLOCK_S)

    def compile_kernels(self) -> None:
        """Compile the kernel of the simulation, or load it from the cache."""
        next(iter(RobotArm(block_s=_BLOCK_S).begin_cycle().blocks))

    def begin_cycle(self, start_ns: int | None = None) -> ArmWork:
        """Start and return the next cycle.

        It starts at ``start_ns`` [ns], by default at the end of the last sample.
        """
        if start_ns is not None:
            self.end_ns = start_ns
        cycle = self._arm.begin_cycle(self.work, self.wear)
        offset_ns = self.end_ns - self._arm.elapsed_ns
        samples = self._samples(cycle.blocks, offset_ns)
        return ArmWork(cycle.number, self.end_ns, cycle.friction_ratio, samples)

    def _samples(self, blocks: Iterator[ArmTelemetry], offset_ns: int) -> Iterator[ArmSample]:
        for block in blocks:
            period_ns = 1_000_000_000 // block.rate
            stamp_ns = offset_ns + block.elapsed_ns
            for row in zip(
                block.position,
                block.velocity,
                block.effort,
                block.position_command,
                block.velocity_command,
                block.payload.tolist(),
                strict=True,
            ):
                self.end_ns = stamp_ns
                yield ArmSample(stamp_ns, 1e-9 * period_ns, *row)
                stamp_ns += period_ns
