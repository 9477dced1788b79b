# SPDX-License-Identifier: Apache-2.0
"""Responses of reference and monitor as in chapter 4 of the thesis."""

from collections.abc import Mapping
from functools import cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.commands import THESIS_CHIRP, Command
from ema_core.faults import fault_vector, healthy_faults
from ema_core.telemetry import Telemetry
from ema_monitor.windows.window import Window
from ema_study.models import MODELS, calibration, objective_of, reference, reference_window

COMMANDS: Final = {"step": Command("step", amplitude=1.0), "chirp": THESIS_CHIRP}
"""Commands, keyed by name: a step of 1 rad at 0.01 s, and a chirp of 5 mrad from 0 to 15 Hz (table
3 of the thesis)."""

NOISE_GAINS: Final = (0.0, 1.0, 10.0, 100.0)
"""Values of K_noise in figure 4.50, and 0 for no noise."""

SEVERITIES: Final[dict[str, dict[str, Mapping[str, float]]]] = {
    "friction": {
        f"{x:g} × nominal": {"friction": (x - 1.0) / 2.0} for x in (1.0, 1.5, 2.0, 2.5, 3.0)
    },
    "backlash": {f"{x} × nominal": {"backlash": (x - 1) / 99} for x in (1, 2, 10, 50, 100)},
    # With 100 % of the turns bypassed, the inductance would be zero and the current unlimited.
    "short_circuit": {
        f"{x} % of A bypassed": {"short_circuit_a": x / 100} for x in (0, 25, 50, 75, 99)
    },
    "eccentricity": {f"ζ = {x:g}": {"eccentricity": x} for x in (0.0, 0.25, 0.5, 0.75, 1.0)},
    "gain": {f"{x:g} × nominal": {"gain": x - 0.5} for x in (0.5, 0.75, 1.0, 1.25, 1.5)},
}
"""Values of the faulty components at increasing severities (figures 4.3 to 4.46), keyed by fault
and label of the severity."""

COMPARED: Final = {"friction": 2, "backlash": 3, "short_circuit": 1, "eccentricity": 2, "gain": 4}
"""Index of the severity at which reference and monitor are compared (figures 4.10, 4.19, 4.29, 4.40
and 4.47), keyed by fault."""


class Currents(NamedTuple):
    """Currents in a window, ``(n,)`` each [A]: reference, and monitor keyed by model."""

    reference: NDArray[np.float64]
    monitor: dict[str, NDArray[np.float64]]


@cache
def reference_responses(fault: str, command: str) -> dict[str, Telemetry]:
    """Return the responses of the reference from rest, keyed by the label of the severity.

    At the start, the motor is centred in its play.
    """
    return {
        label: reference(faults, COMMANDS[command]) for label, faults in SEVERITIES[fault].items()
    }


@cache
def noisy_response(noise_gain: float) -> Telemetry:
    """Return the response of the healthy reference to the chirp, with noise.

    White noise is added to the reference current.

    ``noise_gain`` is K_noise; each value is held for 1 us.
    """
    return reference({}, noise_gain=noise_gain, rng=np.random.default_rng(2018))


def compared(fault: str) -> str:
    """Return the label of the severity of a fault at which reference and monitor are compared."""
    return list(SEVERITIES[fault])[COMPARED[fault]]


@cache
def chirp_currents(fault: str) -> Currents:
    """Return the currents of reference and calibrated monitors under the chirp.

    ``fault`` is one of ``COMPARED``, or "none" for the healthy actuator.
    """
    faults = fault_vector({} if fault == "none" else SEVERITIES[fault][compared(fault)])
    window = reference_window(faults)
    monitor = {}
    for model in MODELS:
        objective = objective_of(model, window)
        monitor[model] = objective.expect(objective.encode(faults)[None]).current[0]
    return Currents(window.current, monitor)


@cache
def step_currents(severity: int) -> Currents:
    """Return the currents of reference and monitors under the step, with friction (figure 4.6).

    ``severity`` is an index into the severities of friction. The monitors have the fitted
    parameters of their calibration. The calibrated differences are valid only for the chirp and are
    omitted.
    """
    label, faults = list(SEVERITIES["friction"].items())[severity]
    window = Window(reference_responses("friction", "step")[label], play=0.0)
    monitor = {
        model: calibration(model).model().respond(window, fault_vector(faults), 0.0).current[0]
        for model in MODELS
    }
    return Currents(window.current, monitor)


@cache
def uncalibrated_currents() -> Currents:
    """Return the currents before the calibrated differences are added (figure 6.4)."""
    current = reference_window(healthy_faults()).current
    return Currents(current, {model: current - calibration(model).correction for model in MODELS})
