# SPDX-License-Identifier: Apache-2.0
"""Registry of the optimizers, which minimise a cost in the unit box and do not depend on actuators.

To add an optimizer, implement ``interface.Optimizer`` in a separate file and register it here.
"""

from typing import Final

from ema_monitor.optimizers.differential_evolution import (
    DifferentialEvolution,
    ThesisDifferentialEvolution,
)
from ema_monitor.optimizers.genetic import GeneticAlgorithm
from ema_monitor.optimizers.grey_wolf import GreyWolf, ThesisGreyWolf
from ema_monitor.optimizers.interface import Optimizer
from ema_monitor.optimizers.least_squares import ScreenedLeastSquares
from ema_monitor.optimizers.particle_swarm import ParticleSwarm

DEFAULT_ALGORITHM: Final = "least_squares"

ALGORITHMS: Final[dict[str, type[Optimizer]]] = {
    "least_squares": ScreenedLeastSquares,
    "ga": GeneticAlgorithm,
    "pso": ParticleSwarm,
    "de": DifferentialEvolution,
    "gwo": GreyWolf,
    "de_thesis": ThesisDifferentialEvolution,
    "gwo_thesis": ThesisGreyWolf,
}
"""Optimizers by the name used on the command line, in parameters and in messages."""
