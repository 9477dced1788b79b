"""Making the certificate of a test, before it is made: by rehearsing it (M30)."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ema_core.causes import CAUSE_BY_NAME
from ema_core.commands import Command
from ema_core.description import ActuatorDescription
from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS, healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.design.certificate import CauseProspect, Certificate, Repeated
from ema_monitor.design.prediction import Prospect
from ema_monitor.design.rehearsal import (
    HALF_WIDTH,
    REHEARSED_WINDOWS,
    Rehearsed,
    claimed,
    fewest,
    rehearse,
)
from ema_monitor.design.states import Recorder, present
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identifying import identify
from ema_monitor.model.deviations import HIDDEN_CAUSES, Prior
from ema_monitor.model.measured import expected_causes

CERTIFIED_WINDOWS = REHEARSED_WINDOWS + len(HIDDEN_CAUSES)
"""How many windows a certificate takes."""


def certify(
    record: Recorder,
    command: Command,
    description: ActuatorDescription | None = None,
    calibration: Calibration | None = None,
    *,
    repetitions: int = 0,
) -> Certificate:
    """Return what a test will show, from windows of actuators with known faults.

    Parameters
    ----------
    record
        Records the windows, by simulation as a rule.
    command
        Command of the test.
    description
        The actuator; the built-in one when None.
    calibration
        That of the unit; one is made of healthy windows when None.
    repetitions
        Number of further tests that the prediction is compared with, of actuators with several
        faults.

    Raises
    ------
    ValueError
        When the motion makes no window, or does not allow a calibration.
    """
    description = description or ActuatorDescription()
    rehearsed = rehearse(record, command, description, calibration)
    return certificate_of(rehearsed, record, command, description, repetitions=repetitions)


def certificate_of(
    rehearsed: Rehearsed,
    record: Recorder,
    command: Command,
    description: ActuatorDescription,
    *,
    repetitions: int = 0,
) -> Certificate:
    """Return the certificate of a test that has been rehearsed.

    Parameters
    ----------
    rehearsed
        The rehearsal.
    record, command, description, repetitions
        As of `certify`.
    """
    calibration, window = rehearsed.calibration, rehearsed.window
    causes = [
        _cause(
            cause,
            identify(
                record(command, healthy_faults(), 1, {cause.name: cause.sigma})[0],
                description,
                calibration,
            ),
        )
        for cause in expected_causes(
            description.parameters, window.excitation, (), window.telemetry.missing
        )
    ]
    repeated = ()
    if repetitions:
        repeated = _repeated(
            record, command, description, calibration, rehearsed.combined, repetitions
        )
    return Certificate(
        description.actuator_id,
        description.serial_number,
        window.excitation,
        window.sample_period * len(window),
        window.sample_period,
        *calibration.reference(window).scatter,
        rehearsed.faults,
        tuple(causes),
        repeated,
    )


def _cause(cause: Prior, estimate: Estimate) -> CauseProspect:
    faults = [FAULTS[i].label for i in claimed(estimate)]
    label = cause.cause.label
    others = {
        other for pair in estimate.alternatives for one, other in (pair, pair[::-1]) if one == label
    }
    named = [one.name for one in estimate.causes]
    wrong = [CAUSE_BY_NAME[name].label for name in named if name != cause.name] + faults
    if not estimate.valid:
        verdict = "refused"
    elif cause.name in named:
        verdict = "named"
        if others:
            verdict += f", not told from {', '.join(fewest(others))}"
        elif faults:
            verdict += f", with {', '.join(faults)}"
    elif others:
        verdict = f"not told from {', '.join(fewest(others))}"
    else:
        verdict = f"taken for {', '.join(wrong)}" if wrong else "does not show"
    return CauseProspect(cause.name, cause.sigma, verdict)


def _repeated(
    record: Recorder,
    command: Command,
    description: ActuatorDescription,
    calibration: Calibration,
    prospects: Sequence[Prospect],
    repetitions: int,
) -> tuple[Repeated, ...]:
    """Return what tests of some actuators give, identified without knowing their faults."""
    found = []
    for number, one in enumerate(prospects):
        count = (repetitions + number) // len(prospects)
        windows = record(command, one.faults, count, {})
        found.append([identify(window, description, calibration) for window in windows])
    rows = []
    for name in COMPONENTS:
        i = FAULT_NAMES.index(name)
        groups = [
            (one, [estimate for estimate in estimates if i in claimed(estimate)])
            for one, estimates in zip(prospects, found, strict=True)
            if present(one.faults)[i]
        ]
        groups = [(one, estimates) for one, estimates in groups if len(estimates) > 1]
        errors = [np.array([e.faults[i] for e in those]) - one.faults[i] for one, those in groups]
        sigmas = [np.array([e.sigma[i] for e in those]) for _, those in groups]
        rows.append(
            Repeated(
                name,
                sum(map(len, errors)),
                _rms([one.sigma[i] for one, _ in groups]),
                _rms([_rms(values) for values in sigmas]),
                _rms([one.scatter[i] for one, _ in groups]),
                _rms([np.std(values, ddof=1) for values in errors]),
                _rms([_rms(values) for values in errors]),
                float(
                    np.mean(np.abs(np.concatenate(errors)) <= HALF_WIDTH * np.concatenate(sigmas))
                )
                if groups
                else math.nan,
            )
        )
    return tuple(rows)


def _rms(values: ArrayLike) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else math.nan
