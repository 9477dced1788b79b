"""What an estimate of ordinary motion says of one of its stretches."""

from dataclasses import replace

import numpy as np

from ema_core.description import ActuatorDescription
from ema_core.faults import N_FAULTS
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.knowledge import Before, Knowledge
from ema_monitor.identification.objective import Coordinates
from ema_monitor.identification.preview import NUISANCES, Preview
from ema_monitor.identification.search import ModelIdentification
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identification.uncertainty import MISMATCH_SIGMA, SPANS
from ema_monitor.windows.window import Window


def in_stretch(
    estimate: Estimate,
    stretch: Window,
    description: ActuatorDescription,
    calibration: Calibration,
    search: SearchSettings,
) -> Estimate:
    """Return an estimate with the place in the play and the causes that one stretch has.

    An estimate of several stretches has the causes of all. Load and play of one are fitted to it
    with the faults of all taken for known.

    Parameters
    ----------
    estimate
        The estimate of all, valid.
    stretch
        The stretch.
    description, calibration, search
        The actuator, what holds for any motion of it, and how it was identified.
    """
    faults = np.array(estimate.faults)
    point = Coordinates(play=0.0, cartesian=True).encode(faults)
    nothing = np.zeros((N_FAULTS, N_FAULTS))
    covariance = np.diag((MISMATCH_SIGMA / SPANS) ** 2)
    known = Knowledge(point, covariance, nothing[:, :0], 1.0, nothing)
    preview = Preview.of(stretch, calibration, known, faults)
    run = ModelIdentification(
        stretch,
        description,
        calibration,
        search,
        force=True,
        previous=faults,
        before=Before(known, NUISANCES, preview.start),
    )
    for _ in run:
        pass
    if run.estimate is None or not np.isfinite(run.estimate.fitness):
        raise ValueError("the stretch cannot be fitted with the faults of the motion")
    of_stretch = run.estimate
    return replace(
        estimate, play=of_stretch.play, causes=of_stretch.causes, measured=of_stretch.measured
    )
