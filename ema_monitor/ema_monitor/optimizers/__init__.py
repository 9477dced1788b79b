"""Optimizers by name. They know a unit box and a cost, nothing of actuators.

To add one, write it in a file of its own after ``interface.Optimizer`` and name it here.
"""

from typing import Final

from ema_monitor.optimizers.interface import Optimizer
from ema_monitor.optimizers.least_squares import ScreenedLeastSquares
from ema_monitor.optimizers.particle_swarm import ParticleSwarm

DEFAULT_ALGORITHM: Final = "least_squares"

ALGORITHMS: Final[dict[str, type[Optimizer]]] = {
    "least_squares": ScreenedLeastSquares,
    "pso": ParticleSwarm,
}
"""Optimizers by the name that command line, parameters and messages use."""
