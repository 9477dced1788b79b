# SPDX-License-Identifier: Apache-2.0
"""Monitor models of the study, and the objectives that the optimizers minimise."""

from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.commands import THESIS_CHIRP, Command
from ema_core.description import SAMPLE_PERIOD, ActuatorDescription
from ema_core.faults import fault_vector, healthy_faults
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.identification.objective import Objective
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator
from ema_study.cases import CASES

FITNESS: Final = "total_least_squares"

MODELS: Final = {"fast": "fast", "thesis": "source"}
"""Form of the monitor model, keyed by its name in the study.

"thesis" is the thesis's model: one sign-switched phase at 1 us with its eq. 4.24, calibrated by
adding the differences from a healthy run. "fast" is the model of the product: the driven pair at 20
us, whose calibration also fits lift, friction and inertia.
"""


class OptimizationProblem(NamedTuple):
    """Optimization problem of a run."""

    objective: Objective
    """Residuals on the unit box of the fault vector."""
    truth: NDArray[np.float64]
    """True fault vector, ``(8,)``."""
    cost_at_truth: float
    """Cost of the true fault vector [A^2.s]. If the model describes the fault, no search reaches a
    much lower cost."""
    cost_at_healthy: float
    """Cost of the healthy fault vector [A^2.s]."""

    @property
    def is_described(self) -> bool:
        """Whether the model describes the fault: the truth costs less than the healthy vector."""
        return self.cost_at_truth < self.cost_at_healthy


def reference(faults: Any, command: Command = THESIS_CHIRP, **noise: Any) -> Telemetry:
    """Return the response of the reference to a command.

    It starts from rest, with the motor centred in its play.

    ``faults`` is a fault vector, ``(8,)``, or a mapping of values keyed by name. As in the thesis,
    there is no approach, and the sensors are perfect. The current is the mean over each sample of
    100 us, for both models.
    """
    actuator = SimulatedActuator(sample_period=SAMPLE_PERIOD, **noise)
    actuator.faults = fault_vector(faults)
    # The window begins with a sample at rest.
    return actuator.advance(np.concatenate([[0.0], command.sample(SAMPLE_PERIOD)]))


def reference_window(faults: ArrayLike) -> Window:
    """Return the window of the reference with faults, ``(8,)``, under the thesis's chirp."""
    return Window(reference(faults), play=0.0)


@cache
def calibration(model: str) -> Calibration:
    """Return the calibration of one of ``MODELS`` on the healthy reference."""
    healthy = reference_window(healthy_faults())
    return calibrate_model([healthy], ActuatorDescription(), MODELS[model])


@cache
def problem(model: str, case: str) -> OptimizationProblem:
    """Return the optimization problem of a model for one of ``CASES``."""
    truth = CASES[case].truth
    objective = objective_of(model, reference_window(truth))
    points = np.stack([objective.encode(faults) for faults in (truth, healthy_faults())])
    return OptimizationProblem(
        objective, truth, *(float(row @ row) for row in objective.residuals(points))
    )


def objective_of(model: str, window: Window) -> Objective:
    """Return the objective that the thesis minimises, on the unit box of the fault vector."""
    return Objective(window, calibration(model), FITNESS, cartesian=False)
