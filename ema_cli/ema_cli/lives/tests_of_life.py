"""A simulated life: its unit, the calibration of that, and its tests as telemetry."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.calibration import Calibration
from ema_sim.bench import ActuatorBench, BenchSettings
from ema_sim.lives import NOISE_OF_DISTURBED, SimulatedLife
from ema_sim.sensors import Sensors

_NS_PER_HOUR: Final = 3_600_000_000_000
_GAP_BLOCKS: Final = 3


def unit_of_life(seed: int, number: int) -> ActuatorDescription:
    """Return the built-in actuator with a serial number of its own."""
    built_in = ActuatorDescription()
    return replace(built_in, serial_number=f"{built_in.serial_number}-{seed}-{number:04d}")


def calibration_of_life(unit: ActuatorDescription) -> Calibration:
    """Return the calibration of a unit that is like the built-in actuator.

    Simulated units do not scatter: calibrated when new, each has the figures of the built-in one.
    """
    return replace(Calibration.builtin(), serial_number=unit.serial_number)


@dataclass(frozen=True, eq=False)
class LifeTest:
    """One test of a life, as it is measured.

    Attributes
    ----------
    number
        Running number, from 0; missing tests have one too.
    hours
        Service hour [h].
    start_ns
        Stamp of its start: the service hour [ns].
    faults
        True faults, ``(8,)``.
    window
        What became of its window, as of ``ema_sim.lives``.
    blocks
        Telemetry; where there is a gap, blocks are missing.
    """

    number: int
    hours: float
    start_ns: int
    faults: NDArray[np.float64]
    window: str
    blocks: list[Telemetry]


def simulated_tests(
    life: SimulatedLife, description: ActuatorDescription, rng: np.random.Generator
) -> Iterator[LifeTest]:
    """Simulate the tests of a life that are not missing, one by one."""
    bench = ActuatorBench(description, BenchSettings(hours_per_cycle=0.0))
    noise = Sensors(NOISE_OF_DISTURBED, {}, rng)
    for number, (hours, faults, window) in enumerate(
        zip(life.hours, life.faults, life.windows, strict=True)
    ):
        if window == "missing":
            continue
        bench.set_faults(faults)
        start_ns = round(float(hours) * _NS_PER_HOUR)
        blocks = [block for block, _ in bench.begin_cycle(start_ns).blocks]
        if window == "noisy":
            blocks = [noise.measure(block) for block in blocks]
        if window == "gap":
            # Inside the window, which begins at 0.8 s of the 1.7 s and is half a second long.
            at = 3 * len(blocks) // 5
            del blocks[at : at + _GAP_BLOCKS]
        yield LifeTest(number, float(hours), start_ns, faults, window, blocks)
