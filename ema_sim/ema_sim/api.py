# SPDX-License-Identifier: Apache-2.0
"""Public Python API of the simulator: telemetry of a faulty actuator in one call."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ema_core.cause_profiles import Causes
from ema_core.commands import THESIS_CHIRP, Command
from ema_core.description import ActuatorDescription
from ema_core.expecting import value_or_default
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry, join
from ema_sim.actuator import SimulatedActuator
from ema_sim.bench import ActuatorBench, BenchSettings
from ema_sim.growth import Growth

__all__ = [
    "ActuatorBench",
    "ActuatorDescription",
    "ActuatorParameters",
    "BenchSettings",
    "Command",
    "Growth",
    "SimulatedActuator",
    "Telemetry",
    "simulate",
]

_HEALTHY: Final[Mapping[str, float]] = {}


def simulate(
    faults: Mapping[str, float] | ArrayLike = _HEALTHY,
    cycles: int = 1,
    *,
    description: ActuatorDescription | None = None,
    parameters: ActuatorParameters | None = None,
    command: Command = THESIS_CHIRP,
    current_noise: float = 0.0,
    resolutions: Mapping[str, float] | None = None,
    causes: Causes = (),
    seed: int = 0,
) -> Telemetry:
    """Simulate test cycles of an actuator and return the telemetry.

    Parameters
    ----------
    faults
        Normalised faults keyed by name, or all eight, ``(8,)`` [-].
    cycles
        Number of test cycles, each with approach, command and return.
    description
        The actuator; None for the built-in actuator.
    parameters
        True parameters, if they differ from the nominal parameters of the description.
    command
        Command of a test cycle.
    current_noise
        Standard deviation of Gaussian noise on each sample of the current [A].
    resolutions
        Resolution of the sensors, keyed by telemetry column [rad, A, rad/s]; columns without an
        entry are exact.
    causes
        Hidden causes, such as ``{"load_torque": 0.01}`` or ``["current_offset=0.1@3.0"]``
        (docs/faults.md). Times count from the start of the telemetry [s].
    seed
        Seed of the noise.

    Raises
    ------
    ValueError
        If a value is out of range or has a wrong type; the message names it.
    """
    if not (isinstance(cycles, int | np.integer) and cycles >= 1):
        raise ValueError(f"cycles = {cycles!r}: expected a whole number of at least 1")
    bench = ActuatorBench(
        value_or_default("description", description, ActuatorDescription, ActuatorDescription),
        BenchSettings(current_noise=current_noise, seed=seed),
        parameters=parameters,
        resolutions=resolutions,
        causes=causes,
    )
    bench.set_command(command)
    bench.set_faults(faults)
    return join([block for _ in range(cycles) for block, _ in bench.begin_cycle().blocks])
