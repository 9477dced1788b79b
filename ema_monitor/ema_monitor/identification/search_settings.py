# SPDX-License-Identifier: Apache-2.0
"""Settings of the search for faults, for ROS parameters, command line and library."""

from dataclasses import dataclass
from typing import Final

from ema_core.quantity import Checked, flag, quantity, text
from ema_monitor.identification.fitness import DEFAULT_FITNESS, FITNESS
from ema_monitor.optimizers import ALGORITHMS, DEFAULT_ALGORITHM
from ema_monitor.optimizers.driver import Termination

GOODNESS_LIMIT: Final = 3.5
"""Goodness of fit up to which an estimate is valid [-].

A few of 1,000 simulated windows with faults exceed the limit; their estimates are wrong."""

MOST_UNEXPLAINED: Final = 0.4
"""Largest unexplained share of the departure from healthy in a window that fits poorly [-]."""


@dataclass(frozen=True)
class SearchSettings(Checked):
    """Settings of the search for the faults in a window.

    Raises
    ------
    ValueError
        If a value is impossible; the message names it.
    """

    algorithm: str = text(DEFAULT_ALGORITHM, "optimizer", tuple(ALGORITHMS))
    fitness: str = text(DEFAULT_FITNESS, "cost function to minimise", tuple(FITNESS))
    budget: int = quantity(
        Termination.budget, "-", 1, 2**53, "largest number of model evaluations per window"
    )
    goodness_limit: float = quantity(
        GOODNESS_LIMIT,
        "-",
        0.1,
        1e6,
        "goodness of fit above which an estimate is degraded or refused; higher for shorted motors",
    )
    seed: int = quantity(0, "-", 0, 2**53, "seed of the optimizer's random numbers")
    warm_start: bool = flag(True, "start the search from the actuator's last valid estimate")
    memory: bool = flag(True, "use earlier tests of the unit; needs warm_start")
