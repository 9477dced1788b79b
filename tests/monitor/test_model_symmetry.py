"""Turning or mirroring the machine with its faults turns or mirrors what it does."""

import math

import numpy as np
import pytest

from ema_core.commands import THESIS_CHIRP
from ema_core.faults import FAULT_NAMES, fault_vector
from ema_core.parameters import ActuatorParameters
from ema_monitor.model.deviations import Deviations
from ema_monitor.model.monitor_model import MonitorModel

from .windows import window_from

PARAMETERS = ActuatorParameters()
CHIRP = np.concatenate([[0.0], THESIS_CHIRP.sample(1e-4)])
# The source form at its own step of 1 us costs twenty times as much.
SAMPLES = {"fast": 5000, "source": 1500}
FAULTS = {
    "friction": 0.1,
    "backlash": 0.01,
    "short_circuit_a": 0.3,
    "short_circuit_b": 0.1,
    "gain": 0.7,
}
ECCENTRIC = FAULTS | {"eccentricity": 0.4, "eccentricity_phase": 0.2}
# Rounding of angles that are a third of a turn apart, times the position gain: some 1e-12 A.
TOLERANCE = 1e-9


def relabelled(faults, names):
    """Faults with what phase A, B, C had now in the phases named, in that order."""
    k = fault_vector(faults)
    short = {phase: FAULT_NAMES.index(f"short_circuit_{phase}") for phase in "abc"}
    moved = k.copy()
    for old, new in zip("abc", names, strict=True):
        moved[short[new]] = k[short[old]]
    return moved


def current(form, command, faults, play, position=0.0):
    command = command[: SAMPLES[form] + 1]
    window = window_from(command, position=position)
    return (
        MonitorModel(PARAMETERS, form, unit=Deviations(lift=0.3))
        .respond(window, faults, play)
        .current[0]
    )


@pytest.mark.parametrize(
    ("form", "faults", "turn"),
    [
        # A third of an electrical turn: phase B now does what phase A did.
        ("fast", FAULTS, 2 * math.pi / 3 / PARAMETERS.P),
        ("source", FAULTS, 2 * math.pi / 3 / PARAMETERS.P),
        # The air gap knows mechanical turns only: a third of one back is two thirds of an
        # electrical turn back, for two pole pairs the same as one third ahead.
        ("fast", ECCENTRIC, -2 * math.pi / 3),
    ],
)
def test_turning_the_rotor_relabels_the_phases(form, faults, turn):
    offset = turn * PARAMETERS.tau
    original = current(form, CHIRP, fault_vector(faults), 0.4)
    turned = current(form, CHIRP + offset, relabelled(faults, "bca"), 0.4, offset)
    assert np.max(np.abs(turned - original)) < TOLERANCE
    # The faults must be seen at all: without relabelling the current is another.
    unchanged = current(form, CHIRP + offset, fault_vector(faults), 0.4, offset)
    assert np.max(np.abs(unchanged - original)) > 0.1


@pytest.mark.parametrize(("form", "faults"), [("fast", ECCENTRIC), ("source", FAULTS)])
def test_mirroring_the_motion_mirrors_the_current(form, faults):
    mirrored = relabelled(faults, "acb")
    phase = FAULT_NAMES.index("eccentricity_phase")
    mirrored[phase] = 1.0 - mirrored[phase]
    original = current(form, CHIRP, fault_vector(faults), 0.4)
    # Only the cosine of the phase is rounded differently.
    assert np.max(np.abs(current(form, -CHIRP, mirrored, -0.4) + original)) < TOLERANCE
