# SPDX-License-Identifier: Apache-2.0
"""Information that a command gives about the faults, predicted by the model (M31)."""

from dataclasses import replace
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.commands import Command
from ema_core.faults import ECCENTRICITY_PHASE, eccentricity_angle, healthy_faults
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.design.limits import Demands
from ema_monitor.design.rehearsal import N_COMBINED, combined_faults, present
from ema_monitor.identification.objective import Objective
from ema_monitor.identification.uncertainty import (
    MISMATCH_FACTOR,
    MISMATCH_SIGMA,
    PLANE,
    SPANS,
    sandwich_covariance,
    shifts_of,
    with_mismatch,
)
from ema_monitor.windows.window import Window

_PLAY: Final = 1.0


class Information:
    """Predicts the standard deviations of estimated faults, for actuators with several faults.

    Parameters
    ----------
    calibration
        Calibration of the unit, under any command, with the scatter of its healthy windows.
    """

    def __init__(self, calibration: Calibration) -> None:
        self._calibration = calibration
        self._states = [combined_faults(number) for number in range(N_COMBINED)]

    def windows(self, command: Command) -> list[Window]:
        """Return the modelled windows of a command: healthy actuator first, then faulty ones."""
        h = self._calibration.sample_period
        samples = np.concatenate([[0.0], command.sample(h)])
        still = np.zeros_like(samples)
        at_rest = Window(Telemetry(0, h, 1, samples, still, still, still), play=_PLAY)
        faults = np.stack([healthy_faults(), *self._states])
        response = self._calibration.model().respond(at_rest, faults, _PLAY)
        return [
            replace(
                at_rest,
                telemetry=replace(
                    at_rest.telemetry,
                    current=np.concatenate([[0.0], current]),
                    # Motor angle times gear ratio: the play has no effect on the information.
                    position=self._calibration.parameters.tau
                    * h
                    * np.concatenate([[0.0], np.cumsum(speed)]),
                    speed=np.concatenate([[0.0], speed]),
                ),
            )
            for current, speed in zip(*response, strict=True)
        ]

    def demands(self, windows: list[Window]) -> Demands:
        """Return the demands of a command from its `windows`."""
        first = windows[0]
        current = max(float(np.max(np.abs(window.current))) for window in windows)
        return Demands(
            travel=first.excitation,
            current=current,
            torque=self._calibration.parameters.k_t * current,
            speed=max(float(np.max(np.abs(window.telemetry.speed))) for window in windows),
            longest=first.sample_period * len(first),
        )

    def sigma(self, windows: list[Window]) -> Array:
        """Return the standard deviation of each fault, ``(8,)``: the largest over the actuators.

        The value is 0 for the phase, and for faults that no actuator has.
        """
        first = windows[0]
        still = np.zeros(len(first))
        # The state after a calibration under this command.
        calibration = replace(
            self._calibration, command=first.command, correction=still, speed_correction=still
        )
        rows = []
        for faults, window in zip(self._states, windows[1:], strict=True):
            objective = Objective(window, calibration)
            at = objective.linearise(objective.encode(faults, _PLAY))
            effects = objective.unit_effects(at.point) / MISMATCH_FACTOR
            white = np.full(len(at.residuals), np.sqrt(objective.noise))
            covariance = sandwich_covariance(at.jacobian, white, lags=0)
            shifts = shifts_of(at.jacobian, effects)
            covariance += shifts @ shifts.T
            covariance = with_mismatch(covariance * np.outer(SPANS, SPANS), MISMATCH_SIGMA)
            variance = np.diag(covariance).copy()
            # Variance of the eccentricity along its direction; the direction is not a fault.
            phi = eccentricity_angle(faults[ECCENTRICITY_PHASE])
            direction = np.array([np.cos(phi), np.sin(phi)])
            variance[PLANE] = direction @ covariance[np.ix_(PLANE, PLANE)] @ direction, 0.0
            rows.append(np.where(present(faults), variance, 0.0))
        return np.sqrt(np.max(rows, axis=0))
