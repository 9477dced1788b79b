"""The monitor models of the study, and the objectives that are minimised with them."""

from functools import cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.commands import THESIS_CHIRP
from ema_core.description import SAMPLE_PERIOD, ActuatorDescription
from ema_core.faults import fault_vector, healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.identification.objective import Objective
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator
from ema_study.cases import CASES

MODELS: Final = {"fast": "fast", "thesis": "source"}
"""Form of the monitor model by its name in the study.

"thesis" is the thesis's own: one sign-switched phase at 1 us with its eq. 4.24, calibrated by the
row of differences on a healthy run. "fast" is the shipped one: the driven pair at 20 us, whose
calibration also fits lift, friction and inertia.
"""

FITNESS: Final = "total_least_squares"


class Problem(NamedTuple):
    """The problem that a run solves: residuals on the unit box of the fault vector, and the truth.

    ``cost_at_truth`` is the cost of the true fault vector [A^2.s]. Where the model describes the
    fault, no search comes far below it.
    """

    objective: Objective
    truth: NDArray[np.float64]
    cost_at_truth: float


def reference_window(faults: ArrayLike) -> Window:
    """Run the reference from rest through the thesis's chirp, the motor centred in its play.

    ``faults`` is a fault vector, ``(8,)``. As the thesis ran it: no approach, perfect sensors. The
    current is the mean over each sample of 100 us, for both models.
    """
    actuator = SimulatedActuator(sample_period=SAMPLE_PERIOD)
    actuator.faults = fault_vector(faults)
    # The window begins with a sample at rest.
    command = np.concatenate([[0.0], THESIS_CHIRP.sample(SAMPLE_PERIOD)])
    return Window(actuator.advance(command), play=0.0)


@cache
def calibration(model: str) -> Calibration:
    """Return the calibration of one of ``MODELS`` on the healthy reference."""
    healthy = reference_window(healthy_faults())
    return calibrate_model([healthy], ActuatorDescription(), MODELS[model])


@cache
def problem(model: str, case: str) -> Problem:
    """Return the problem of a model in one of ``CASES``."""
    truth = CASES[case].truth
    objective = Objective(reference_window(truth), calibration(model), FITNESS, cartesian=False)
    [at_truth] = objective.residuals(objective.encode(truth)[None])
    return Problem(objective, truth, float(at_truth @ at_truth))


@cache
def truth_and_healthy_costs(model: str, case: str) -> tuple[float, float]:
    """Return the costs of a case's true faults and of the healthy ones [A^2.s]."""
    objective, _, at_truth = problem(model, case)
    [residuals] = objective.residuals(objective.encode(healthy_faults())[None])
    return at_truth, float(residuals @ residuals)


def describes(model: str, case: str) -> bool:
    """Return whether a model describes a case: its true faults cost less than the healthy ones."""
    at_truth, at_healthy = truth_and_healthy_costs(model, case)
    return at_truth < at_healthy
